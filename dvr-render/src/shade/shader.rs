//! What rays see: the common view of fields and meshes.

use dvr_core::Ray;

/// Something to render: a field or a mesh. Pictures, validation and evaluation know nothing else.
///
/// Every [`Crossing`](crate::Crossing) field is one through [`FieldShader`](crate::FieldShader), which marches batches of
/// rays, or hands them to the field's own renderer where it has one. A mesh is one through
/// [`MeshShader`](crate::MeshShader).
pub trait Shader: Sync {
    /// What each ray sees, in the rays' order; `None` where it sees nothing.
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>>;
}

impl<S: Shader + ?Sized> Shader for &S {
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
        (**self).shade(rays)
    }
}

/// What one ray sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaded {
    /// Ray depth.
    pub depth: f32,
    /// sRGB colour in `[0, 1]`.
    pub color: [f32; 3],
    /// Outward unit normal.
    pub normal: [f32; 3],
}
