//! What is learned: the trait through which everything here knows a field.

use burn::tensor::{Device, Int, Tensor};

use crate::extract::ScalarField;
use crate::march::{MarchSettings, Marcher};

/// Points at which a field is asked, and whose they are.
#[derive(Clone, Debug)]
pub struct Query {
    /// Positions, `[n, 3]`, object space.
    pub points: Tensor<2>,
    /// Index of the object (row of the latent codes) of each point, `[n]`; `None` where there is only object 0.
    pub object: Option<Tensor<1, Int>>,
}

impl Query {
    /// Points of the one object that a per-scene field holds.
    pub fn new(points: Tensor<2>) -> Self {
        Self { points, object: None }
    }

    /// How many points are asked for.
    pub fn len(&self) -> usize {
        self.points.dims()[0]
    }

    /// Whether nothing is asked.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The points `start..start + length`.
    pub fn narrow(&self, start: usize, length: usize) -> Self {
        Self {
            points: self.points.clone().narrow(0, start, length),
            object: self.object.clone().map(|o| o.narrow(0, start, length)),
        }
    }
}

/// Occupancy and colour at points.
#[derive(Clone, Debug)]
pub struct FieldValues {
    /// Occupancy logits, `[n]`: positive inside, 0 on the surface (`tau = 0.5`).
    pub occupancy_logit: Tensor<1>,
    /// sRGB colours in `[0, 1]`, `[n, 3]`.
    pub color: Tensor<2>,
}

/// Values and their derivatives along a direction a point, from one forward-mode pass.
#[derive(Clone, Debug)]
pub struct FieldJet {
    /// The values at the points.
    pub value: FieldValues,
    /// `d value / d t` of `value(point + t * direction)` at `t = 0`: the Jacobian-vector product.
    pub derivative: FieldValues,
}

/// An implicit scene: an occupancy network `f` and a texture field `t` in one (DVR, section 3.1).
///
/// [`Field::evaluate`] is all that must be written; the derivatives then come from central differences. A field that
/// can do better (by forward-mode differentiation) overrides [`Field::jet`] and [`Field::occupancy_gradient`].
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

    /// Values together with their derivatives along `direction`, `[n, 3]`, of any length.
    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        let at = |t: f32| {
            let points = query.points.clone() + direction.clone() * t;
            self.evaluate(&Query { points, object: query.object.clone() })
        };
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

    /// Where the parameters live.
    fn device(&self) -> Device;

    /// What marching, rendering and extraction ask instead, where that is faster than tensors: the field as it is now,
    /// without gradients, one snapshot an object. None where the field has no such thing, or not for its device.
    fn snapshots(&self) -> Vec<Snapshot> {
        Vec::new()
    }

    /// A marcher of the field's own for its device, where that has one that is faster than tensors: a kernel of a GPU.
    /// It is asked for where there are no snapshots.
    fn device_marcher(&self, settings: MarchSettings) -> Option<Box<dyn Marcher + '_>> {
        let _ = settings;
        None
    }
}

/// A field of one object that no longer changes.
pub type Snapshot = Box<dyn ScalarField + Send + Sync>;

/// Step of the default central differences, in object units: between rounding (1e-7 / step) and curvature (step^2).
const DIFFERENCE_STEP: f32 = 1e-3;

/// The unit vector of one axis for every point of a query, `[n, 3]`.
pub fn axis_direction(query: &Query, axis: usize) -> Tensor<2> {
    let direction = Tensor::zeros([query.len(), 3], &query.points.device());
    direction.slice_fill([0..query.len(), axis..axis + 1], 1.0)
}

impl<F: Field + ?Sized> Field for &F {
    fn evaluate(&self, query: &Query) -> FieldValues {
        (**self).evaluate(query)
    }

    fn occupancy_logit(&self, query: &Query) -> Tensor<1> {
        (**self).occupancy_logit(query)
    }

    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        (**self).jet(query, direction)
    }

    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        (**self).occupancy_gradient(query)
    }

    fn device(&self) -> Device {
        (**self).device()
    }

    fn snapshots(&self) -> Vec<Snapshot> {
        (**self).snapshots()
    }

    fn device_marcher(&self, settings: MarchSettings) -> Option<Box<dyn Marcher + '_>> {
        (**self).device_marcher(settings)
    }
}
