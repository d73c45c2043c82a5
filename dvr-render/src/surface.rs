//! From the hits of a march to depth, points and colours on the autodiff graph.

use burn::tensor::Tensor;

use crate::field::{Differentiable, Field};
use crate::implicit_depth::implicit_depth;
use crate::march::Hits;
use crate::slope_rule::SlopeRule;

/// The visible surface at the hits of a batch, differentiable.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Ray depth, `[h]`, with the analytic gradient.
    pub depth: Tensor<1>,
    /// The points, `[h, 3]`: they move along their rays as the depth does.
    pub point: Tensor<2>,
    /// sRGB colour of the moving points, `[h, 3]`: its gradient moves the surface.
    pub color: Tensor<2>,
    /// sRGB colour at the fixed points, `[h, 3]`: the same values, but only the texture learns from it.
    pub fixed_color: Tensor<2>,
    /// Occupancy logit at the fixed points, `[h]`: zero to the root search's precision.
    pub occupancy_logit: Tensor<1>,
    /// `grad_p f` at the hits, `[h, 3]`, a constant; the outward normal is its negative, normalised.
    pub gradient: Tensor<2>,
}

impl Surface {
    /// Puts the hits on the graph of `field`.
    ///
    /// `frozen` is the same field without gradient tracking (`Module::valid`), `hits` come from marching it. The field
    /// is evaluated once on the graph, at the fixed points. As these do not move, the colour's dependence on depth is
    /// added to first order with the derivative `t'` of the texture along the ray, which the forward-mode pass gives:
    /// `t + t' (d - d_hat)` has the value of `t` and exactly its gradient.
    pub fn on_graph(field: &impl Field, frozen: &impl Differentiable, hits: &Hits, rule: SlopeRule) -> Self {
        let rays = &hits.rays;
        let fixed = hits.query();
        let jet = frozen.jet(&fixed, rays.direction.clone());
        let gradient = frozen.occupancy_gradient(&fixed);
        let inverse_slope = rule.inverse_slope(gradient.clone(), rays.direction.clone());

        let lift = |t: Tensor<2>| Tensor::from_inner(t);
        let fixed_depth: Tensor<1> = Tensor::from_inner(hits.depth.clone());
        let fixed = fixed.lifted();
        let values = field.evaluate(&fixed);
        let points = fixed.points;
        let occupancy_logit = values.occupancy_logit;
        let depth = implicit_depth(occupancy_logit.clone(), fixed_depth.clone(), Tensor::from_inner(inverse_slope));
        let moved = (depth.clone() - fixed_depth).unsqueeze_dim::<2>(1);
        let fixed_color = values.color;
        let color = fixed_color.clone() + lift(jet.derivative.color) * moved.clone();
        let point = points + lift(rays.direction.clone()) * moved;
        Self { depth, point, color, fixed_color, occupancy_logit, gradient }
    }
}
