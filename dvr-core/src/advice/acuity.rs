//! How fine what a picture shows of the object is, whatever it shows: contrast of fine over that of coarse squares.
//!
//! The Laplacian's variance depends on what is in the picture: a plain side has little of it. So its parts, the second
//! differences along four directions, are divided by those of squares eight times as large in the same place. Texture
//! and edges of any contrast have about the same ratio while they are sharp; what is out of focus loses the fine part
//! along all directions, and what a camera that shook has smeared, along one.

use rayon::prelude::*;

use crate::cancellation::{Cancellation, Cancelled};
use crate::scene::{Scene, View};
use crate::sharpness::LumaSums;

/// Edge of the object, in fine squares, that pictures are looked at with: as the photographs of a mesh's details are.
const OBJECT: f64 = 400.0;

/// Fine squares along the edge of a coarse one.
const COARSE: usize = 8;

/// Fewer coarse squares tell nothing.
const FEWEST: usize = 24;

/// Directions of second differences, in squares to the right and down.
pub(super) const DIRECTIONS: [[isize; 2]; 4] = [[1, 0], [0, 1], [1, 1], [1, -1]];

/// Root mean square of the coarse second differences, in levels of 255, below which there is nothing but rounding.
const FAINTEST: f64 = 1.5;

/// Fine over coarse mean squares of second differences, along [`DIRECTIONS`].
pub(super) type Ratios = [f64; DIRECTIONS.len()];

/// What a picture shows of the object.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Acuity {
    /// Within its outline; `None` where it is too small or plain.
    pub inside: Option<Ratios>,
    /// Along its outline, to both sides; `None` without a mask, too.
    pub outline: Option<Ratios>,
}

/// Of all views, at one scale.
pub(super) fn of_views(scene: &Scene, cancellation: &Cancellation) -> Result<Vec<Acuity>, Cancelled> {
    let windows: Vec<Option<Window>> = scene.views.par_iter().map(|view| Window::around_object(scene, view)).collect();
    let mut edges: Vec<f64> = windows.iter().flatten().map(|window| (window.pixels as f64).sqrt()).collect();
    edges.sort_by(f64::total_cmp);
    let median = edges.get(edges.len() / 2).copied().unwrap_or(0.0);
    let edge = (median / OBJECT).round().max(1.0) as usize;
    let of_view = |(view, window): (&View, &Option<Window>)| {
        cancellation.check()?;
        Ok(window.as_ref().map_or(Acuity::default(), |window| acuity(view, window, edge)))
    };
    scene.views.par_iter().zip(&windows).map(of_view).collect()
}

/// Where the object is in a picture: columns and rows from, to (excluded).
struct Window {
    from: [usize; 2],
    to: [usize; 2],
    /// Pixels of the object.
    pixels: usize,
}

impl Window {
    /// Around the mask; without one, around the region of interest. `None` where that is out of the picture.
    fn around_object(scene: &Scene, view: &View) -> Option<Self> {
        let (width, height) = view.image.dimensions();
        let Some(mask) = view.training_mask() else {
            return Self::around_region(scene, view);
        };
        let mut found = Self { from: [usize::MAX; 2], to: [0; 2], pixels: 0 };
        for (v, row) in mask.coverage.as_raw().chunks_exact(width.max(1) as usize).take(height as usize).enumerate() {
            let Some(first) = row.iter().position(|&coverage| coverage >= 128) else { continue };
            let last = row.iter().rposition(|&coverage| coverage >= 128).unwrap_or(first);
            found.from = [found.from[0].min(first), found.from[1].min(v)];
            found.to = [found.to[0].max(last + 1), v + 1];
            found.pixels += row.iter().filter(|&&coverage| coverage >= 128).count();
        }
        (found.pixels > 0).then_some(found)
    }

    fn around_region(scene: &Scene, view: &View) -> Option<Self> {
        let bounds = scene.region.bounds;
        let frame = [view.camera.width, view.camera.height].map(f64::from);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in 0..8 {
            let part = |axis: usize| if corner >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
            let (pixel, depth) = view.camera.project(glam::DVec3::from_array([0, 1, 2].map(part)));
            if depth <= 0.0 {
                return None;
            }
            for axis in 0..2 {
                low[axis] = low[axis].min(pixel[axis].clamp(0.0, frame[axis]));
                high[axis] = high[axis].max(pixel[axis].clamp(0.0, frame[axis]));
            }
        }
        let (from, to) = (low.map(|side| side as usize), high.map(|side| side as usize));
        let pixels = (to[0] - from[0]) * (to[1] - from[1]);
        (pixels > 0).then_some(Self { from, to, pixels })
    }
}

/// What a coarse square shows.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Shows {
    Object,
    Background,
    Both,
}

fn acuity(view: &View, window: &Window, edge: usize) -> Acuity {
    let coarse_edge = COARSE * edge;
    let (width, height) = view.image.dimensions();
    // Whole coarse squares, one more than the object has to each side, where the picture has them.
    let whole = [width as usize / coarse_edge, height as usize / coarse_edge];
    let from = window.from.map(|side| (side / coarse_edge).saturating_sub(1));
    let to = [0, 1].map(|axis| (window.to[axis].div_ceil(coarse_edge) + 1).min(whole[axis]));
    if (0..2).any(|axis| to[axis] < from[axis] + 3) {
        return Acuity::default();
    }
    let size = [to[0] - from[0], to[1] - from[1]];
    let fine = LumaSums::new(&view.image, edge, from.map(|side| side * COARSE), size.map(|side| side * COARSE));
    let coarse = fine.pooled(COARSE);
    let shows = squares(view, window, from, size, coarse_edge);
    let (mut inside, mut outline) = (Energies::default(), Energies::default());
    for row in 1..size[1] - 1 {
        for column in 1..size[0] - 1 {
            let around = (row - 1..=row + 1).flat_map(|v| shows[v * size[0] + column - 1..][..3].iter().copied());
            let all = around.reduce(|a, b| if a == b { a } else { Shows::Both });
            match all {
                Some(Shows::Object) => inside.add(&fine, &coarse, [column, row]),
                Some(Shows::Both) => outline.add(&fine, &coarse, [column, row]),
                _ => {}
            }
        }
    }
    let levels = [fine.level(), coarse.level()];
    Acuity { inside: inside.ratios(levels), outline: outline.ratios(levels).filter(|_| view.training_mask().is_some()) }
}

/// What the coarse squares show, row by row. Without a mask, all that is in the window is the object.
fn squares(view: &View, window: &Window, from: [usize; 2], size: [usize; 2], edge: usize) -> Vec<Shows> {
    let width = view.image.width() as usize;
    let mut object = vec![0; size[0] * size[1]];
    let coverage = view.training_mask().map(|mask| mask.coverage.as_raw());
    for (v, counts) in object.chunks_exact_mut(size[0]).enumerate() {
        for y in (from[1] + v) * edge..(from[1] + v + 1) * edge {
            for (u, count) in counts.iter_mut().enumerate() {
                let columns = (from[0] + u) * edge..(from[0] + u + 1) * edge;
                *count += match coverage {
                    Some(coverage) => {
                        coverage[y * width..][columns].iter().filter(|&&coverage| coverage >= 128).count()
                    }
                    None if (window.from[1]..window.to[1]).contains(&y) => {
                        columns.filter(|x| (window.from[0]..window.to[0]).contains(x)).count()
                    }
                    None => 0,
                };
            }
        }
    }
    let shown = |count: usize| match count {
        0 => Shows::Background,
        count if count == edge * edge => Shows::Object,
        _ => Shows::Both,
    };
    object.into_iter().map(shown).collect()
}

/// Sums of squared second differences, along [`DIRECTIONS`], over fine squares and the coarse ones that hold them.
#[derive(Default)]
struct Energies {
    fine: Ratios,
    coarse: Ratios,
    squares: usize,
}

impl Energies {
    /// Those of a coarse square.
    fn add(&mut self, fine: &LumaSums, coarse: &LumaSums, [column, row]: [usize; 2]) {
        self.squares += 1;
        for (direction, along) in DIRECTIONS.into_iter().enumerate() {
            let square = |difference: i64| (difference as f64).powi(2);
            self.coarse[direction] += square(coarse.second_difference([column, row], along));
            let mut sum = 0.0;
            for v in row * COARSE..(row + 1) * COARSE {
                for u in column * COARSE..(column + 1) * COARSE {
                    sum += square(fine.second_difference([u, v], along));
                }
            }
            self.fine[direction] += sum;
        }
    }

    /// Fine over coarse means; `levels` are what a level of luma is in both.
    fn ratios(&self, levels: [f64; 2]) -> Option<Ratios> {
        let of_fine = (self.squares * COARSE * COARSE) as f64 * levels[0].powi(2);
        let of_coarse = self.squares as f64 * levels[1].powi(2);
        let coarse = self.coarse.map(|sum| sum / of_coarse);
        let tells = self.squares >= FEWEST && coarse.iter().all(|square| *square > FAINTEST.powi(2));
        tells.then(|| std::array::from_fn(|direction| self.fine[direction] / of_fine / coarse[direction]))
    }
}
