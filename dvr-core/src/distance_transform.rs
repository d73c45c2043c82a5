//! Euclidean distances to the outline of a mask, and to the surface of a body of voxels.
//!
//! The lower envelope of parabolas of Felzenszwalb and Huttenlocher (2012), exact and linear in the pixels. Written
//! here: the crate that holds it (`imageproc`) brings a linear algebra library and a font renderer along.

use crate::voxel::VoxelGrid;

/// Signed distance of each cell's centre to the outline of `inside` (row by row, `width` wide), in cells: positive
/// inside. The outline lies half way between neighbouring centres of different kind; without any outline the distances
/// are infinite.
pub fn signed_distance(inside: &[bool], width: usize) -> Vec<f32> {
    signed(inside, &[width, inside.len().checked_div(width).unwrap_or(0)])
}

/// The same in space: distances of the nodes of `grid`, in its spacings.
///
/// # Panics
/// When `inside` is not as long as the grid.
pub fn signed_distance_at_nodes(inside: &[bool], grid: &VoxelGrid) -> Vec<f32> {
    assert_eq!(inside.len(), grid.len(), "a value per node");
    signed(inside, &[grid.nodes(); 3])
}

fn signed(inside: &[bool], sizes: &[usize]) -> Vec<f32> {
    let to_outside = squared_distance(inside, sizes, false);
    let to_inside = squared_distance(inside, sizes, true);
    let pairs = inside.iter().zip(to_outside.iter().zip(&to_inside));
    pairs.map(|(&inside, (out, into))| if inside { out.sqrt() - 0.5 } else { 0.5 - into.sqrt() }).collect()
}

/// Squared distance of each cell to the nearest cell that is `kind`; the first of the sizes is that of the axis whose
/// cells lie side by side.
fn squared_distance(cells: &[bool], sizes: &[usize], kind: bool) -> Vec<f32> {
    let mut squared: Vec<f32> = cells.iter().map(|&c| if c == kind { 0.0 } else { f32::INFINITY }).collect();
    let mut envelope = Envelope::default();
    let mut stride = 1;
    for &size in sizes {
        let (mut line, mut out) = (vec![0.0; size], vec![0.0; size]);
        let is_first = |cell: &usize| (cell / stride).is_multiple_of(size);
        for first in (0..cells.len()).filter(is_first) {
            line.iter_mut().enumerate().for_each(|(i, value)| *value = squared[first + i * stride]);
            envelope.distances(&line, &mut out);
            out.iter().enumerate().for_each(|(i, &value)| squared[first + i * stride] = value);
        }
        stride *= size;
    }
    squared
}

/// Working space of the one-dimensional transform.
#[derive(Default)]
struct Envelope {
    /// Parabolas of the lower envelope by their apex.
    apexes: Vec<usize>,
    /// Where each begins to be the lowest.
    starts: Vec<f32>,
}

impl Envelope {
    /// `out[x] = min over q of (x - q)^2 + heights[q]`.
    fn distances(&mut self, heights: &[f32], out: &mut [f32]) {
        self.apexes.clear();
        self.starts.clear();
        for (q, &height) in heights.iter().enumerate() {
            if height == f32::INFINITY {
                continue;
            }
            let mut start = f32::NEG_INFINITY;
            while let (Some(&p), Some(&from)) = (self.apexes.last(), self.starts.last()) {
                let (a, b) = (p as f32, q as f32);
                start = ((height - heights[p]) + (b - a) * (b + a)) / (2.0 * (b - a));
                if start > from {
                    break;
                }
                self.apexes.pop();
                self.starts.pop();
                start = f32::NEG_INFINITY;
            }
            self.apexes.push(q);
            self.starts.push(start);
        }
        let mut k = 0;
        for (x, value) in out.iter_mut().enumerate() {
            while k + 1 < self.starts.len() && self.starts[k + 1] < x as f32 {
                k += 1;
            }
            *value = self.apexes.get(k).map_or(f32::INFINITY, |&q| (x as f32 - q as f32).powi(2) + heights[q]);
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn agrees_with_the_search_over_all_pixels() {
        let (width, height) = (23, 17);
        for density in [0.02, 0.5, 0.97] {
            let mut rng = ChaCha8Rng::seed_from_u64(5);
            let inside: Vec<bool> = (0..width * height).map(|_| rng.random_bool(density)).collect();
            let found = signed_distance(&inside, width);
            for i in 0..inside.len() {
                let distance =
                    |j: usize| ((i % width) as f32 - (j % width) as f32).hypot((i / width) as f32 - (j / width) as f32);
                let nearest =
                    (0..inside.len()).filter(|&j| inside[j] != inside[i]).map(distance).fold(f32::INFINITY, f32::min);
                let expected = if inside[i] { nearest - 0.5 } else { 0.5 - nearest };
                assert!((found[i] - expected).abs() < 1e-4, "{i}: {} and {expected}", found[i]);
            }
        }
    }

    #[test]
    fn agrees_with_the_search_over_all_nodes() {
        let grid = VoxelGrid::new(9, 1.0);
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let inside: Vec<bool> = (0..grid.len()).map(|_| rng.random_bool(0.03)).collect();
        let found = signed_distance_at_nodes(&inside, &grid);
        for i in 0..inside.len() {
            let distance = |j: usize| (grid.position(i) - grid.position(j)).length() / grid.spacing();
            let others = (0..inside.len()).filter(|&j| inside[j] != inside[i]);
            let nearest = others.map(distance).fold(f32::INFINITY, f32::min);
            let expected = if inside[i] { nearest - 0.5 } else { 0.5 - nearest };
            assert!((found[i] - expected).abs() < 1e-4, "{i}: {} and {expected}", found[i]);
        }
    }

    #[test]
    fn without_an_outline_distances_are_infinite() {
        assert!(signed_distance(&[true; 6], 3).iter().all(|&d| d == f32::INFINITY));
        assert!(signed_distance(&[false; 6], 3).iter().all(|&d| d == f32::NEG_INFINITY));
        assert!(signed_distance(&[], 0).is_empty());
    }
}
