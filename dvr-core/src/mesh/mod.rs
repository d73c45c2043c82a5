//! Triangle meshes: what extraction writes and what the dataset renderer reads.

mod accessor;
mod base_color;
mod components;
mod cut;
mod glb;
mod glb_buffer;
mod gltf;
mod gltf_material;
mod io;
mod manifold;
mod meshopt_views;
mod mtl;
mod normal_map;
mod obj;
mod off;
mod ply;
mod polygon;
mod problem;
mod quantized;
mod remesh;
pub mod shapes;
mod simplify;
mod tangents;
mod texture_file;
mod textured_mesh;
mod topology;
mod triangle_mesh;
mod usdz;
mod uv_vertices;
mod weld;
mod write_textured;

pub use components::connected_components;
pub use io::{check_mesh_format, read_mesh, read_mesh_with_warnings, write_mesh};
pub use normal_map::NormalMap;
pub use simplify::LEAST_FACES;
pub use tangents::corner_tangents;
pub use textured_mesh::{Material, TexturedMesh};
pub use topology::Topology;
pub use triangle_mesh::Mesh;
pub use uv_vertices::UvVertices;
pub use write_textured::{Look, MeshStyle, write_textured_mesh};

/// What made a file.
const GENERATOR: &str = concat!("dvr ", env!("CARGO_PKG_VERSION"));
