//! Outlines that were found in two ways: how alike they are, and which the support plane speaks for.

use dvr_core::{Cancellation, Cancelled};
use rayon::prelude::*;

use crate::color_model::{ColorCounts, ObjectColors};
use crate::merge::wide;
use crate::shrunk::Shrunk;
use crate::support_colors::SupportColors;
use crate::support_plane::SupportPlane;

/// The least that the colour of a pixel must say for either, as a logarithm.
const SAYS: f32 = 1.5;

/// How many times as many pixels must speak for one way as for the other.
const TIMES: usize = 2;

/// The share of the pixels that differ that must say something.
const LEAST: f64 = 0.05;

/// What two ways take for the object in a view.
pub(crate) struct TwoWays<'a> {
    pub view: &'a Shrunk,
    /// Per pixel of the view.
    pub first: Vec<bool>,
    pub second: Vec<bool>,
}

/// Which of two ways is nearer to the truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Nearer {
    First,
    Second,
    Unknown,
}

/// The mean overlap, intersection over union.
pub(crate) fn overlap(views: &[TwoWays]) -> f64 {
    let of_view = |TwoWays { first, second, .. }: &TwoWays| {
        let pixels = || first.iter().zip(second);
        let both = pixels().filter(|(first, second)| **first && **second).count();
        let either = pixels().filter(|(first, second)| **first || **second).count();
        both as f64 / either.max(1) as f64
    };
    views.iter().map(of_view).sum::<f64>() / views.len().max(1) as f64
}

/// Which way the plane that the object stands on speaks for, where both differ by more than a rim. What the plane looks like is
/// known from other views that see it, place by place: a pixel that looks otherwise shows the object, and one that looks like
/// it does not.
///
/// # Errors
/// [`Cancelled`] where somebody wants it to end.
pub(crate) fn nearer(views: &[TwoWays], plane: SupportPlane, cancellation: &Cancellation) -> Result<Nearer, Cancelled> {
    // Neither way is asked alone: the plane is what both take for background, the object what both take for it.
    let share = |of: fn(bool, bool) -> bool| {
        let of_view = |TwoWays { first, second, .. }: &TwoWays| {
            first.iter().zip(second).map(|(first, second)| f32::from(u8::from(of(*first, *second)))).collect()
        };
        views.iter().map(of_view).collect::<Vec<Vec<f32>>>()
    };
    let (either, both) = (share(|first, second| first || second), share(|first, second| first && second));
    let seen: Vec<(&Shrunk, &[f32])> = views.iter().zip(&either).map(|(two, either)| (two.view, &either[..])).collect();
    let plane = SupportColors::new(plane, &seen, cancellation)?;
    let mut counts = ColorCounts::none();
    for (two, both) in views.iter().zip(&both) {
        let [object, _] = ColorCounts::of(two.view, both, &vec![0.0; both.len()]);
        counts.join(&object, 1.0);
    }
    let object = ObjectColors::new(&counts);
    let votes = |TwoWays { view, first, second }: &TwoWays| {
        let mut votes = [0usize; 3];
        let differs: Vec<bool> = first.iter().zip(second).map(|(first, second)| first != second).collect();
        let wide = wide(&differs, view.width);
        for pixel in (0..differs.len()).filter(|&pixel| differs[pixel] && wide[pixel]) {
            let color = view.colors[pixel];
            let says = plane.density(&view.camera, view.middle(pixel), color);
            let says = says.map_or(0.0, |density| object.says(color, density));
            let vote = if says.abs() < SAYS { 2 } else { usize::from(first[pixel] != (says > 0.0)) };
            votes[vote] += 1;
        }
        votes
    };
    let add = |a: [usize; 3], b: [usize; 3]| std::array::from_fn(|i| a[i] + b[i]);
    let [first, second, unknown] = views.par_iter().map(votes).reduce(|| [0; 3], add);
    let is_told = (first + second) as f64 >= LEAST * (first + second + unknown) as f64;
    Ok(match (is_told && first > TIMES * second, is_told && second > TIMES * first) {
        (true, _) => Nearer::First,
        (_, true) => Nearer::Second,
        _ => Nearer::Unknown,
    })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::support_colors::tests::{BALL, view};

    #[test]
    fn the_plane_speaks_for_what_looks_unlike_it() {
        let views: Vec<(Shrunk, Vec<f32>)> = (0..12).map(view).collect();
        let plane = SupportPlane { normal: Vec3::Z, offset: -BALL };
        let verdict = |second: &dyn Fn(&Shrunk, usize, bool) -> bool| {
            let ways = |swap: bool| {
                let of_view = |(view, belongs): &'_ (Shrunk, Vec<f32>)| {
                    let right: Vec<bool> = belongs.iter().map(|belongs| *belongs > 0.0).collect();
                    let wrong = (0..view.len()).map(|pixel| second(view, pixel, right[pixel])).collect();
                    if swap { (wrong, right) } else { (right, wrong) }
                };
                let two = views.iter().map(|view| (&view.0, of_view(view)));
                two.map(|(view, (first, second))| TwoWays { view, first, second }).collect::<Vec<_>>()
            };
            [false, true].map(|swap| nearer(&ways(swap), plane, &Cancellation::default()).unwrap())
        };
        // The left half of the ball is lost.
        let half = |view: &Shrunk, pixel: usize, right: bool| right && pixel % view.width > view.width / 2;
        assert_eq!(verdict(&half), [Nearer::First, Nearer::Second]);
        // A part of the table is too much.
        let corner = |view: &Shrunk, pixel: usize, right: bool| right || pixel / view.width > view.height * 4 / 5;
        assert_eq!(verdict(&corner), [Nearer::First, Nearer::Second]);
        // What is beyond the table's edge is unknown, and so is a rim.
        let far = |view: &Shrunk, pixel: usize, right: bool| right || pixel / view.width < view.height / 8;
        assert_eq!(verdict(&far), [Nearer::Unknown; 2]);
        let rim = |view: &Shrunk, pixel: usize, right: bool| right || (pixel % view.width == view.width / 2);
        assert_eq!(verdict(&rim), [Nearer::Unknown; 2]);
        assert_eq!(verdict(&|_, _, right| right), [Nearer::Unknown; 2]);
    }

    #[test]
    fn an_overlap_is_what_both_have_of_what_either_has() {
        let views: Vec<(Shrunk, Vec<f32>)> = (0..2).map(view).collect();
        let ways = |second: &dyn Fn(usize) -> bool| {
            let of_view = |(view, _): &'_ (Shrunk, Vec<f32>)| {
                let (first, second) = ((0..view.len()).map(|p| p < 300), (0..view.len()).map(second));
                (first.collect::<Vec<_>>(), second.collect::<Vec<_>>())
            };
            let two = views.iter().map(|view| (&view.0, of_view(view)));
            overlap(&two.map(|(view, (first, second))| TwoWays { view, first, second }).collect::<Vec<_>>())
        };
        assert_eq!(ways(&|pixel| pixel < 300), 1.0);
        assert_eq!(ways(&|pixel| (150..300).contains(&pixel)), 0.5);
        assert_eq!(ways(&|pixel| (200..600).contains(&pixel)), 100.0 / 600.0);
        assert_eq!(ways(&|pixel| pixel > 1000), 0.0);
    }
}
