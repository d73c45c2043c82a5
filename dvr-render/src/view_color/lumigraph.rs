//! Photographs that are blended for directions that none of them has.
//!
//! Harmonics change slowly, along the surface and from one direction to the next. What they leave, shadows that move,
//! narrow highlights, a texture that lies a little beside, is shown as the photographs show it that saw the point from nearby
//! directions: view-dependent texture mapping (Debevec, Taylor and Malik 1996), with the weights of unstructured lumigraphs
//! (Buehler et al. 2001, section 4.2). Each counts by what it shows beside the colour that the point has from where it
//! was taken, so that the rest follows the direction.

use dvr_core::Bilinear;
use glam::{Mat3, Vec2, Vec3};
use half::f16;
use image::RgbImage;

/// Photographs that are blended.
const NEAREST: usize = 4;

/// Radians between two directions from which on they have nothing to do with each other; from half of that on, what the
/// nearest photograph shows counts less.
const MAX_ANGLE: f32 = 1.0;

/// Radians within which directions are the same: no photograph counts for more than one that is so near.
const SAME_ANGLE: f32 = 0.02;

/// How far a point may lie before or behind the surface that a photograph saw to be seen by it, in edges of the object cube.
const DEPTH_TOLERANCE: f32 = 0.02;

/// What depths of 16 bits are off by, as a share of them.
const DEPTH_ROUNDING: f32 = 1.0 / 1024.0;

/// Between nodes whose depths differ by more, in edges of the object cube, the surface ends.
const DEPTH_STEP: f32 = 0.06;

/// How fast a photograph counts less where a part of what it shows around a place is at another depth: beside an edge, it may
/// show what is before or behind.
const EDGE_POWER: i32 = 6;

/// One photograph, or a part of it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Photograph {
    /// Takes points of object space, and then `offset`, to homogeneous pixels whose last number is the z-depth.
    pub projection: Mat3,
    pub offset: Vec3,
    /// Where its camera stands.
    center: Vec3,
    /// Pixels from one node of depths to the next.
    pub spacing: u32,
    /// z-depth of the surface at the nodes, the centres of every such pixel of every such row, row by row; zero where the
    /// photograph does not show it, or its outline.
    pub depths: Vec<f16>,
    /// What it is kept as: a JPEG.
    pub stored: Vec<u8>,
    pixels: RgbImage,
}

/// Those of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Lumigraph(pub Vec<Photograph>);

/// How many nodes of depths a picture has along its edges, with so many pixels from one to the next.
pub(super) fn nodes([width, height]: [u32; 2], spacing: u32) -> [u32; 2] {
    [width, height].map(|edge| edge.saturating_sub(1).div_ceil(spacing) + 1)
}

impl Photograph {
    /// `pixels` are those of the JPEG `stored`, `spacing` is 1 at least. `None` where the projection is not that of a camera, there is not a number
    /// for each node, or a depth is none.
    pub fn new(
        (projection, offset): (Mat3, Vec3),
        (spacing, depths): (u32, Vec<f16>),
        stored: Vec<u8>,
        pixels: RgbImage,
    ) -> Option<Self> {
        let center = -(projection.inverse() * offset);
        let [columns, rows] = nodes(pixels.dimensions().into(), spacing);
        let is_whole = depths.len() as u64 == u64::from(columns) * u64::from(rows) && !pixels.is_empty();
        let are_depths = depths.iter().all(|depth| depth.is_finite() && *depth >= f16::ZERO);
        (is_whole && are_depths && projection.is_finite() && center.is_finite()).then_some(Self {
            projection,
            offset,
            center,
            spacing,
            depths,
            stored,
            pixels,
        })
    }

    /// Columns and rows of its pixels.
    pub fn size(&self) -> [u32; 2] {
        self.pixels.dimensions().into()
    }

    /// What colour it shows a point in, sRGB, and how sure it is that it does; `None` where it does not.
    fn at(&self, point: Vec3) -> Option<(f32, Vec3)> {
        let projected = self.projection * point + self.offset;
        if projected.z <= 0.0 {
            return None;
        }
        let place = Vec2::new(projected.x, projected.y) / projected.z;
        let seen = self.seen(place, projected.z).filter(|seen| *seen > 0.0)?;
        let at = Bilinear::at_single(place, self.pixels.dimensions())?;
        let color = |(u, v)| Vec3::from(self.pixels.get_pixel(u, v).0.map(f32::from));
        Some((seen, at.value(at.pixels.map(color)) / 255.0))
    }

    /// How much of what it shows at a place is as far away as this; `None` beyond its edges.
    fn seen(&self, place: Vec2, depth: f32) -> Option<f32> {
        let [columns, rows] = nodes(self.size(), self.spacing);
        let at = Bilinear::at_single((place - 0.5) / self.spacing as f32 + 0.5, (columns, rows))?;
        let depths = at.pixels.map(|(u, v)| self.depths[(v * columns + u) as usize].to_f32());
        let is_as_far = |other: f32| (depth - other).abs() <= DEPTH_TOLERANCE + DEPTH_ROUNDING * other;
        let [nearest, farthest] = [f32::min, f32::max].map(|of| depths.into_iter().reduce(of).unwrap_or_default());
        Some(if nearest > 0.0 && farthest - nearest <= DEPTH_STEP {
            // The inverse of the depth of a plane is linear.
            f32::from(is_as_far(at.value(depths.map(f32::recip)).recip()))
        } else {
            let weighed = depths.into_iter().zip(at.weights());
            weighed.filter(|(other, _)| *other > 0.0 && is_as_far(*other)).map(|(_, weight)| weight).sum()
        })
    }
}

impl Lumigraph {
    /// What photographs show of a point, seen along this unit vector, beside `shown`, its colour along any; zero where none
    /// saw it. It changes with the direction without a step.
    pub fn beside(&self, point: Vec3, direction: Vec3, shown: impl Fn(Vec3) -> Vec3) -> Vec3 {
        let seen_from = self.0.iter().map(|photograph| {
            let from = (point - photograph.center).normalize_or_zero();
            // By the chord: unlike the cosine, it tells small angles apart.
            let angle: f32 = 2.0 * (0.5 * (from - direction).length()).min(1.0).asin();
            (angle, from, photograph)
        });
        let mut near: Vec<(f32, Vec3, &Photograph)> = seen_from.collect();
        near.retain(|&(angle, ..)| angle < MAX_ANGLE);
        near.sort_by(|(a, ..), (b, ..)| a.total_cmp(b));
        let mut found = near.into_iter().filter_map(|(angle, from, photograph)| {
            photograph.at(point).map(|(seen, color)| (angle, from, seen, color))
        });
        let blended: Vec<(f32, Vec3, f32, Vec3)> = found.by_ref().take(NEAREST).collect();
        // It counts nothing where the next one takes its place.
        let limit = found.next().map_or(MAX_ANGLE, |(angle, ..)| angle);
        let nearest = blended.first().map_or(MAX_ANGLE, |(angle, ..)| *angle);
        let counts = (2.0 - 2.0 * nearest / MAX_ANGLE).clamp(0.0, 1.0);
        let (mut weights, mut sum) = (0.0, Vec3::ZERO);
        for (angle, from, seen, color) in blended {
            let weight = seen.powi(EDGE_POWER) * f32::max(1.0 - angle / limit, 1e-6) / angle.max(SAME_ANGLE);
            weights += weight;
            sum += weight * (color - shown(from));
        }
        if weights > 0.0 { counts * sum / weights } else { Vec3::ZERO }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    /// Pixels along an edge of a photograph, and its focal length in them.
    const EDGE: u32 = 9;

    /// A photograph in one grey, taken at unit distance from the origin in the direction of an angle about y, of a surface that
    /// is so far away.
    fn photograph(turn: f32, depth: f32, grey: u8) -> Photograph {
        let middle = EDGE as f32 / 2.0;
        let intrinsics = Mat3::from_cols(EDGE as f32 * Vec3::X, EDGE as f32 * Vec3::Y, Vec3::new(middle, middle, 1.0));
        let pixels = RgbImage::from_pixel(EDGE, EDGE, Rgb([grey; 3]));
        let [columns, rows] = nodes([EDGE; 2], 4);
        let depths = vec![f16::from_f32(depth); (columns * rows) as usize];
        let projection = intrinsics * Mat3::from_rotation_y(turn);
        Photograph::new((projection, intrinsics * Vec3::Z), (4, depths), Vec::new(), pixels).unwrap()
    }

    /// Along which the photograph of an angle sees the origin.
    fn direction(turn: f32) -> Vec3 {
        Mat3::from_rotation_y(turn).transpose() * Vec3::Z
    }

    /// The grey that a lumigraph shows the origin in, which is black without it.
    fn grey_of(lumigraph: &Lumigraph, turn: f32) -> f32 {
        255.0 * lumigraph.beside(Vec3::ZERO, direction(turn), |_| Vec3::ZERO).x
    }

    #[test]
    fn directions_between_photographs_show_what_lies_between() {
        let lumigraph = Lumigraph([0.0, 0.2, 0.4].map(|turn| photograph(turn, 1.0, (500.0 * turn) as u8)).to_vec());
        let [own, halfway, other] = [0.0, 0.1, 0.2].map(|turn| grey_of(&lumigraph, turn));
        assert!(own.abs() < 15.0 && (other - 100.0).abs() < 15.0, "{own}, {other}");
        assert!((20.0..80.0).contains(&halfway), "{halfway}");
        assert!((grey_of(&lumigraph, 0.1 + 1e-4) - halfway).abs() < 0.5, "without steps");
        assert_eq!(grey_of(&Lumigraph::default(), 0.0), 0.0);
        let one = Lumigraph(vec![photograph(0.0, 1.0, 80)]);
        let aside = [0.4, 0.75, 0.99, 1.1].map(|turn| grey_of(&one, turn));
        assert!((aside[0] - 80.0).abs() < 1e-3 && (aside[1] - 40.0).abs() < 1.0, "{aside:?}");
        assert!(aside[2] < 2.0 && aside[3] == 0.0, "{aside:?}");
    }

    #[test]
    fn a_photograph_counts_beside_the_colour_that_the_point_has_from_where_it_was_taken() {
        let one = Lumigraph(vec![photograph(0.3, 1.0, 204)]);
        let shown = |from: Vec3| Vec3::splat(0.5 + from.x);
        let beside = one.beside(Vec3::ZERO, direction(0.0), shown);
        assert!((beside - (0.8 - shown(direction(0.3)))).abs().max_element() < 1e-5, "{beside}");
    }

    #[test]
    fn photographs_that_do_not_see_a_point_say_nothing_of_it() {
        let free = photograph(0.3, 1.0, 50);
        // Before, behind, none at all, and to its side.
        for hidden in
            [photograph(0.0, 0.9, 90), photograph(0.0, 1.1, 90), photograph(0.0, 0.0, 90), photograph(2.0, 1.0, 90)]
        {
            let found = grey_of(&Lumigraph(vec![hidden, free.clone()]), 0.0);
            assert!((found - 50.0).abs() < 1e-3, "{found}");
        }
        let own = photograph(0.0, 1.0, 90);
        for point in [2.0 * Vec3::X, -2.0 * Vec3::Y, -3.0 * Vec3::Z, 0.1 * Vec3::Z] {
            assert_eq!(own.at(point), None, "{point}: out of the frame, behind the camera, behind the surface");
        }
        assert!(own.at(Vec3::ZERO).is_some());
    }

    #[test]
    fn colours_are_those_between_pixels_and_depths_those_between_nodes() {
        let mut own = photograph(0.0, 1.0, 0);
        own.pixels.put_pixel(4, 4, Rgb([80; 3]));
        let grey = |own: &Photograph, point: Vec3| own.at(point).map(|(seen, color)| (seen, 255.0 * color.x));
        let pixel = 1.0 / EDGE as f32;
        let (seen, middle) = grey(&own, Vec3::ZERO).unwrap();
        assert!(seen == 1.0 && (middle - 80.0).abs() < 1e-3, "{seen}, {middle}");
        assert!((grey(&own, 0.5 * pixel * Vec3::X).unwrap().1 - 40.0).abs() < 1e-3);

        // Half a node to the right of the middle of a plane that is farther away there.
        let at = |depth: f32| depth * Vec3::new(2.0 * pixel, 0.0, 1.0) - Vec3::Z;
        let along = |column: usize| (1.0 - 0.06 * (4.0 * pixel) * (column as f32 - 1.0)).recip();
        own.depths = (0..9).map(|node| f16::from_f32(along(node % 3))).collect();
        let depth = (1.0 - 0.06 * 2.0 * pixel).recip();
        assert!(depth > 1.01 && own.at(at(depth)).unwrap().0 == 1.0);
        assert!(own.at(at(depth + 0.025)).is_none() && own.at(at(depth - 0.025)).is_none());
        // The surface ends there: at another one behind it, or at none.
        for beyond in [1.5, 0.0] {
            (0..3).for_each(|row| own.depths[3 * row + 2] = f16::from_f32(beyond));
            assert!((own.at(at(1.0)).unwrap().0 - 0.5).abs() < 1e-3, "{beyond}");
            assert!(own.at(at(1.25)).is_none());
        }
    }
}
