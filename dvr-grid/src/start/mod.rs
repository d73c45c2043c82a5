//! What training starts from: the visual hull, and what a plane sweep shows to be empty in it.

mod hull;
mod plane_sweep;

pub(crate) use hull::{add_hull_detail, hull_start};
pub(crate) use plane_sweep::SpaceCarving;
