//! Pixels of the picture files, as they are stored, in the views that were made of them.

use std::path::Path;

use glam::DVec2;

use super::layouts::{detect_format, find_views};
use super::load::{is_mirrored, lens_error, select_views};
use super::options::ReadOptions;
use super::raw_scene::{RawScene, RawView};
use crate::error::{Error, Result};
use crate::files::image_size;

/// Where a view shows what some pixels of its picture file show.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacesInView {
    /// The view's name.
    pub view: String,
    /// Pixels of the view, from the top left corner of its picture.
    pub places: Vec<DVec2>,
}

/// Finds the view of a picture, by its own name or by that of its file with or without the ending, and where the view shows
/// the given pixels of the file: what undistortion, flipping and [`ReadOptions::downscale`] make of them. `pixels` are counted
/// from the top left corner of the file's picture, whose first pixel has its centre at (0.5, 0.5). No pixel is read.
///
/// # Errors
/// [`Error::UnknownView`] where no view is of that picture, or several are, [`Error::Format`] where a pixel is outside of it or its lens shows
/// nothing there, and those of finding the views.
pub fn places_in_view(path: &Path, options: &ReadOptions, picture: &str, pixels: &[DVec2]) -> Result<PlacesInView> {
    let format = options.format.map_or_else(|| detect_format(path), Ok)?;
    let mut raw = find_views(format, path, options)?;
    select_views(&mut raw, options)?;
    places_in(&raw, options.downscale, picture, pixels)
}

fn places_in(raw: &RawScene, downscale: u32, picture: &str, pixels: &[DVec2]) -> Result<PlacesInView> {
    let of_file = |path: &Path| [path.file_name(), path.file_stem()].into_iter().flatten().any(|name| name == picture);
    let by_name = raw.views.iter().find(|view| view.name == picture);
    let by_file: Vec<&RawView> = raw.views.iter().filter(|view| of_file(&view.image)).collect();
    let only = by_file.first().copied().filter(|_| by_file.len() == 1);
    let view = by_name.or(only).ok_or_else(|| {
        // There is none, or files of one name lie in several folders.
        let known = if by_file.is_empty() { raw.views.iter().collect() } else { by_file };
        Error::UnknownView { name: picture.to_owned(), known: known.iter().map(|view| view.name.clone()).collect() }
    })?;
    let (width, height) = image_size(&view.image)?;
    let lens = view.lens.as_ref().map(|lens| lens.resized(width, height));
    let undistorted = lens.as_ref().map(|lens| Ok((lens, lens.undistortion()?.intrinsics()))).transpose();
    let undistorted = undistorted.map_err(|problem| lens_error(&raw.cameras, &view.name, &problem))?;
    let mirrored = is_mirrored(raw, view);
    let place = |pixel: &DVec2| {
        let problem = |what: &str| {
            let (x, y) = (pixel.x - 0.5, pixel.y - 0.5);
            let problem = format!("pixel ({x}, {y}) {what} the picture, which has {width}x{height} pixels");
            Error::format(&view.image, problem, "Count from (0, 0), the pixel in the top left corner of the file.")
        };
        let size = DVec2::new(f64::from(width), f64::from(height));
        if !(pixel.cmpge(DVec2::ZERO).all() && pixel.cmple(size).all()) {
            return Err(problem("lies outside of"));
        }
        let mut place = *pixel;
        if mirrored {
            place.x = size.x - place.x;
        }
        if let Some((lens, intrinsics)) = &undistorted {
            let direction = lens.direction_of(place).ok_or_else(|| problem("is one that the lens does not show of"))?;
            place = (*intrinsics * direction.extend(1.0)).truncate();
        }
        Ok(place / f64::from(downscale.max(1)))
    };
    Ok(PlacesInView { view: view.name.clone(), places: pixels.iter().map(place).collect::<Result<_>>()? })
}
