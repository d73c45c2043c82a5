//! What the loss terms are given, and what they return.
//!
//! A term adds what it says of the depth, the colour or the shape's value to one gradient, already weighted, and
//! returns its value without the weight. Terms whose weight is 0 are not asked.

use std::ops::RangeInclusive;

use glam::Vec3;

use crate::color::ColorSample;
use crate::views::{PixelRay, Reprojection, TrainingView};

/// One term of the loss.
pub(crate) trait LossTerm {
    /// What its value is multiplied by.
    fn weight(&self) -> f64;

    /// Its other numbers: name, value, and the range that makes sense.
    fn parameters(&self) -> Vec<(&'static str, f64, RangeInclusive<f64>)> {
        Vec::new()
    }

    /// The term at weight one, with nothing taken for occlusion: what tests compare with differences.
    #[cfg(test)]
    fn for_tests() -> Self;

    /// How far its gradient by the depth may be from differences, as a share of the largest.
    #[cfg(test)]
    fn slack() -> f64 {
        0.02
    }

    /// Whether its gradient leaves the surface out on purpose.
    #[cfg(test)]
    fn is_detached() -> bool {
        false
    }
}

/// Where the ray of an object pixel meets the surface.
#[derive(Debug)]
pub(crate) struct SurfaceHit<'a> {
    /// The pixel, with what was measured there.
    pub pixel: &'a PixelRay,
    /// The camera.
    pub origin: Vec3,
    /// Ray depth, which is z-depth.
    pub depth: f32,
    pub point: Vec3,
    /// Unit normal of the surface, towards the inside.
    pub inward: Vec3,
    /// The field's colour there, and its derivative by the depth.
    pub color: ColorSample,
}

/// The weighted gradient of the loss at a hit.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SurfaceGradient {
    /// By the ray depth of the hit.
    pub grad_depth: f32,
    /// By the colour there.
    pub grad_color: Vec3,
}

/// A term at one hit.
pub(crate) trait SurfaceTerm: LossTerm {
    /// Adds the gradient; returns the value.
    fn evaluate(&self, hit: &SurfaceHit, gradient: &mut SurfaceGradient) -> f64;
}

/// Another view that sees the point of a hit.
pub(crate) struct Comparison<'a> {
    pub view: &'a TrainingView<'a>,
    /// What it shows there, and how that changes with the depth.
    pub seen: Reprojection,
}

/// A term that compares a hit with other views; its value is a mean over those.
pub(crate) trait CrossViewTerm: LossTerm {
    /// What is the same for all views that a hit is compared with.
    type Prepared;

    /// Prepares the comparisons of a hit; `None` where there is nothing to compare.
    fn prepare(&self, own: &TrainingView, hit: &SurfaceHit) -> Option<Self::Prepared>;

    /// Adds the gradient by the depth; returns the value.
    fn compare(&self, prepared: &Self::Prepared, hit: &SurfaceHit, other: &Comparison, grad_depth: &mut f32) -> f64;
}

/// A term of rays whose hit and mask do not agree.
pub(crate) trait SilhouetteTerm: LossTerm {
    /// `largest` is the shape's largest value on the ray; `sign` is 1 where it should be outside, -1 where inside.
    /// Returns the value and its weighted gradient by `largest`.
    fn evaluate(&self, largest: f32, sign: f32) -> (f64, f32);
}

/// The same inside kernels.
#[cfg(feature = "gpu")]
pub(crate) mod gpu {
    #![allow(missing_docs)]

    use cubecl::prelude::*;

    use crate::gpu::views::Photo;
    use crate::gpu::voxel::Point;

    /// A pixel and its ray.
    #[derive(CubeType)]
    pub(crate) struct PixelRay {
        pub view: Photo,
        pub u: u32,
        pub v: u32,
        pub origin: Point,
        pub direction: Point,
        pub color: Point,
        /// Whether it shows the object.
        pub object: bool,
        /// Measured z-depth, `FAR` without.
        pub z_depth: f32,
    }

    /// Where the ray of an object pixel meets the surface.
    #[derive(CubeType)]
    pub(crate) struct SurfaceHit {
        pub depth: f32,
        pub point: Point,
        pub inward: Point,
        pub color: Point,
        /// By the depth.
        pub color_derivative: Point,
    }

    /// The weighted gradient of the loss at a hit.
    #[derive(CubeType)]
    pub(crate) struct SurfaceGradient {
        depth: RuntimeCell<f32>,
        red: RuntimeCell<f32>,
        green: RuntimeCell<f32>,
        blue: RuntimeCell<f32>,
    }

    #[cube]
    impl SurfaceGradient {
        pub fn zero() -> SurfaceGradient {
            SurfaceGradient {
                depth: RuntimeCell::new(0.0f32),
                red: RuntimeCell::new(0.0f32),
                green: RuntimeCell::new(0.0f32),
                blue: RuntimeCell::new(0.0f32),
            }
        }

        pub fn add_depth(&self, gradient: f32) {
            self.depth.store(self.depth.read() + gradient);
        }

        pub fn add_color(&self, gradient: &Point) {
            self.red.store(self.red.read() + gradient.x);
            self.green.store(self.green.read() + gradient.y);
            self.blue.store(self.blue.read() + gradient.z);
        }

        pub fn by_depth(&self) -> f32 {
            self.depth.read()
        }

        pub fn by_color(&self) -> Point {
            Point::new(self.red.read(), self.green.read(), self.blue.read())
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A pixel of the colour (.5, .2, .9) whose ray is 1.5 long per unit of z-depth, with a measured depth.
    pub fn pixel(z_depth: f32) -> PixelRay {
        PixelRay {
            view: 0,
            pixel: [0, 0],
            direction: Vec3::new(1.0, 0.5, 1.0),
            color: Vec3::new(0.5, 0.2, 0.9),
            object: true,
            z_depth,
        }
    }

    /// What a term says of a hit at depth 2, of the colour (.4, .6, .3), whose derivative is (1, 10, 100), and what it
    /// adds to a gradient.
    pub fn evaluated(term: &impl SurfaceTerm, pixel: &PixelRay) -> (f64, f32, Vec3) {
        let hit = SurfaceHit {
            pixel,
            origin: Vec3::ZERO,
            depth: 2.0,
            point: 2.0 * pixel.direction,
            inward: Vec3::Z,
            color: ColorSample { color: Vec3::new(0.4, 0.6, 0.3), derivative: Vec3::new(1.0, 10.0, 100.0) },
        };
        let before = SurfaceGradient { grad_depth: 7.0, grad_color: Vec3::splat(9.0) };
        let mut gradient = before;
        let value = term.evaluate(&hit, &mut gradient);
        (value, gradient.grad_depth - before.grad_depth, gradient.grad_color - before.grad_color)
    }
}
