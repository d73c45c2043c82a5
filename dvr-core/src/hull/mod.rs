//! The visual hull: everything that the masks do not rule out (Laurentini 1994), as an occupancy grid.
//!
//! It holds the object, is cheap, and needs nothing but cameras and masks. So it serves to find the object
//! ([`normalisation()`]), to check that masks and cameras belong together ([`silhouette_consistency`]) and to find out
//! where there is certainly nothing.

mod bounds;
mod carve;
mod coherence;
mod consistency;
mod distance;
mod normalisation;
mod point_box;
mod search;
mod settings;
mod silhouette;
mod visual_hull;
mod wrong_masks;

pub use bounds::Bounds;
pub use coherence::OutlineContradictions;
pub use consistency::silhouette_consistency;
pub use distance::{MAX_DISAGREEING, MaskDistance, hull_distance, hull_distances};
pub use normalisation::{Normalisation, normalisation, normalisation_by_cameras};
pub use point_box::point_box;
pub use settings::HullSettings;
pub use visual_hull::VisualHull;
pub use wrong_masks::wrong_masks;

#[cfg(test)]
mod tests;
