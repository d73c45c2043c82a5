//! What training starts from: the visual hull, less what a plane sweep of the photographs shows to be empty in it.

mod carving_votes;
mod closed_hollows;
mod confirmed;
#[cfg(feature = "gpu")]
mod gpu;
mod hull;
mod mask_distances;
mod plane_sweep;
mod silhouettes;
mod space_carving;

pub(crate) use closed_hollows::open_share;
pub(crate) use hull::{hull_detail, hull_start};
pub(crate) use mask_distances::MaskDistances;
pub(crate) use space_carving::{CARVING_CELLS, CARVING_NODE, SpaceCarving};
