//! The terms of the loss, one file each, and the one list of them.
//!
//! The list makes the configuration ([`GridLosses`]), the sums of a step (`LossSums`), the columns of a ray's record
//! on a GPU (`RayLosses`), the names of the report ([`NAMES`]), and what evaluates the terms on CPU and GPU. To add
//! a term: write its file, with the trait of its kind and its kernel function, and enter it here.

use std::ops::RangeInclusive;

use dvr_core::number_range::{Allowed, NumberRange};
use serde::{Deserialize, Serialize};

use crate::views::TrainingView;
use term::{Comparison, CrossViewTerm, LossTerm, SilhouetteTerm, SurfaceGradient, SurfaceHit, SurfaceTerm};

#[macro_use]
mod list;

mod color;
mod depth;
mod detached_color;
mod mask;
mod patch_ncc;
mod photo_consistency;
pub(crate) mod smoothness;
pub(crate) mod term;

pub use color::ColorLoss;
pub use depth::DepthLoss;
pub use detached_color::DetachedColorLoss;
pub use mask::MaskLoss;
pub use patch_ncc::PatchNccLoss;
pub use photo_consistency::PhotoConsistencyLoss;
pub use smoothness::SmoothnessLoss;

loss_terms! {
    // The ray of an object pixel hits: the colour there.
    appearance {
        color: ColorLoss,
        detached_color: DetachedColorLoss,
    }
    // The same, in other views; means over those.
    cross_view {
        photo_consistency: PhotoConsistencyLoss,
        patch_ncc: PatchNccLoss,
    }
    // The same: where the hit lies.
    geometry {
        depth: DepthLoss,
    }
    // Hit and mask do not agree.
    silhouette {
        mask: MaskLoss,
    }
    // Not of rays: means over the nodes near the surface, each with kernels of its own.
    nodes {
        smoothness: SmoothnessLoss,
    }
}

/// No number of a term is larger: all are stored in single precision.
const LARGEST: f64 = 1e6;

/// The ranges of the numbers of a term.
fn ranges(name: &str, term: &(impl LossTerm + Serialize)) -> Vec<NumberRange> {
    let numbers = serde_json::to_value(term).unwrap_or_default();
    let weight = ("weight", term.weight(), 0.0..=LARGEST);
    let range = |(parameter, _, range): (&'static str, f64, RangeInclusive<f64>)| {
        let (least, most) = (*range.start(), range.end().min(LARGEST));
        let is_whole = numbers.get(parameter).is_some_and(serde_json::Value::is_u64);
        let allowed = if is_whole { Allowed::Whole(least as u64, most as u64) } else { Allowed::Real(least, most) };
        NumberRange { key: format!("losses.{name}.{parameter}").into(), allowed }
    };
    std::iter::once(weight).chain(term.parameters()).map(range).collect()
}
