//! Masks of what a radiance field has in the object's cube.

use dvr_core::{Cancellation, Cancelled, Mask, View, signed_distance};
use glam::Vec3;
use rayon::prelude::*;

use super::fit::Fit;
use crate::HALF;
use crate::outline::{Edges, OUTLINE, drawn};
use crate::parts::join_parts;
use crate::shrunk::{Shrunk, WORKING_SIZE};
use crate::support_plane::{LYING, SupportPlane};
use crate::two_ways::TwoWays;
use crate::volume::{Cube, Round, Volume};

/// Longer side of the pictures that the volume is found from, and of those that outlines are drawn in, pixels.
const COARSE: u32 = 100;
const FINE: u32 = 400;

/// The volume.
const ROUND: Round = Round { nodes: 97, disagreeing: 0.12 };

/// What is less far before the support plane than this is not the object, object units.
const ON_SUPPORT: f32 = 0.006;

/// The object is not further from the volume's outline than this, pixels of a fine picture.
const NEAR: f32 = 6.0;

/// Shares of light that are nearer to 0 and 1 are no surer.
const SURE: f32 = 0.98;

/// Steps of the solver of outlines.
const OUTLINE_STEPS: usize = 60;

/// The object that a field has learned.
pub(crate) struct LearnedMasks<'a> {
    fit: &'a Fit<'a>,
    support: Option<SupportPlane>,
    volume: Volume,
    /// Coarse pictures of the views that are asked, and the share of the object in each pixel, by the numbers of the views.
    shown: Vec<(usize, Shrunk, Vec<f32>)>,
}

impl<'a> LearnedMasks<'a> {
    /// What the views that are asked agree about; `None` where that is nothing.
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn new(
        fit: &'a Fit<'a>,
        views: &[View],
        asked: &[bool],
        support: Option<SupportPlane>,
        cancellation: &Cancellation,
    ) -> Result<Option<Self>, Cancelled> {
        let shares = |(i, view)| {
            cancellation.check()?;
            let small = Shrunk::new(view, COARSE);
            let shares = object_shares(fit, &small, support, |_| true);
            Ok((i, small, shares))
        };
        let shown = views.par_iter().enumerate().filter(|(i, _)| asked[*i]).map(shares);
        let shown: Vec<(usize, Shrunk, Vec<f32>)> = shown.collect::<Result<_, Cancelled>>()?;
        let views: Vec<(&Shrunk, &[f32])> = shown.iter().map(|(_, view, shares)| (view, shares.as_slice())).collect();
        let is_allowed =
            |point: Vec3| point.abs().max_element() < HALF && support.is_none_or(|plane| plane.distance(point) > LYING);
        let agreed = |cube: Cube| Volume::agreed(&views, cube, ROUND, is_allowed, cancellation);
        let whole = agreed(Cube { origin: Vec3::ZERO, half: HALF })?;
        let Some(around) = whole.cube_around() else { return Ok(None) };
        let volume = agreed(around)?;
        Ok((!volume.is_empty()).then_some(Self { fit, support, volume, shown }))
    }

    /// What coarse pictures show, beside other masks.
    pub fn beside(&self, masks: &[Mask]) -> Vec<TwoWays<'_>> {
        let of_view = |(i, view, shares): &'_ (usize, Shrunk, Vec<f32>)| {
            let covered = self.volume.silhouette(view);
            let second = covered.iter().zip(shares).map(|(covered, share)| *covered && *share > 0.5).collect();
            (view.covered_by(&masks[*i]), second)
        };
        let ways = self.shown.par_iter().map(of_view).collect::<Vec<_>>();
        self.shown.iter().zip(ways).map(|((_, view, _), (first, second))| TwoWays { view, first, second }).collect()
    }

    /// The mask of a view: where the field has the object, up to the photograph's edges.
    pub fn mask(&self, view: &View) -> Mask {
        let fine = Shrunk::new(view, FINE);
        let covered = self.volume.silhouette(&fine);
        let distance = signed_distance(&covered, fine.width);
        let shares = object_shares(self.fit, &fine, self.support, |pixel| distance[pixel] > -NEAR);
        let price: Vec<f32> = (shares.iter().zip(&distance))
            .map(|(share, distance)| {
                let share = share.clamp(1.0 - SURE, SURE);
                if *distance > -NEAR { -(share / (1.0 - share)).ln() } else { 10.0 }
            })
            .collect();
        let scale = fine.width.max(fine.height) as f32 / WORKING_SIZE as f32;
        let mut belongs = Edges::new(&fine, OUTLINE * scale.max(1.0)).cut(&price, shares, OUTLINE_STEPS);
        join_parts(&mut belongs, |pixel| covered[pixel], fine.width);
        drawn(&belongs, &fine, view)
    }
}

/// The share of the light of each pixel that is `asked` for that comes from the object; 0 of others.
fn object_shares(fit: &Fit, view: &Shrunk, support: Option<SupportPlane>, asked: impl Fn(usize) -> bool) -> Vec<f32> {
    let is_object = |point: Vec3| {
        point.abs().max_element() < HALF && support.is_none_or(|plane| plane.distance(point) > ON_SUPPORT)
    };
    let mut lit = Vec::new();
    let share = |pixel| {
        if !asked(pixel) {
            return 0.0;
        }
        let direction = view.camera.direction_through(view.middle(pixel)).normalize();
        fit.field().object_share(view.camera.center, direction, &is_object, &mut lit)
    };
    (0..view.len()).map(share).collect()
}
