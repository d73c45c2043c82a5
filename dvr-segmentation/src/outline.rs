//! The part of a picture that agrees best with what each pixel says, with a short outline along edges: a continuous
//! minimum cut with the edge weights of Boykov and Jolly (2001), by the primal-dual steps of Chambolle and Pock (2011).

use dvr_core::{Mask, View, stored};
use image::{GrayImage, Luma, imageops};

use crate::shrunk::Shrunk;

/// Step size of both variables: their product is at most one by the squared norm of the gradient, 8.
const STEP: f32 = 0.35;

/// What a pixel's side of outline costs in plain colour; a pixel of a colour that is a hundred times as frequent in the
/// background costs about four.
pub(crate) const OUTLINE: f32 = 1.0;

/// What an edge costs at least, as a share of its price in plain colour.
const MIN_EDGE: f32 = 0.05;

/// Prices of outlines between pixels and their right and lower neighbours: low where the colour changes.
pub(crate) struct Edges {
    right: Vec<f32>,
    down: Vec<f32>,
    width: usize,
}

impl Edges {
    /// `price` is that of a pixel's side of outline in plain colour.
    pub fn new(view: &Shrunk, price: f32) -> Self {
        let difference = |a: usize, b: usize| -> f32 {
            let pairs = view.colors[a].iter().zip(&view.colors[b]);
            pairs.map(|(&a, &b)| (f32::from(a) - f32::from(b)).powi(2)).sum()
        };
        let (width, len) = (view.width, view.len());
        let right = |i: usize| (i % width + 1 < width).then(|| difference(i, i + 1));
        let down = |i: usize| (i + width < len).then(|| difference(i, i + width));
        let all: Vec<f32> = (0..len).flat_map(|i| [right(i), down(i)]).flatten().collect();
        let mean = (all.iter().sum::<f32>() / all.len().max(1) as f32).max(4.0);
        let weigh = |d: Option<f32>| d.map_or(0.0, |d| price * (MIN_EDGE + (1.0 - MIN_EDGE) * (-0.5 * d / mean).exp()));
        Self {
            right: (0..len).map(|i| weigh(right(i))).collect(),
            down: (0..len).map(|i| weigh(down(i))).collect(),
            width,
        }
    }

    /// From 0 to 1 for each pixel, how much it belongs to what is cut out; `price` is what a pixel costs, negative where it
    /// wants to belong. `start` is where the solver begins: near the end is soon there.
    pub fn cut(&self, price: &[f32], start: Vec<f32>, iterations: usize) -> Vec<f32> {
        let (width, len) = (self.width, price.len());
        let mut value = start;
        let mut ahead = value.clone();
        let (mut right, mut down) = (vec![0f32; len], vec![0f32; len]);
        let mut divergence = vec![0f32; len];
        for _ in 0..iterations {
            // The last pixel of a row, and the last row, have limits of 0: nothing flows out of the picture.
            for (((flow, limit), here), next) in right.iter_mut().zip(&self.right).zip(&ahead).zip(&ahead[1..]) {
                *flow = (*flow + STEP * (next - here)).clamp(-limit, *limit);
            }
            for (((flow, limit), here), next) in down.iter_mut().zip(&self.down).zip(&ahead).zip(&ahead[width..]) {
                *flow = (*flow + STEP * (next - here)).clamp(-limit, *limit);
            }
            divergence.iter_mut().zip(right.iter().zip(&down)).for_each(|(sum, (right, down))| *sum = right + down);
            divergence[1..].iter_mut().zip(&right).for_each(|(sum, flow)| *sum -= flow);
            divergence[width..].iter_mut().zip(&down).for_each(|(sum, flow)| *sum -= flow);
            for (((value, ahead), divergence), price) in value.iter_mut().zip(&mut ahead).zip(&divergence).zip(price) {
                let next = (*value + STEP * (divergence - price)).clamp(0.0, 1.0);
                *ahead = 2.0 * next - *value;
                *value = next;
            }
        }
        value
    }
}

/// A mask as large as the picture, by how much each pixel of a smaller one belongs to what is shown.
pub(crate) fn drawn(belongs: &[f32], fine: &Shrunk, view: &View) -> Mask {
    let drawn = GrayImage::from_fn(fine.width as u32, fine.height as u32, |u, v| {
        Luma([(255.0 * belongs[v as usize * fine.width + u as usize]).round() as u8])
    });
    let (width, height) = view.image.dimensions();
    let full = imageops::resize(&drawn, width, height, imageops::FilterType::Triangle);
    Mask { coverage: stored(full) }
}
