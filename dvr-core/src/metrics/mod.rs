//! How good a result is: [`shape`] against the true surface and volume, [`seen`] where views see it, [`points`] against
//! points that are known to lie on it, [`dtu`] against a scan by the protocol of that data set, [`depth_maps`] of stereo
//! against both, [`picture`] against photographs; [`Simplification`], a simple mesh against the full one; and
//! [`self_intersections`] of a mesh, whatever the truth is.

pub mod alignment;
pub mod depth_maps;
pub mod dtu;
mod overlap;
pub mod picture;
pub mod points;
pub mod seen;
mod self_intersections;
pub mod shape;
mod simplification;

pub use overlap::intersection_over_union;
pub use self_intersections::self_intersections;
pub use simplification::Simplification;
