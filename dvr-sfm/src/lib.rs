//! Cameras of photographs that have none: structure from motion by COLMAP, which is run as a program; and surfaces of
//! point clouds ([`poisson_surface`]), by the screened Poisson reconstruction that COLMAP has. Clips are taken apart by
//! ffmpeg, and made by it ([`ClipEncoder`]).
//!
//! ```no_run
//! use dvr_sfm::{Source, SfmOptions, find_cameras};
//!
//! // Photographs of an object from all sides, or a clip; the result is a scene that `dvr_core::Scene::read` reads.
//! let source = Source::at("photos".as_ref())?.ok_or("there are no photographs")?;
//! let found = find_cameras(&source, "photos-cameras".as_ref(), &SfmOptions::default(), &mut |event| println!("{event:?}"))?;
//! println!("{} of {} pictures have a camera", found.placed, found.placed + found.not_placed.len());
//! let scene = dvr_core::Scene::read("photos-cameras/sparse/0")?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The steps are COLMAP's: features (SIFT), matching, mapping (Schoenberger and Frahm, *Structure-from-Motion Revisited*,
//! CVPR 2016), bundle adjustment and undistortion. A step that is finished is not made again: what was stopped goes on where it was. What
//! the installed version calls its options is read from its help. Where the pictures show an object on a turntable before a
//! room, matches of the room, which stands still, are left out before the mapping.
//!
//! The folder that is written holds `images/` (undistorted), `sparse/0/` (COLMAP's text files), `transforms.json` and
//! `points.ply` (nerfstudio), `masks/` where the photographs have masks, `sfm.json` (what was found) and `sfm.log` (all
//! that COLMAP said).

//!
//! Sets of photographs that show the object in different poses become one scene by [`join_sets`].

#![warn(missing_docs)]

mod child;
mod clip;
mod clip_encoder;
mod compare;
mod database;
mod engine;
mod error;
mod exif;
mod find;
mod joined;
mod masks;
mod options;
mod pictures;
mod poisson;
mod progress;
mod result;
mod source;
mod static_background;
mod steps;
mod workspace;

pub use clip_encoder::{ClipEncoder, ClipFormat};
pub use compare::CameraErrors;
pub use error::SfmError;
pub use find::find_cameras;
pub use joined::{PoseSet, join_sets};
pub use options::{CameraSharing, Event, Mapper, Matching, SfmOptions};
pub use poisson::{PoissonOptions, poisson_surface};
pub use result::{FoundCameras, PlacedSet};
pub use source::Source;
