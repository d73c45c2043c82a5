//! Crossing: where rays first meet the surface, by the fastest way that a field has.

use crate::field::differentiation::Differentiable;
use crate::field::scalar::ScalarField;
use crate::march::marcher::{MarchSettings, Marcher};
use crate::shade::shader::Shader;

/// A field whose surface rays can be sent to.
///
/// Nothing must be written: `impl Crossing for Mine {}` is marched through tensors ([`TensorMarcher`]). Each method names
/// a faster way, for the field as it is now and without gradients; [`FieldSurface`] takes the best of them.
///
/// [`TensorMarcher`]: crate::TensorMarcher
/// [`FieldSurface`]: crate::extract::FieldSurface
pub trait Crossing: Differentiable {
    /// A marcher of the field's own: an exact crossing, or a kernel of the GPU that the field lies on.
    fn own_marcher(&self, settings: MarchSettings) -> Option<Box<dyn Marcher + '_>> {
        let _ = settings;
        None
    }

    /// What marching, rendering and extraction ask on the CPU instead of tensors, one snapshot per object. Empty where
    /// the field has no such thing, or not for its device.
    fn snapshots(&self) -> Vec<Snapshot> {
        Vec::new()
    }

    /// A renderer of the field's own, where tracing each ray by itself is faster than marching batches of rays.
    fn own_shader(&self) -> Option<&dyn Shader> {
        None
    }
}

/// A field of one object that no longer changes.
pub type Snapshot = Box<dyn ScalarField + Send + Sync>;

macro_rules! cross_through {
    ($pointer:ty) => {
        impl<F: Crossing + ?Sized> Crossing for $pointer {
            fn own_marcher(&self, settings: MarchSettings) -> Option<Box<dyn Marcher + '_>> {
                (**self).own_marcher(settings)
            }

            fn snapshots(&self) -> Vec<Snapshot> {
                (**self).snapshots()
            }

            fn own_shader(&self) -> Option<&dyn Shader> {
                (**self).own_shader()
            }
        }
    };
}
cross_through!(&F);
cross_through!(Box<F>);
