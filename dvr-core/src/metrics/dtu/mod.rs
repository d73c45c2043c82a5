//! The protocol of the DTU multi-view stereo data set (Aanæs, Jensen, Vogiatzis, Tola and Dahl, *Large-Scale Data for
//! Multiple-View Stereopsis*, IJCV 2016): a surface against a scanner's points, where the scanner saw anything.
//!
//! All lengths are in millimetres, the unit of the data set. The rules are those of its evaluation of surfaces, as the
//! Python evaluation that the field uses has them (`jzhangbs/DTUeval-python`):
//!
//! 1. The surface is sampled about every [`DENSITY`], vertices included; points that are nearer than that to one that
//!    stays, in random order, are left out.
//! 2. *Accuracy*: from each of these points within the observation mask to the nearest point of the scan.
//! 3. *Completeness*: from each point of the scan above the plane of the table to the nearest point of the surface that
//!    is less than [`MARGIN`] outside the box of the mask (above: twice that).
//! 4. Distances from [`FARTHEST`] on do not count. The figures are means; *overall* is the mean of both.
//!
//! What publications do besides is [`cull`] (a mesh by dilated masks) and [`DtuSettings::align`] (iterated closest
//! points); a [`DtuScore`] names both.

mod cull;
mod normals;
mod reference;
mod samples;
mod score;
mod thinning;

pub use cull::cull;
pub use reference::{DtuReference, ObservationMask};
pub use score::{DtuDistances, DtuScore, DtuSettings, score_dtu};

/// How densely surfaces are sampled, and how near two points may be.
pub const DENSITY: f64 = 0.2;

/// How far below the box of the observation mask points count for the completeness; above it twice that.
pub const MARGIN: f64 = 60.0;

/// Distances from here on do not count.
pub const FARTHEST: f64 = 20.0;

#[cfg(test)]
mod tests;
