//! How sharp a picture is, by second differences of its luma.
//!
//! The Laplacian is the sum of the second differences along x and y. Its variance is the usual measure of focus
//! (Pech-Pacheco and others, *Diatom autofocusing in brightfield microscopy*, ICPR 2000).

use std::ops::Deref;

use image::{ImageBuffer, Rgb};

/// ITU-R BT.601, in units of 1/256.
const LUMA: [i64; 3] = [77, 150, 29];

/// Sums of luma over squares of pixels: a smaller picture, exactly.
pub(crate) struct LumaSums {
    /// Squares side by side, and one below the other.
    pub size: [usize; 2],
    /// `sums[row * columns + column]`.
    sums: Vec<i64>,
    /// Pixels of a square.
    pixels: i64,
}

impl LumaSums {
    /// Of squares with edges of `edge` pixels, the first of which is the square `from` of the picture; they must lie in
    /// the picture.
    pub(crate) fn new(
        image: &ImageBuffer<Rgb<u8>, impl Deref<Target = [u8]>>,
        edge: usize,
        from: [usize; 2],
        size: [usize; 2],
    ) -> Self {
        let stride = 3 * image.width() as usize;
        let [columns, rows] = size;
        let mut sums = vec![0; columns * rows];
        for (row, sums) in sums.chunks_exact_mut(columns.max(1)).enumerate() {
            for v in (from[1] + row) * edge..(from[1] + row + 1) * edge {
                let first = v * stride + 3 * from[0] * edge;
                let line = &image.as_raw()[first..first + 3 * columns * edge];
                for (sum, square) in sums.iter_mut().zip(line.chunks_exact(3 * edge)) {
                    let luma = |rgb: &[u8; 3]| (0..3).map(|c| LUMA[c] * i64::from(rgb[c])).sum::<i64>();
                    *sum += square.as_chunks().0.iter().map(luma).sum::<i64>();
                }
            }
        }
        Self { size, sums, pixels: (edge * edge) as i64 }
    }

    /// The sums over `edge` by `edge` of these; a rest at the right and lower edge is cut off.
    pub(crate) fn pooled(&self, edge: usize) -> Self {
        let [columns, rows] = self.size.map(|side| side / edge);
        let of_square = |row: usize, column: usize| {
            let line = |v: usize| &self.sums[v * self.size[0] + column * edge..][..edge];
            (row * edge..(row + 1) * edge).flat_map(line).sum()
        };
        let sums = (0..rows).flat_map(|row| (0..columns).map(move |column| of_square(row, column))).collect();
        Self { size: [columns, rows], sums, pixels: self.pixels * (edge * edge) as i64 }
    }

    /// The second difference at a square, along a direction in squares; the squares to both sides must be there.
    pub(crate) fn second_difference(&self, [column, row]: [usize; 2], [right, down]: [isize; 2]) -> i64 {
        let at = row * self.size[0] + column;
        let step = down * self.size[0] as isize + right;
        self.sums[at.wrapping_add_signed(step)] + self.sums[at.wrapping_add_signed(-step)] - 2 * self.sums[at]
    }

    /// What a level of luma, of 255, is here.
    pub(crate) fn level(&self) -> f64 {
        (256 * self.pixels) as f64
    }
}

/// The variance of the Laplacian of luma, in levels of 255, on means of `edge` by `edge` pixels: more than one hold less
/// of the noise of a sensor or a codec. It depends on what the picture shows: only pictures of the same can be compared.
/// 0 where the picture has fewer than three squares either way.
pub fn laplacian_variance(image: &ImageBuffer<Rgb<u8>, impl Deref<Target = [u8]>>, edge: u32) -> f64 {
    let edge = edge.max(1);
    let [columns, rows] = [image.width() / edge, image.height() / edge].map(|side| side as usize);
    if columns < 3 || rows < 3 {
        return 0.0;
    }
    let luma = LumaSums::new(image, edge as usize, [0, 0], [columns, rows]);
    let (mut sum, mut squares) = (0i128, 0i128);
    for row in 1..rows - 1 {
        for column in 1..columns - 1 {
            let along = |direction| luma.second_difference([column, row], direction);
            let laplacian = i128::from(along([1, 0]) + along([0, 1]));
            sum += laplacian;
            squares += laplacian * laplacian;
        }
    }
    let count = ((columns - 2) * (rows - 2)) as f64;
    let mean = sum as f64 / count;
    (squares as f64 / count - mean * mean) / luma.level().powi(2)
}

#[cfg(test)]
mod tests {
    use image::RgbImage;

    use super::*;

    #[test]
    fn sums_of_sums_are_those_of_larger_squares() {
        let image = RgbImage::from_fn(24, 16, |u, v| Rgb([(u * 9) as u8, (v * 13) as u8, (u * v) as u8]));
        let fine = LumaSums::new(&image, 2, [2, 1], [8, 6]);
        let coarse = LumaSums::new(&image, 4, [1, 0], [4, 3]);
        assert_eq!(fine.pooled(2).sums.len(), coarse.sums.len());
        let shifted = LumaSums::new(&image, 2, [2, 2], [8, 4]).pooled(2);
        assert_eq!(shifted.sums, LumaSums::new(&image, 4, [1, 1], [4, 2]).sums);
        assert_eq!(shifted.level(), 16.0 * 256.0);
        let of = |u: i64, v: i64| 77 * (u * 9) + 150 * (v * 13) + 29 * (u * v);
        let whole = LumaSums::new(&image, 1, [0, 0], [24, 16]);
        assert_eq!(whole.second_difference([5, 3], [1, -1]), of(6, 2) + of(4, 4) - 2 * of(5, 3));
    }

    #[test]
    fn the_variance_of_the_laplacian_is_that_of_its_definition() {
        let image = RgbImage::from_fn(9, 7, |u, v| Rgb([((u * u * 5 + v * v * 11 + u * v * 7) % 251) as u8; 3]));
        let at = |u: u32, v: u32| f64::from(image.get_pixel(u, v).0[0]);
        let inner = (1..6).flat_map(|v| (1..8).map(move |u| (u, v)));
        let laplacians: Vec<f64> =
            inner.map(|(u, v)| at(u - 1, v) + at(u + 1, v) + at(u, v - 1) + at(u, v + 1) - 4.0 * at(u, v)).collect();
        let mean = laplacians.iter().sum::<f64>() / laplacians.len() as f64;
        let variance = laplacians.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / laplacians.len() as f64;
        assert!((laplacian_variance(&image, 1) / variance - 1.0).abs() < 1e-9);
        assert_eq!(laplacian_variance(&image, 3), 0.0);
    }
}
