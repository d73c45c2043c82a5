//! Textures from posed photographs: the surface of any mesh cut into charts, and colours that agree with the pictures.
//!
//! ```
//! use dvr_core::mesh::{MeshStyle, TexturedMesh, shapes, write_textured_mesh};
//! use dvr_core::synth::{SynthConfig, render_dataset};
//! use dvr_core::{Cancellation, Scene, View};
//! use dvr_texture::{TextureSettings, texture_mesh};
//!
//! // Photographs of a ball, and the ball.
//! let folder = tempfile::tempdir()?;
//! let mut ball = TexturedMesh { mesh: shapes::icosphere(3, 1.0), ..TexturedMesh::default() };
//! ball.mesh.colors = Some(ball.mesh.vertices.iter().map(|v| [0.5 + 0.4 * v.x, 0.5, 0.5 - 0.4 * v.y]).collect());
//! let few = SynthConfig { views: 12, surface_points: 100, occupancy_points: 100, ..SynthConfig::default() };
//! render_dataset(&ball, "ball", "balls", folder.path(), &few, &|_, _| ())?;
//! let scene = Scene::read(folder.path().join("balls/ball"))?;
//!
//! // The same ball without colours, where the photographs have it.
//! let bare = shapes::icosphere(3, 0.45);
//! let views: Vec<&View> = scene.views.iter().collect();
//! let textured = texture_mesh(&bare, &views, &TextureSettings::default(), &Cancellation::default(), |_, _| ())?;
//! println!("{} charts on {} texels", textured.report.charts, textured.report.size);
//! write_textured_mesh(folder.path().join("ball.glb"), &textured.mesh, MeshStyle::default())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(missing_docs)]

mod atlas;
mod auto_size;
mod blend;
mod error;
mod fill;
mod memory;
mod normal_map;
mod photographs;
mod settings;
mod solve;
mod texels;
mod texture;
mod view_buffer;

pub use error::TextureError;
pub use normal_map::{REACH, bake_normals};
pub use settings::{SIZES, TextureSettings, TextureSize};
pub use texture::{NormalMapReport, PARTS, TextureReport, Textured, texture_mesh};
