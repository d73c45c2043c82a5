//! Masks of photographs as masks of the undistorted pictures.

use std::path::Path;

use dvr_core::Cancellation;
use dvr_core::dataset::ColmapModel;
use dvr_core::files::{read_mask, write_gray_png};
use dvr_core::lens::Undistortion;
use rayon::prelude::*;

use crate::error::Result;
use crate::pictures::{Prepared, make_folder_of};

/// Writes the mask of every placed picture that has one to `target`, by the lens of the `distorted` model and the pinhole
/// of the `undistorted` one; gives their names.
pub(crate) fn undistort_masks(
    pictures: &[Prepared],
    distorted: &ColmapModel,
    undistorted: &ColmapModel,
    source: &Path,
    target: &Path,
    cancellation: &Cancellation,
) -> Result<Vec<String>> {
    let one = |picture: &Prepared| -> Result<Option<String>> {
        cancellation.check()?;
        let find = |model: &ColmapModel| model.pictures.iter().position(|posed| posed.name == picture.name);
        let (Some(mask), Some(before), Some(after)) = (&picture.mask, find(distorted), find(undistorted)) else {
            return Ok(None);
        };
        let (lens, camera) = (distorted.pictures[before].lens.clone(), &undistorted.pictures[after].camera);
        let file = target.join(mask);
        make_folder_of(&file)?;
        let mask_file = read_mask(&source.join(mask))?;
        write_gray_png(&file, &Undistortion::onto(lens, camera).mask(&mask_file).coverage)?;
        Ok(Some(mask.clone()))
    };
    let names: Vec<Option<String>> = pictures.par_iter().map(one).collect::<Result<_>>()?;
    Ok(names.into_iter().flatten().collect())
}
