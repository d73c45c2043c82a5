//! Where reconstruction fails: scenes that are hard in one way at a time, and verdicts on what methods make of them.
//!
//! An [`Axis`] is one difficulty: a rod's radius, the error of the cameras, the number of views. For each of its
//! difficulties it gives a [`Case`], a scene with a true shape, which [`write_scene`] renders and spoils. Whatever a
//! method makes of the pictures is measured ([`measure`]) and judged ([`judge`]); [`break_point`] tells how far the
//! method holds.
//!
//! ```
//! use dvr_stress::{Verdict, axes, judge, measure, write_scene};
//!
//! let axis = axes().into_iter().find(|axis| axis.name == "rod-radius").unwrap();
//! let case = axis.case(2.0).unwrap();
//! let folder = tempfile::tempdir()?;
//! let scene = write_scene(&case, "rod", 0, folder.path())?;
//! assert!(scene.join("cameras.npz").is_file());
//! // A method that finds the truth has solved it.
//! let figures = measure(&case, 0, Some(&case.object.mesh))?;
//! assert_eq!(judge(&case, &figures, None), Verdict::Solved);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(missing_docs)]

mod axis;
mod catalogue;
mod cell;
mod faults;
mod gradients;
mod paint;
mod scene;
mod shapes;
mod sight;
mod verdict;

pub use axis::{Axis, Case, Group, Kind};
pub use catalogue::axes;
pub use cell::{BreakPoint, Cell, break_point};
pub use faults::{Faults, displace_camera};
pub use gradients::GradientTest;
pub use scene::{true_cameras, write_scene};
pub use verdict::{Figures, Verdict, judge, measure};
