//! From files to pixels: pictures, masks, depth maps and cameras of all views, side by side.

use std::path::Path;

use glam::{DMat3, DVec3};
use image::imageops;
use rayon::prelude::*;

use super::masks::{mask_from_background, mask_of_view};
use super::options::ReadOptions;
use super::raw_scene::{Coordinates, ObjectBounds, Projection, RawScene, RawView};
use crate::downscale::{downscale_camera, downscale_depth, downscale_image, downscale_mask};
use crate::error::{Error, LensError, Result};
use crate::files::{Photo, image_size, read_depth_exr, read_mask, read_photo};
use crate::machine_memory::available_memory;
use crate::number_range::OutOfRange;
use crate::paged_images::PagedImages;
use crate::pixels::stored;
use crate::raster::{DepthMap, Mask};
use crate::scene::{MaskSource, Split, View};
use crate::view_split::{ViewNames, abbreviated};

/// Drops the views that `options` leaves out, and renumbers the visibility of sparse points.
///
/// # Errors
/// [`Error::UnknownView`] where a view to leave out does not exist, [`Error::TooFewViews`] where fewer than two are left.
pub(super) fn select_views(raw: &mut RawScene, options: &ReadOptions) -> Result<()> {
    let keep = match &options.known_views {
        Some(known) => keep_known(raw, options, known),
        None => keep_chosen(raw, options)?,
    };
    let new_index: Vec<Option<usize>> =
        keep.iter().scan(0, |next, &keep| Some(keep.then(|| std::mem::replace(next, *next + 1)))).collect();
    let mut kept = keep.iter();
    raw.views.retain(|_| kept.next().copied().unwrap_or(true));
    if let Some(sparse) = &mut raw.sparse_points {
        for (point, views) in sparse.visible_in.iter_mut().enumerate() {
            if let Some(bearings) = sparse.bearings.as_mut().and_then(|all| all.get_mut(point)) {
                let mut views = views.iter();
                bearings.retain(|_| views.next().is_some_and(|&view| new_index[view].is_some()));
            }
            *views = views.iter().filter_map(|&view| new_index[view]).collect();
        }
    }
    if raw.views.len() < 2 {
        let (scene, left) = (raw.root.display().to_string(), raw.views.len());
        return Err(Error::TooFewViews { scene, left, all: keep.len(), purpose: "to read" });
    }
    Ok(())
}

/// Which views were read before; warns of those that came since then.
fn keep_known(raw: &mut RawScene, options: &ReadOptions, known: &ViewNames) -> Vec<bool> {
    let keep: Vec<bool> = raw.views.iter().map(|view| known.all().any(|name| name == view.name)).collect();
    let is_ignored = |i: usize, name: &String| {
        options.ignored_views.iter().any(|ignored| ignored == name || ignored.parse() == Ok(i))
    };
    let others = raw.views.iter().enumerate().filter(|&(i, view)| !keep[i] && !is_ignored(i, &view.name));
    let new: Vec<String> = others.map(|(_, view)| view.name.clone()).collect();
    // Of a number of views that was asked for, the others are no news.
    if !new.is_empty() && options.n_views.is_none() {
        raw.warnings.push(format!(
            "views that came after the run began are left out ({}): {}",
            new.len(),
            abbreviated(&new)
        ));
    }
    keep
}

/// Which views `options` choose.
fn keep_chosen(raw: &RawScene, options: &ReadOptions) -> Result<Vec<bool>> {
    let mut keep = vec![true; raw.views.len()];
    for ignored in &options.ignored_views {
        let by_name = raw.views.iter().position(|view| &view.name == ignored);
        let by_number = || ignored.parse::<usize>().ok().filter(|&index| index < keep.len());
        let index = by_name.or_else(by_number).ok_or_else(|| {
            let known = raw.views.iter().map(|view| view.name.clone()).collect();
            Error::UnknownView { name: ignored.clone(), known }
        })?;
        keep[index] = false;
    }
    if let Some(n_views) = options.n_views {
        let train: Vec<usize> = (0..keep.len()).filter(|&i| keep[i] && raw.views[i].split == Split::Train).collect();
        if n_views < train.len() {
            train.iter().for_each(|&i| keep[i] = false);
            // The middle of each of n equal parts of the list.
            (0..n_views).for_each(|i| keep[train[(2 * i + 1) * train.len() / (2 * n_views)]] = true);
        }
    }
    Ok(keep)
}

/// Reads all views, in the files' space, with depth in its units; pixels beyond the memory that `options` allow lie in
/// a scratch file.
///
/// # Errors
/// Those of the view that comes first: a file missing or damaged, sizes that differ, an unusable camera, no
/// room for the scratch file.
pub(super) fn load_views(raw: &mut RawScene, options: &ReadOptions) -> Result<Vec<View>> {
    if options.downscale == 0 {
        return Err(OutOfRange::new("downscale", 0, "at least 1, which keeps the size").into());
    }
    check_room(raw, options)?;
    let mirrored = |view: &RawView| is_mirrored(raw, view);
    // A view is put away by the thread that decoded it, so no more are decoded at a time than there are threads.
    let paged = PagedImages::new(options.max_memory);
    let load = |found_view| {
        options.cancellation.check()?;
        paged.keep_view(load_view(found_view, mirrored(found_view), &raw.cameras, options)?)
    };
    let loaded: Vec<Result<View>> = raw.views.par_iter().map(load).collect();
    let n_mirrored = raw.views.iter().filter(|view| is_mirrored(raw, view)).count();
    if n_mirrored > 0 {
        raw.warnings.push(format!(
            "the cameras of {n_mirrored} of {} views make mirror images; the pictures are flipped left to right",
            raw.views.len()
        ));
    }
    loaded.into_iter().collect()
}

/// Whether the camera of a view makes mirror images, so that its picture is flipped left to right.
pub(super) fn is_mirrored(raw: &RawScene, view: &RawView) -> bool {
    let center = match raw.object_bounds {
        ObjectBounds::UnitCube => Some(DVec3::ZERO),
        ObjectBounds::Bound(bound) => Some(bound.translation),
        ObjectBounds::Unknown => None,
    };
    center.is_some_and(|center| view.projection.mirrors(center))
}

/// Refuses photographs that, all in memory, would take more than the machine has.
///
/// # Errors
/// [`Error::PhotographMemory`] with what they take and what there is.
fn check_room(raw: &RawScene, options: &ReadOptions) -> Result<()> {
    let Some(available) = available_memory().filter(|_| options.max_memory.is_none()) else { return Ok(()) };
    let area = u64::from(options.downscale).pow(2);
    // A file whose size cannot be read is named when it is decoded.
    let bytes = |view: &RawView| {
        let (width, height) = image_size(&view.image).unwrap_or_default();
        let of_pixel = PHOTOGRAPH_PIXEL + if view.depth.is_some() { DEPTH_PIXEL } else { 0 };
        u64::from(width) * u64::from(height) / area * of_pixel
    };
    let bytes = raw.views.iter().map(bytes).sum();
    if bytes > available { Err(Error::PhotographMemory { bytes, available }) } else { Ok(()) }
}

/// Bytes of a decoded pixel with its mask, and of a pixel's depth.
const PHOTOGRAPH_PIXEL: u64 = 4;
const DEPTH_PIXEL: u64 = 4;

/// Reads one view, in the files' space, with depth in its units; `cameras` is the file to name where its camera is
/// unusable.
///
/// # Errors
/// As [`load_views`].
pub(super) fn load_view(view: &RawView, mirrored: bool, cameras: &Path, options: &ReadOptions) -> Result<View> {
    let Photo { mut image, mut alpha } = read_photo(&view.image)?;
    let (width, height) = image.dimensions();
    let (mut mask, mask_source) = match (options.background, &view.mask, &alpha) {
        (Some(background), _, _) => (Some(mask_from_background(&image, background)), MaskSource::Background),
        (None, _, _) if options.masks.is_some() => (None, MaskSource::File),
        (None, Some(path), alpha) => {
            let mask = read_mask(path)?;
            let source = if repeats(&mask, alpha.as_ref()) { MaskSource::Alpha } else { MaskSource::File };
            (Some(mask), source)
        }
        (None, None, Some(alpha)) => (Some(alpha.clone()), MaskSource::Alpha),
        (None, None, None) => (None, MaskSource::default()),
    };
    let mut depth = view.depth.as_ref().map(|path| read_depth_exr(path)).transpose()?;
    let same_size = |path: &Path, what: &str, size: (u32, u32)| {
        if size == (width, height) {
            return Ok(());
        }
        Err(Error::format(
            path,
            format!("the {what} has {}x{} pixels, its picture {width}x{height}", size.0, size.1),
            format!("Make both the same size (the picture is {}).", view.image.display()),
        ))
    };
    if let Some(mask) = &mask {
        same_size(view.mask.as_ref().unwrap_or(&view.image), "mask", mask.size())?;
    }
    if let (Some(path), Some(depth)) = (&view.depth, &depth) {
        same_size(path, "depth map", (depth.width, depth.height))?;
    }
    let mut projection = view.projection;
    if mirrored {
        imageops::flip_horizontal_in_place(&mut image);
        for mask in mask.iter_mut().chain(&mut alpha) {
            imageops::flip_horizontal_in_place(&mut mask.coverage);
        }
        depth.iter_mut().for_each(flip_depth);
        projection = flip_projection(projection, width);
    }
    let unusable =
        |source| Error::UnusableCamera { path: cameras.to_owned(), what: format!("view `{}`: ", view.name), source };
    let mut camera = projection.camera(width, height).map_err(unusable)?;
    if let Some(lens) = &view.lens {
        let undistortion = lens.resized(width, height).undistortion();
        let undistortion = undistortion.map_err(|source| lens_error(cameras, &view.name, &source))?;
        image = undistortion.picture(&image);
        for mask in mask.iter_mut().chain(&mut alpha) {
            *mask = undistortion.mask(mask);
        }
        camera = undistortion.camera(&camera);
    }
    // The files' depth is the third coordinate of their projection, in units of its third row.
    depth = depth.map(|depth| depth.scaled(projection.depth_units().recip() as f32));
    let factor = options.downscale;
    if factor > 1 {
        if width < factor || height < factor {
            return Err(Error::format(
                &view.image,
                format!("{width}x{height} pixels cannot be scaled down by {factor}"),
                "Use a smaller factor.",
            ));
        }
        image = downscale_image(&image, alpha.as_ref(), factor);
        mask = mask.map(|mask| downscale_mask(&mask, factor));
        depth = depth.map(|depth| downscale_depth(&depth, factor));
        camera = downscale_camera(&camera, factor);
    }
    if let (None, Some(folder)) = (options.background, &options.masks) {
        mask = mask_of_view(folder, &view.name, image.dimensions())?;
    }
    let split = view.split;
    Ok(View { depth, split, mask_source, ..View::new(view.name.as_str(), camera, stored(image), mask) })
}

/// A lens that nothing can be made of, named by its view.
pub(super) fn lens_error(cameras: &Path, view: &str, problem: &LensError) -> Error {
    Error::format(
        cameras,
        format!("view `{view}`: {problem}"),
        "Calibrate the cameras again, or undistort the pictures by another program.",
    )
}

/// Whether a mask says of every pixel what the photograph's own alpha channel says.
fn repeats(mask: &Mask, alpha: Option<&Mask>) -> bool {
    alpha.is_some_and(|alpha| {
        let same = |(a, b): (&u8, &u8)| (*a >= 128) == (*b >= 128);
        mask.size() == alpha.size() && mask.coverage.iter().zip(alpha.coverage.iter()).all(same)
    })
}

fn flip_depth(depth: &mut DepthMap) {
    depth.z_depth.chunks_mut(depth.width.max(1) as usize).for_each(<[f32]>::reverse);
}

/// The projection to the picture flipped left to right.
fn flip_projection(projection: Projection, width: u32) -> Projection {
    let last = match projection.coordinates {
        Coordinates::Normalised => 0.0,
        Coordinates::Pixels(size) => f64::from(size.map_or(width, |(width, _)| width)),
    };
    projection.then(DMat3::from_cols(DVec3::new(-1.0, 0.0, 0.0), DVec3::Y, DVec3::new(last, 0.0, 1.0)))
}

/// Refuses a scene whose masks show no object; warns of views without a mask, and of masks that show no object or
/// nothing else.
///
/// # Errors
/// [`Error::MasksEmpty`] where there are masks and all are empty.
pub(super) fn check_masks(raw: &mut RawScene, views: &[View]) -> Result<()> {
    let named = |test: &dyn Fn(&Mask) -> bool| -> Vec<&str> {
        let tested = views.iter().filter(|view| view.mask.as_ref().is_some_and(test));
        tested.map(|view| view.name.as_str()).collect()
    };
    let empty = named(&|mask| mask.object_pixels() == 0);
    let masks = views.iter().filter(|view| view.mask.is_some()).count();
    if masks > 0 && empty.len() == masks {
        return Err(Error::MasksEmpty { path: raw.root.clone(), masks });
    }
    if masks < views.len() {
        raw.warnings.push(format!("{} of {} views have no mask", views.len() - masks, views.len()));
    }
    let full = named(&|mask| mask.object_pixels() == mask.coverage.len());
    for (names, what) in [(empty, "marks no object"), (full, "marks every pixel as object")] {
        if let Some(first) = names.first() {
            let others = if names.len() > 1 { format!(" (and {} more)", names.len() - 1) } else { String::new() };
            raw.warnings.push(format!("the mask of view `{first}`{others} {what}"));
        }
    }
    Ok(())
}
