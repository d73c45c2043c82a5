//! Where masks come from: a folder of masks, the alpha channel, or a plain background.

use std::path::{Path, PathBuf};

use image::{GrayImage, Luma, RgbImage, imageops};

use super::options::{Background, BackgroundColor};
use super::pairing::{partners, pictures, sub_folder};
use crate::error::{Error, Result};
use crate::files::read_mask;
use crate::raster::Mask;

/// Names that a folder of masks may have, in lower case.
pub const MASK_FOLDERS: [&str; 4] = ["mask", "masks", "silhouette", "silhouettes"];

/// The mask file of each image, where `root` has a folder of masks (`mask`, `masks`, `silhouette` or `silhouettes`).
/// Images are given relative to their own folder.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) where the folder cannot be listed.
pub fn find_masks(root: &Path, images: &[PathBuf]) -> Result<Vec<Option<PathBuf>>> {
    match sub_folder(root, &MASK_FOLDERS) {
        Some(folder) => partners(images, &folder, pictures()),
        None => Ok(vec![None; images.len()]),
    }
}

/// The mask of a view in a folder of masks by names of views, at the size of its picture; `None` where it has none.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) where the folder is missing, [`Error::Format`](crate::Error::Format) where the mask is damaged.
pub(super) fn mask_of_view(folder: &Path, view: &str, (width, height): (u32, u32)) -> Result<Option<Mask>> {
    std::fs::read_dir(folder).map_err(|source| Error::io(folder, source))?;
    let path = folder.join(format!("{view}.png"));
    if !path.exists() {
        return Ok(None);
    }
    let mask = read_mask(&path)?;
    if mask.size() == (width, height) {
        return Ok(Some(mask));
    }
    let coverage = imageops::resize(&mask.coverage, width, height, imageops::FilterType::Triangle);
    Ok(Some(Mask::from(coverage)))
}

/// Marks the pixels that differ from a plain background. Parts of the object in the colour of the background, and
/// shadows, come out wrong: real masks are better.
pub fn mask_from_background(image: &RgbImage, background: Background) -> Mask {
    let plain = match background.color {
        BackgroundColor::White => [255; 3],
        BackgroundColor::Black => [0; 3],
        BackgroundColor::Border => border_color(image),
    };
    let differs = |pixel: &image::Rgb<u8>| {
        pixel.0.iter().zip(&plain).any(|(&channel, &plain)| channel.abs_diff(plain) > background.threshold)
    };
    let coverage = GrayImage::from_fn(image.width(), image.height(), |u, v| {
        Luma([if differs(image.get_pixel(u, v)) { 255 } else { 0 }])
    });
    Mask::from(coverage)
}

/// The median of the outermost pixels, channel by channel.
fn border_color(image: &RgbImage) -> [u8; 3] {
    let (width, height) = image.dimensions();
    let border: Vec<_> = image
        .enumerate_pixels()
        .filter(|(u, v, _)| *u == 0 || *v == 0 || *u + 1 == width || *v + 1 == height)
        .map(|(_, _, pixel)| pixel.0)
        .collect();
    [0, 1, 2].map(|channel| {
        let mut values: Vec<u8> = border.iter().map(|pixel| pixel[channel]).collect();
        values.sort_unstable();
        values.get(values.len() / 2).copied().unwrap_or_default()
    })
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn a_plain_background_is_told_from_the_object() {
        let inside = |u: u32, v: u32| (3..6).contains(&u) && (2..8).contains(&v);
        for (color, plain) in [
            (BackgroundColor::White, [255, 255, 250]),
            (BackgroundColor::Black, [4, 0, 0]),
            (BackgroundColor::Border, [40, 120, 60]),
        ] {
            let image = RgbImage::from_fn(9, 10, |u, v| {
                let noise = ((u * 7 + v * 3) % 5) as u8;
                Rgb(if inside(u, v) { [90, 30, 140] } else { plain.map(|c: u8| c.saturating_add(noise)) })
            });
            let mask = mask_from_background(&image, Background::of(color));
            for (u, v, _) in image.enumerate_pixels() {
                assert_eq!(mask.is_object(u, v), inside(u, v), "{color:?} at {u}, {v}");
            }
        }
    }
}
