//! A mesh against points that are known to lie on the true surface.

mod distance;
mod extent;
mod floor;
mod hidden;
mod score;

pub(super) use distance::quantile;
pub use distance::{DistanceSummary, ShareBelow};
pub use floor::PointsFloor;
pub use hidden::{HiddenPoints, Witnesses};
pub use score::{PointsScore, PointsSettings, score_points};

#[cfg(test)]
mod tests;
