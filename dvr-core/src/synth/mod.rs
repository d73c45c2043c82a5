//! Rendering meshes into datasets: ground truth for experiments, from any model.
//!
//! A ray caster in the layout of the DVR datasets: textured meshes in, pictures with masks, depth maps, cameras,
//! surface points and occupancies out.
//!
//! ```
//! use dvr_core::mesh::{TexturedMesh, shapes};
//! use dvr_core::synth::{SynthConfig, render_dataset};
//!
//! let torus = TexturedMesh { mesh: shapes::torus(0.3, 0.1, 48, 24), ..TexturedMesh::default() };
//! let config = SynthConfig { views: 4, surface_points: 1000, occupancy_points: 1000, ..SynthConfig::default() };
//! let out = tempfile::tempdir()?;
//! render_dataset(&torus, "torus", "shapes", out.path(), &config, &|done, total| println!("{done} of {total}"))?;
//! assert!(out.path().join("shapes/torus/image/0003.png").is_file());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod config;
mod corpus;
mod dataset;
mod gloss;
mod lists;
mod placement;
mod render;
mod shading;

pub use config::{CameraPlacement, DirectionalLight, EdgeColor, Gloss, Lighting, SynthConfig};
pub use corpus::{CorpusObject, CorpusReport, SplitRatios, render_corpus};
pub use dataset::{Shot, render_dataset, write_shots};
pub use placement::place_cameras;
pub use render::{MeshRenderer, RenderedView};
