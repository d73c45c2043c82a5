//! What rays see.

mod field_shader;
mod mesh_shader;
pub(crate) mod shader;

pub use field_shader::{FieldShader, RenderSettings};
pub use mesh_shader::MeshShader;
pub use shader::{Shaded, Shader};
