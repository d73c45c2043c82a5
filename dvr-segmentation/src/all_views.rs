//! Work on all views, side by side.

use dvr_core::{Cancellation, Cancelled, Mask};
use rayon::prelude::*;

/// One mask for each view, side by side.
pub(crate) fn of_all_views(
    views: usize,
    cancellation: &Cancellation,
    advance: &(dyn Fn(usize) + Sync),
    mask: impl Fn(usize) -> Mask + Sync,
) -> Result<Vec<Mask>, Cancelled> {
    let of_view = |i: usize| {
        cancellation.check()?;
        let mask = mask(i);
        advance(1);
        Ok(mask)
    };
    (0..views).into_par_iter().map(of_view).collect()
}
