//! Masks of photographs that have none: from all views at once, or by a program that is run for each.
//!
//! ```no_run
//! use dvr_core::{Cancellation, Scene};
//! use dvr_segmentation::{Wanted, segment};
//!
//! let scene = Scene::read("photos/teapot")?;
//! let found = segment(&scene.views, Wanted::Auto, &Cancellation::default(), &|_, _| ())?;
//! for (view, mask) in scene.views.iter().zip(&found.masks) {
//!     println!("{}: {} pixels show the object", view.name, mask.object_pixels());
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A picture alone does not say what in it is the object; all together do: what the cameras look at, what stands out of
//! the plane it stands on, what has the object's colours, and what all views agree to be one volume (Campbell,
//! Vogiatzis, Hernandez and Cipolla, *Automatic 3D object segmentation in multiple views using volumetric graph-cuts*,
//! 2010). A program that knows what objects look like needs one picture alone ([`masks_by_program`]).

mod all_views;
mod by_program;
mod color_model;
mod error;
mod evidence;
mod mask_command;
mod memory;
mod merge;
mod outline;
mod parts;
mod plane_sweep;
mod radiance;
mod second_way;
mod segment;
mod shrunk;
mod static_background;
mod support_colors;
mod support_plane;
mod two_ways;
mod volume;
mod within_cube;

pub use by_program::{ProgramMaskError, masks_by_program};
pub use error::SegmentationError;
pub use mask_command::{MaskCommand, MaskCommandError};
pub use memory::memory_estimate;
pub use segment::{Segmentation, Shown, Wanted, segment};
pub use support_plane::SupportPlane;

/// Photographs below which masks of an object are often wrong: neighbours are too far apart to be compared
/// (`docs/results/segmentation.md`, "Few photographs").
pub const FEW_PHOTOGRAPHS: usize = 18;

/// Half the edge of the cube that the object is looked for in, object units.
const HALF: f32 = 0.5;
