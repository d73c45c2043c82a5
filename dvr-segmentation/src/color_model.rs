//! How frequent colours are in the object and around it: histograms, smoothed; by places in the picture.
//!
//! What is frequent somewhere in the background says little at the other end of the picture: the models are those of
//! windows that overlap, as in Bai, Wang, Simons and Sapiro, *Video SnapCut*, 2009.

use glam::Vec2;

use crate::shrunk::Shrunk;

/// Bins along a channel.
const BINS: usize = 20;

/// Bytes of a model: a number for each bin of each tile.
pub(crate) const MODEL_BYTES: u64 = (4 * TILES * TILES * BINS * BINS * BINS) as u64;

/// Colours that were never seen are as frequent as if this share of all were spread evenly.
const UNSEEN: f32 = 0.02;

/// Tiles along a side of a picture. A model is made of a tile and those beside it.
const TILES: usize = 10;

/// How much the object's colours in all pictures count beside those of a tile, and the background's of the whole picture.
const OF_ALL: [f32; 2] = [2.0, 0.2];

/// They count as much as this share of a picture's pixels at least.
const LEAST: f32 = 0.01;

/// How much the background of all pictures counts beside that of one.
const OTHERS: f32 = 0.3;

/// Most that a colour says, as a logarithm.
pub(crate) const MAX_RATIO: f32 = 2.0;

/// Counts of colours in bins.
#[derive(Clone)]
pub(crate) struct ColorCounts(Vec<f32>);

impl ColorCounts {
    /// Of no pixel.
    pub fn none() -> Self {
        Self(vec![0.0; BINS.pow(3)])
    }

    fn add(&mut self, color: [u8; 3], weight: f32) {
        self.0[bin(color)] += weight;
    }

    /// Adds other counts, times `weight`.
    pub fn join(&mut self, other: &Self, weight: f32) {
        self.0.iter_mut().zip(&other.0).for_each(|(sum, count)| *sum += weight * count);
    }

    fn total(&self) -> f32 {
        self.0.iter().sum()
    }

    /// The counts of object and background in a picture; `belongs` is each pixel's share in the object, `near` how much it
    /// counts as background.
    pub fn of(view: &Shrunk, belongs: &[f32], near: &[f32]) -> [Self; 2] {
        let mut counts = [Self::none(), Self::none()];
        for ((&color, &belongs), &near) in view.colors.iter().zip(belongs).zip(near) {
            counts[0].add(color, belongs);
            counts[1].add(color, near * (1.0 - belongs));
        }
        counts
    }

    /// The density of each colour, relative to all colours being as frequent.
    fn density(&self) -> Vec<f32> {
        let mut values = self.0.clone();
        for axis in 0..3 {
            values = blurred(&values, BINS.pow(axis));
        }
        let total: f32 = values.iter().sum();
        if total <= 0.0 {
            return vec![1.0; values.len()];
        }
        let scale = (1.0 - UNSEEN) * values.len() as f32 / total;
        values.into_iter().map(|value| value * scale + UNSEEN).collect()
    }
}

fn bin(color: [u8; 3]) -> usize {
    let [r, g, b] = color.map(|channel| usize::from(channel) * BINS / 256);
    (b * BINS + g) * BINS + r
}

/// A binomial filter along an axis of the bins.
fn blurred(values: &[f32], stride: usize) -> Vec<f32> {
    let along = |i: usize| {
        let at = i / stride % BINS;
        let before = if at > 0 { values[i - stride] } else { values[i] };
        let after = if at + 1 < BINS { values[i + stride] } else { values[i] };
        0.25 * before + 0.5 * values[i] + 0.25 * after
    };
    (0..values.len()).map(along).collect()
}

/// How frequent colours are in the object by all views, wherever it shows them.
pub(crate) struct ObjectColors(Vec<f32>);

impl ObjectColors {
    /// By counts in the object.
    pub fn new(counts: &ColorCounts) -> Self {
        Self(counts.density())
    }

    /// How much a colour says that it is the object's, where the background has this density of it; negative for the background.
    pub fn says(&self, color: [u8; 3], background: f32) -> f32 {
        (self.0[bin(color)] / background).ln().clamp(-MAX_RATIO, MAX_RATIO)
    }
}

/// What colours say at each place of a picture.
pub(crate) struct ColorModel {
    /// For each tile, and each bin, the logarithm of how much more frequent it is in the object.
    tiles: Vec<Vec<f32>>,
    scale: Vec2,
}

impl ColorModel {
    /// That of a view; `own` are its counts, `all` those of all views, of object and background.
    pub fn new(view: &Shrunk, belongs: &[f32], near: &[f32], own: &[ColorCounts; 2], all: &[ColorCounts; 2]) -> Self {
        let scale = Vec2::new(TILES as f32 / view.width as f32, TILES as f32 / view.height as f32);
        let mut windows = vec![[ColorCounts::none(), ColorCounts::none()]; TILES * TILES];
        for (pixel, (&color, (&belongs, &near))) in view.colors.iter().zip(belongs.iter().zip(near)).enumerate() {
            let [x, y] = (view.middle(pixel) * scale).to_array().map(|at| at as usize);
            let beside = |tile: usize| tile.saturating_sub(1)..(tile + 2).min(TILES);
            for tile in beside(y).flat_map(|y| beside(x).map(move |x| y * TILES + x)) {
                windows[tile][0].add(color, belongs);
                windows[tile][1].add(color, near * (1.0 - belongs));
            }
        }
        let mut around = own[1].clone();
        around.join(&all[1], OTHERS * own[1].total() / all[1].total().max(1.0));
        let whole = [&all[0], &around];
        let ratio = |mut window: [ColorCounts; 2]| {
            let least = LEAST * view.len() as f32;
            for ((window, whole), share) in window.iter_mut().zip(whole).zip(OF_ALL) {
                let weight = (share * window.total()).max(least) / whole.total().max(1.0);
                window.join(whole, weight);
            }
            let [object, background] = window.map(|counts| counts.density());
            let ratio = |(object, background): (&f32, &f32)| (object / background).ln().clamp(-MAX_RATIO, MAX_RATIO);
            object.iter().zip(&background).map(ratio).collect()
        };
        Self { tiles: windows.into_iter().map(ratio).collect(), scale }
    }

    /// How much a colour says that it is the object's, at a place of the picture, in pixels of the view that the model was made
    /// of; negative for the background.
    pub fn says(&self, place: Vec2, color: [u8; 3]) -> f32 {
        let at = place * self.scale - 0.5;
        let first = at.floor();
        let [fx, fy] = (at - first).to_array();
        let bin = bin(color);
        let value = |x: f32, y: f32| {
            let [x, y] = [first.x + x, first.y + y].map(|at| (at.max(0.0) as usize).min(TILES - 1));
            self.tiles[y * TILES + x][bin]
        };
        let upper = (1.0 - fx) * value(0.0, 0.0) + fx * value(1.0, 0.0);
        let lower = (1.0 - fx) * value(0.0, 1.0) + fx * value(1.0, 1.0);
        (1.0 - fy) * upper + fy * lower
    }
}
