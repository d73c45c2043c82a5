//! Differentiation: how occupancy and colour change with the point.

use burn::tensor::Tensor;

use crate::field::query::Query;
use crate::field::sampling::{Field, FieldValues};

/// Values and their derivatives along a direction per point.
#[derive(Clone, Debug)]
pub struct FieldJet {
    /// The values at the points.
    pub value: FieldValues,
    /// `d value / d t` of `value(point + t * direction)` at `t = 0`: the Jacobian-vector product.
    pub derivative: FieldValues,
}

/// A field with derivatives by the point; viewing directions stay as they are asked.
///
/// The defaults are central differences, so that `impl Differentiable for Mine {}` is enough. A field that can do better
/// (by forward-mode differentiation) overrides both methods.
pub trait Differentiable: Field {
    /// Values together with their derivatives along `direction`, `[n, 3]`, of any length.
    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        let at = |t: f32| self.evaluate(&query.moved_to(query.points.clone() + direction.clone() * t));
        let (above, below) = (at(DIFFERENCE_STEP), at(-DIFFERENCE_STEP));
        let scale = 0.5 / DIFFERENCE_STEP;
        FieldJet {
            value: self.evaluate(query),
            derivative: FieldValues {
                occupancy_logit: (above.occupancy_logit - below.occupancy_logit) * scale,
                color: (above.color - below.color) * scale,
            },
        }
    }

    /// `grad_p f`, `[n, 3]`. The outward normal of the surface is its negative, normalised.
    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        let along = (0..3).map(|axis| {
            let direction = axis_direction(query, axis);
            self.jet(query, direction).derivative.occupancy_logit.unsqueeze_dim::<2>(1)
        });
        Tensor::cat(along.collect(), 1)
    }
}

/// Step of the default central differences, in object units: between rounding (1e-7 / step) and curvature (step^2).
const DIFFERENCE_STEP: f32 = 1e-3;

/// The unit vector of one axis for every point of a query, `[n, 3]`.
pub fn axis_direction(query: &Query, axis: usize) -> Tensor<2> {
    let direction = Tensor::zeros([query.len(), 3], &query.points.device());
    direction.slice_fill([0..query.len(), axis..axis + 1], 1.0)
}

macro_rules! differentiate_through {
    ($pointer:ty) => {
        impl<F: Differentiable + ?Sized> Differentiable for $pointer {
            fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
                (**self).jet(query, direction)
            }

            fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
                (**self).occupancy_gradient(query)
            }
        }
    };
}
differentiate_through!(&F);
differentiate_through!(Box<F>);
