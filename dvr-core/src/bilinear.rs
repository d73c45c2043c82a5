//! Bilinear interpolation between the centres of pixels: which four pixels, with which weights, and how the value changes
//! with the place.

use std::ops::{Add, Mul, Sub};

use glam::{DVec2, Vec2};

/// What can be interpolated: grey values, colours.
pub trait Linear: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<f32, Output = Self> {}

impl<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f32, Output = T>> Linear for T {}

/// A place between the centres of four pixels.
///
/// Pixel `(u, v)` has its centre at `(u + 0.5, v + 0.5)`. Who has the four values interpolates them:
///
/// ```
/// use dvr_core::Bilinear;
/// use glam::DVec2;
///
/// let grey = [0.0f32, 1.0, 2.0, 3.0]; // 2x2 pixels, row by row
/// let at = Bilinear::at(DVec2::new(1.25, 1.0), (2, 2)).unwrap();
/// let corners = at.pixels.map(|(u, v)| grey[(2 * v + u) as usize]);
/// assert_eq!(at.value(corners), 1.75);
/// assert_eq!(at.derivatives(corners), [1.0, 2.0]);
/// assert!(Bilinear::at(DVec2::new(0.25, 1.0), (2, 2)).is_none(), "beyond the outermost centres");
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bilinear {
    /// The pixels around the place: top left, top right, bottom left, bottom right.
    pub pixels: [(u32, u32); 4],
    /// How far the place is from the left to the right pixels, and from the top to the bottom ones, in `[0, 1)`.
    pub fraction: [f32; 2],
}

impl Bilinear {
    /// The place at pixel coordinates in a picture of `(width, height)`; `None` beyond the outermost centres, on the last
    /// ones, and for coordinates that are not finite.
    pub fn at(pixel: DVec2, (width, height): (u32, u32)) -> Option<Self> {
        let (x, y) = (pixel.x - 0.5, pixel.y - 0.5);
        let is_inside = x >= 0.0 && y >= 0.0 && x < f64::from(width) - 1.0 && y < f64::from(height) - 1.0;
        is_inside.then(|| {
            let (u, v) = (x as u32, y as u32);
            let pixels = [(u, v), (u + 1, v), (u, v + 1), (u + 1, v + 1)];
            Self { pixels, fraction: [x.fract() as f32, y.fract() as f32] }
        })
    }

    /// The same in single precision, for inner loops.
    #[inline]
    pub fn at_single(pixel: Vec2, (width, height): (u32, u32)) -> Option<Self> {
        let (x, y) = (pixel.x - 0.5, pixel.y - 0.5);
        let is_inside = x >= 0.0 && y >= 0.0 && x < width as f32 - 1.0 && y < height as f32 - 1.0;
        is_inside.then(|| {
            let (u, v) = (x as u32, y as u32);
            let pixels = [(u, v), (u + 1, v), (u, v + 1), (u + 1, v + 1)];
            // The same bits as `fract`, which is a call of the mathematics library.
            Self { pixels, fraction: [x - u as f32, y - v as f32] }
        })
    }

    /// The place at pixel coordinates in a picture that repeats in both directions.
    pub fn repeating(pixel: Vec2, (width, height): (u32, u32)) -> Self {
        let corner = pixel - 0.5;
        let first = corner.floor();
        let at = |dx: i64, dy: i64| {
            let (u, v) = (first.x as i64 + dx, first.y as i64 + dy);
            (u.rem_euclid(width.into()) as u32, v.rem_euclid(height.into()) as u32)
        };
        Self { pixels: [at(0, 0), at(1, 0), at(0, 1), at(1, 1)], fraction: (corner - first).to_array() }
    }

    /// The weights of the four pixels; they sum to 1.
    pub fn weights(&self) -> [f32; 4] {
        let [s, t] = self.fraction;
        [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t]
    }

    /// The value between those of the four pixels.
    pub fn value<T: Linear>(&self, [a, b, c, d]: [T; 4]) -> T {
        let [s, t] = self.fraction;
        let (top, bottom) = (a + (b - a) * s, c + (d - c) * s);
        top + (bottom - top) * t
    }

    /// The derivatives of the value by the column and by the row, per pixel.
    pub fn derivatives<T: Linear>(&self, [a, b, c, d]: [T; 4]) -> [T; 2] {
        let [s, t] = self.fraction;
        let (top, bottom) = (a + (b - a) * s, c + (d - c) * s);
        [(b - a) + ((d - c) - (b - a)) * t, bottom - top]
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// Linear in the column, the row and their product.
    fn value(x: f64, y: f64) -> Vec3 {
        Vec3::new((2.0 * x + 1.0) as f32, (3.0 * y) as f32, (x * y) as f32)
    }

    fn corners(at: Bilinear) -> [Vec3; 4] {
        at.pixels.map(|(u, v)| value(f64::from(u) + 0.5, f64::from(v) + 0.5))
    }

    #[test]
    fn value_and_derivatives_are_exact_for_what_is_bilinear() {
        for (x, y) in [(0.5, 0.5), (2.3, 1.9), (6.4, 3.45)] {
            let at = Bilinear::at(DVec2::new(x, y), (7, 4)).unwrap();
            assert!((at.value(corners(at)) - value(x, y)).length() < 1e-5);
            let [by_x, by_y] = at.derivatives(corners(at));
            assert!((by_x - Vec3::new(2.0, 0.0, y as f32)).length() < 1e-5);
            assert!((by_y - Vec3::new(0.0, 3.0, x as f32)).length() < 1e-5);
            let weighted: Vec3 = corners(at).iter().zip(at.weights()).map(|(&corner, weight)| weight * corner).sum();
            assert!((weighted - value(x, y)).length() < 1e-5);
        }
    }

    #[test]
    fn there_is_no_place_beyond_the_outermost_centres() {
        for (x, y) in [(0.4, 2.0), (2.0, 0.4), (6.5, 2.0), (2.0, 3.5), (f64::NAN, 2.0), (f64::INFINITY, 2.0)] {
            assert_eq!(Bilinear::at(DVec2::new(x, y), (7, 4)), None, "{x} {y}");
            assert_eq!(Bilinear::at_single(DVec2::new(x, y).as_vec2(), (7, 4)), None, "{x} {y}");
        }
        assert_eq!(Bilinear::at(DVec2::splat(0.5), (1, 1)), None);
        assert_eq!(Bilinear::at(DVec2::splat(0.5), (0, 0)), None);
    }

    #[test]
    fn a_picture_that_repeats_has_every_place() {
        let at = Bilinear::repeating(Vec2::new(0.25, -0.5), (3, 2));
        assert_eq!(at.pixels, [(2, 1), (0, 1), (2, 0), (0, 0)]);
        assert_eq!(at.fraction, [0.75, 0.0]);
    }
}
