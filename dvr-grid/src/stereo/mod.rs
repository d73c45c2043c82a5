//! A start from stereo: depth maps from a plane sweep through the visual hull, fused to one distance field.
//!
//! A surface's gradient travels a cell or two; a visual hull may be tens of cells off, where views are cut by the frame,
//! come from one side, or look into a hollow. So before training each view is matched with its neighbours at every depth
//! that the hull allows (plane sweep: Collins 1996), the matches are made smooth along eight directions (semi-global
//! matching: Hirschmueller 2008), depths that other views confirm are kept, and all are fused to a truncated signed
//! distance (Curless and Levoy 1996) that the hull bounds.

mod consistency;
mod correlation;
mod cost_volume;
mod depth_map;
mod fusion;
#[cfg(feature = "gpu")]
mod gpu;
mod hull;
mod picture;
mod semi_global;
mod start;
mod sweep;
mod view_selection;

pub(crate) use fusion::FusedDistance;
pub(crate) use start::Stereo;
