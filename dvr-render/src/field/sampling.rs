//! Sampling: occupancy and colour at points.

use burn::tensor::{Device, Tensor};

use crate::field::query::Query;

/// Occupancy and colour at points.
#[derive(Clone, Debug)]
pub struct FieldValues {
    /// Occupancy logits, `[n]`: positive inside, 0 on the surface (`tau = 0.5`).
    pub occupancy_logit: Tensor<1>,
    /// sRGB colours in `[0, 1]`, `[n, 3]`.
    pub color: Tensor<2>,
}

/// An implicit scene: an occupancy network `f` and a texture field `t` in one (DVR, section 3.1).
///
/// Everything a method does with parameters and points is differentiable where its device tracks gradients; callers
/// that need no gradient pass a field and points without them.
pub trait Field: Sync {
    /// Occupancy logits and colours.
    fn evaluate(&self, query: &Query) -> FieldValues;

    /// Occupancy logits alone, `[n]`: what marching needs, most often cheaper than [`Field::evaluate`].
    fn occupancy_logit(&self, query: &Query) -> Tensor<1> {
        self.evaluate(query).occupancy_logit
    }

    /// Where the parameters live.
    fn device(&self) -> Device;
}

macro_rules! sample_through {
    ($pointer:ty) => {
        impl<F: Field + ?Sized> Field for $pointer {
            fn evaluate(&self, query: &Query) -> FieldValues {
                (**self).evaluate(query)
            }

            fn occupancy_logit(&self, query: &Query) -> Tensor<1> {
                (**self).occupancy_logit(query)
            }

            fn device(&self) -> Device {
                (**self).device()
            }
        }
    };
}
sample_through!(&F);
sample_through!(Box<F>);
