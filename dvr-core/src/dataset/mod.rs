//! Scenes from disk: five layouts of posed photographs, one [`Scene`](crate::Scene).
//!
//! ```no_run
//! use dvr_core::dataset::{ReadOptions, read_scene};
//!
//! let scene = read_scene("photos/teapot".as_ref(), &ReadOptions::default())?;
//! println!("{}: {} views, {}", scene.name, scene.views.len(), scene.format);
//! for warning in &scene.warnings {
//!     println!("note: {warning}");
//! }
//! # Ok::<(), dvr_core::Error>(())
//! ```
//!
//! A reader turns its files into a list of views with projection matrices, and what is peculiar to its layout (axes,
//! pixel centres, units) ends there. Reading pixels, finding the object and moving it into the unit cube is the same
//! for all.
//!
//! Masks stay as the files have them, and a view may have none: see [`refine_masks`](crate::refine_masks) and
//! [`Scene::require_masks`](crate::Scene::require_masks).

mod crop;
mod digest;
mod file_pixels;
mod input_picture;
mod layouts;
mod load;
mod masks;
mod matrices;
mod object_dataset;
mod object_files;
mod object_space;
mod objects;
mod options;
mod pairing;
mod points_file;
mod raw_scene;
mod read;
mod region_of_interest;
mod write_transforms;

pub use crop::square_around;
pub use digest::digest_of_scene;
pub use file_pixels::{PlacesInView, places_in_view};
pub use input_picture::{InputPicture, input_picture};
pub use layouts::{ColmapModel, PosedPicture, detect_format, is_object_dataset, read_colmap_model};
pub use masks::{MASK_FOLDERS, find_masks, mask_from_background};
pub use object_dataset::{ObjectDataset, ObjectOptions};
pub use objects::{ObjectRef, list_objects};
pub use options::{Background, BackgroundColor, Format, Normalise, ReadOptions};
pub use pairing::{list_pictures, natural_order};
pub use read::read_scene;
pub use write_transforms::write_transforms;

#[cfg(test)]
mod tests;
