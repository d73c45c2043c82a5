//! Mask refinement: what a photograph shows better than its mask. Holes, bites, outlines drawn too tight or too wide.
//!
//! Programs that make masks leave holes in them. One hole in one of many views carves a tunnel through the visual hull.
//! What a mask leaves out shows the object's colours in the photograph and not the background's, wherever these can be
//! distinguished: a [`classifier`] of colours decides, [`holes`] gives back what is missing, [`rims`] takes away what is too
//! much.

mod classifier;
mod confirmation;
mod holes;
mod regions;
mod report;
mod rims;

use rayon::prelude::*;

pub use report::{MaskReport, RefinedView};

use crate::cancellation::Cancellation;
use crate::error::Result;
use crate::paged_images::PagedImages;
use crate::pixels::stored;
use crate::raster::Mask;
use crate::scene::{MaskSource, Scene, Split, View};

/// What is missing from fewer than this share of the masks must be confirmed by the others.
const COMMON: f64 = 0.5;

/// Coverage from which a pixel is the object's: see [`Mask::is_object`].
const OBJECT: u8 = 128;

/// What a photograph shows of its mask's mistakes, as indices of pixels, row by row.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Mistakes {
    /// Pixels of the object that the mask leaves out.
    missing: Vec<usize>,
    /// Pixels along the outline that show background; empty unless they go around most of it.
    rim: Vec<usize>,
}

/// Refines the masks of a scene where its photographs show, by their colours, that they are wrong: what they leave out
/// of the object is given back, rims of background are taken away.
///
/// Looked at are masks from files, in views for training and validation. A view's own alpha channel, or a mask made from
/// a plain background, knows no less than the colours; and views for testing stay as they are. Refined masks go into
/// [`View::refined_mask`]; [`View::mask`] is never changed. Where the pixels of the scene are paged from a scratch file,
/// those of refined masks are, too.
///
/// Pixels that a soft mask says to be mixed of both stay, unless pixels beside them are wrong that it is sure of. What fewer
/// than half of the masks leave out must be confirmed by the others: the rays of most of its pixels meet a place that all
/// other masks show as object.
///
/// Rims are taken away where half of the masks or more have one: what makes masks too wide does so everywhere, and in
/// single views the object's edges may look like the background.
///
/// # Errors
/// [`Error::Scratch`](crate::Error::Scratch) where the temporary folder has no room for the scratch file,
/// [`Error::Cancelled`](crate::Error::Cancelled) where somebody wanted it to end; the scene is then as it was.
pub fn refine_masks(scene: &mut Scene, cancellation: &Cancellation) -> Result<MaskReport> {
    let of_view = |view| cancellation.check().map(|()| mistakes_of_view(view));
    let mut mistakes: Vec<Option<Mistakes>> =
        scene.views.par_iter().map(of_view).collect::<std::result::Result<_, _>>()?;
    let looked_at = mistakes.iter().flatten().count();
    confirm_rare(scene, &mut mistakes, looked_at, cancellation)?;
    let with_rims = mistakes.iter().flatten().filter(|mistakes| !mistakes.rim.is_empty()).count();
    let takes_rims = rims::are_common(with_rims, looked_at);
    let is_paged = scene.views.iter().any(|view| view.image.as_raw().is_paged());
    let paged = PagedImages::new(is_paged.then_some(0));
    let refined = scene.views.par_iter_mut().zip(mistakes).map(|(view, mistakes)| {
        let Some(mut mistakes) = mistakes else { return Ok(None) };
        if !takes_rims {
            mistakes.rim.clear();
        }
        let refined = view.mask.as_ref().and_then(|mask| corrected(mask, &mistakes));
        view.refined_mask = refined.map(|mask| paged.keep_mask(mask)).transpose()?;
        Ok(view.refined_mask.is_some().then(|| RefinedView {
            name: view.name.clone(),
            given_back: mistakes.missing.len(),
            taken_away: mistakes.rim.len(),
        }))
    });
    let refined: Vec<Result<Option<RefinedView>>> = refined.collect();
    Ok(MaskReport { looked_at, refined: refined.into_iter().filter_map(Result::transpose).collect::<Result<_>>()? })
}

/// Drops what is missing from few of the masks by their photographs and that the other masks do not confirm.
///
/// What makes masks too tight or leaves holes in them does so in most of them, and then the others are no witnesses: they
/// lack the same. What shows in single views may as well be a place where the background looks like the object.
fn confirm_rare(
    scene: &Scene,
    mistakes: &mut [Option<Mistakes>],
    looked_at: usize,
    cancellation: &Cancellation,
) -> Result<()> {
    let lacking = mistakes.iter().flatten().filter(|mistakes| !mistakes.missing.is_empty()).count();
    if lacking as f64 >= COMMON * looked_at as f64 {
        return Ok(());
    }
    mistakes.par_iter_mut().enumerate().try_for_each(|(index, mistakes)| {
        cancellation.check()?;
        if let Some(mistakes) = mistakes.as_mut().filter(|mistakes| !mistakes.missing.is_empty()) {
            mistakes.missing = confirmation::confirmed(&scene.views, index, &mistakes.missing);
        }
        Ok(())
    })
}

/// The mistakes of a view's mask; `None` where it is not looked at.
fn mistakes_of_view(view: &View) -> Option<Mistakes> {
    let is_looked_at = view.mask_source == MaskSource::File && view.split != Split::Test;
    let mask = view.mask.as_ref().filter(|_| is_looked_at)?;
    let (width, height) = mask.size();
    let size = [width as usize, height as usize];
    let colors = view.image.as_raw().as_chunks().0;
    let mut object: Vec<bool> = mask.coverage.iter().map(|&coverage| coverage >= OBJECT).collect();
    let mixed: Vec<bool> = mask.coverage.iter().map(|coverage| (1..u8::MAX).contains(coverage)).collect();
    let missing = holes::missing_pixels(size, &object, &mixed, colors);
    missing.iter().for_each(|&pixel| object[pixel] = true);
    let background: Vec<bool> = object.iter().map(|&is_object| !is_object).collect();
    let rim = rims::rim_pixels(size, &background, &mixed, colors);
    Some(Mistakes { missing, rim })
}

/// The mask without its mistakes; `None` where it has none.
fn corrected(mask: &Mask, mistakes: &Mistakes) -> Option<Mask> {
    if mistakes.missing.is_empty() && mistakes.rim.is_empty() {
        return None;
    }
    let (width, height) = mask.size();
    let mut coverage = mask.coverage.as_raw().to_vec();
    mistakes.missing.iter().for_each(|&pixel| coverage[pixel] = u8::MAX);
    mistakes.rim.iter().for_each(|&pixel| coverage[pixel] = 0);
    image::GrayImage::from_raw(width, height, coverage).map(|coverage| Mask { coverage: stored(coverage) })
}

#[cfg(test)]
mod tests;
