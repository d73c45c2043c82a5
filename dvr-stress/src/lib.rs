//! Stress tests of reconstruction: synthetic scenes that are hard in one way at a time, and verdicts on reconstructions.
//!
//! An [`Axis`] varies one difficulty: the radius of a rod, the error of the cameras, the number of views. For each value
//! it gives a [`Case`], a scene whose shape is known. [`write_scene`] renders it with its faults. [`measure`] compares a
//! reconstruction with the true shape, [`judge`] gives a [`Verdict`], and [`break_point`] finds the first difficulty that
//! a method does not solve.
//!
//! [`TwoPoses`] photographs one object standing and turned over, for what joins sets of photographs. [`StillLife`]
//! photographs one before several kinds of background, for what finds masks.
//!
//! ```
//! use dvr_stress::{Verdict, axes, judge, measure, write_scene};
//!
//! let axis = axes().into_iter().find(|axis| axis.name == "rod-radius").unwrap();
//! let case = axis.case(2.0).unwrap();
//! let folder = tempfile::tempdir()?;
//! let scene = write_scene(&case, "rod", 0, folder.path())?;
//! assert!(scene.join("cameras.npz").is_file());
//! // The true shape is a solution.
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
mod photographs;
mod scene;
mod shapes;
mod sight;
mod solid_texture;
mod still_life;
mod tabletop;
mod two_poses;
mod verdict;

pub use axis::{Axis, Case, Group, Kind};
pub use catalogue::axes;
pub use cell::{BreakPoint, Cell, break_point};
pub use faults::{Faults, displace_camera};
pub use gradients::GradientTest;
pub use scene::write_scene;
pub use still_life::{Body, StillLife};
pub use tabletop::{Coat, Surroundings};
pub use two_poses::{SETS as TWO_SETS, TwoPoses, seam};
pub use verdict::{Figures, Verdict, judge, measure};
