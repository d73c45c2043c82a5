//! What photographs show beside the colours of a surface, view by view.
//!
//! Harmonics change slowly, along the surface and from one direction to the next. What they leave, shadows that move,
//! narrow highlights, a texture that lies a little beside, is kept as small pictures of differences, one per photograph, and
//! blended for other directions from the photographs that saw the point from nearby directions: view-dependent texture mapping
//! (Debevec, Taylor and Malik 1996), with the weights of unstructured lumigraphs (Buehler et al. 2001, section 4.2).

use glam::{Mat3, Vec2, Vec3};
use half::f16;

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

/// Differences are stored as so many parts of one in eight bits, with sign.
pub(super) const LEVELS: f32 = 127.0;

/// How far depths of the same surface may be apart.
pub(super) fn tolerance(depth: f32) -> f32 {
    DEPTH_TOLERANCE + DEPTH_ROUNDING * depth
}

/// One photograph's.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ResidualView {
    pub width: u32,
    pub height: u32,
    /// Takes points of object space, and then `offset`, to homogeneous pixels whose last number is the z-depth.
    pub projection: Mat3,
    pub offset: Vec3,
    /// Where its camera stands.
    center: Vec3,
    /// z-depth of the surface at each pixel, row by row; zero where the photograph does not show it.
    pub depths: Vec<f16>,
    /// What the photograph shows beside the colour of the surface there, in [`LEVELS`] by channel.
    pub changes: Vec<[i8; 3]>,
}

/// Those of all photographs.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ResidualViews(pub Vec<ResidualView>);

impl ResidualView {
    /// `None` where the projection is not that of a camera, there is not a number for each pixel, or a depth is none.
    pub fn new(
        [width, height]: [u32; 2],
        projection: Mat3,
        offset: Vec3,
        depths: Vec<f16>,
        changes: Vec<[i8; 3]>,
    ) -> Option<Self> {
        let center = -(projection.inverse() * offset);
        let pixels = u64::from(width) * u64::from(height);
        let is_whole = depths.len() as u64 == pixels && changes.len() as u64 == pixels;
        let are_depths = depths.iter().all(|depth| depth.is_finite() && *depth >= f16::ZERO);
        (is_whole && pixels > 0 && are_depths && projection.is_finite() && center.is_finite()).then_some(Self {
            width,
            height,
            projection,
            offset,
            center,
            depths,
            changes,
        })
    }

    /// What it shows at a point beside the colour of the surface, from the four pixels around, and how much of these sees the
    /// point; `None` where none does.
    fn at(&self, point: Vec3) -> Option<(f32, Vec3)> {
        let projected = self.projection * point + self.offset;
        if projected.z <= 0.0 {
            return None;
        }
        let place = Vec2::new(projected.x, projected.y) / projected.z - 0.5;
        let (low, high) = (Vec2::splat(-1.0), Vec2::new(self.width as f32, self.height as f32));
        if !(place.cmpgt(low).all() && place.cmplt(high).all()) {
            return None;
        }
        let (first, share) = (place.floor(), place - place.floor());
        let (mut seen, mut sum) = (0.0, Vec3::ZERO);
        for (x, by_x) in [(first.x, 1.0 - share.x), (first.x + 1.0, share.x)] {
            for (y, by_y) in [(first.y, 1.0 - share.y), (first.y + 1.0, share.y)] {
                if x < 0.0 || y < 0.0 || x >= high.x || y >= high.y {
                    continue;
                }
                let pixel = y as usize * self.width as usize + x as usize;
                let depth = self.depths[pixel].to_f32();
                if depth > 0.0 && (depth - projected.z).abs() <= tolerance(depth) {
                    seen += by_x * by_y;
                    sum += by_x * by_y * Vec3::from(self.changes[pixel].map(f32::from));
                }
            }
        }
        (seen > 0.0).then(|| (seen, sum / (seen * LEVELS)))
    }
}

impl ResidualViews {
    /// What photographs show of a point beside the colour of the surface, seen along this unit vector; zero where none saw it.
    /// It changes with the direction without a step.
    pub fn at(&self, point: Vec3, direction: Vec3) -> Vec3 {
        let angle = |view: &ResidualView| {
            let other = (point - view.center).normalize_or_zero();
            // The chord: unlike the cosine, it tells small angles apart.
            2.0 * (0.5 * (other - direction).length()).min(1.0).asin()
        };
        let mut near: Vec<(f32, &ResidualView)> = self.0.iter().map(|view| (angle(view), view)).collect();
        near.retain(|&(angle, _)| angle < MAX_ANGLE);
        near.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let mut found = near.into_iter().filter_map(|(angle, view)| view.at(point).map(|seen| (angle, seen)));
        let blended: Vec<(f32, (f32, Vec3))> = found.by_ref().take(NEAREST).collect();
        // It counts nothing where the next one takes its place.
        let limit = found.next().map_or(MAX_ANGLE, |(angle, _)| angle);
        let nearest = blended.first().map_or(MAX_ANGLE, |(angle, _)| *angle);
        let counts = (2.0 - 2.0 * nearest / MAX_ANGLE).clamp(0.0, 1.0);
        let (mut weights, mut sum) = (0.0, Vec3::ZERO);
        for (angle, (seen, change)) in blended {
            let weight = seen * (1.0 - angle / limit).max(1e-6) / angle.max(SAME_ANGLE);
            weights += weight;
            sum += weight * change;
        }
        if weights > 0.0 { counts * sum / weights } else { Vec3::ZERO }
    }

    /// How many numbers it consists of.
    pub fn numbers(&self) -> usize {
        self.0.iter().map(|view| 4 * view.depths.len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A photograph of 2 x 2 pixels, taken at unit distance from the origin in the direction of an angle about y, of a
    /// surface at that distance, all of whose pixels show this change.
    fn view(turn: f32, depth: f32, change: i8) -> ResidualView {
        let intrinsics = Mat3::from_cols(2.0 * Vec3::X, 2.0 * Vec3::Y, Vec3::new(1.0, 1.0, 1.0));
        let projection = intrinsics * Mat3::from_rotation_y(turn);
        let offset = intrinsics * Vec3::Z;
        ResidualView::new([2, 2], projection, offset, vec![f16::from_f32(depth); 4], vec![[change; 3]; 4]).unwrap()
    }

    /// Along which the photograph of an angle sees the origin.
    fn direction(turn: f32) -> Vec3 {
        Mat3::from_rotation_y(turn).transpose() * Vec3::Z
    }

    #[test]
    fn directions_between_photographs_show_what_lies_between() {
        let views = ResidualViews([0.0, 0.2, 0.4].map(|turn| view(turn, 1.0, (100.0 * turn) as i8)).to_vec());
        let at = |turn: f32| LEVELS * views.at(Vec3::ZERO, direction(turn)).x;
        let [own, halfway, other] = [0.0, 0.1, 0.2].map(at);
        assert!(own.abs() < 3.0 && (other - 20.0).abs() < 3.0, "{own}, {other}");
        assert!((4.0..16.0).contains(&halfway), "{halfway}");
        assert!((at(0.1 + 1e-4) - halfway).abs() < 0.1, "without steps");
        assert_eq!(ResidualViews::default().at(Vec3::ZERO, Vec3::Z), Vec3::ZERO);
        let one = ResidualViews(vec![view(0.0, 1.0, 80)]);
        let aside = [0.4, 0.75, 0.99, 1.1].map(|turn| LEVELS * one.at(Vec3::ZERO, direction(turn)).x);
        assert!((aside[0] - 80.0).abs() < 1e-3 && (aside[1] - 40.0).abs() < 1.0, "{aside:?}");
        assert!(aside[2] < 2.0 && aside[3] == 0.0, "{aside:?}");
    }

    #[test]
    fn photographs_that_do_not_see_a_point_say_nothing_of_it() {
        let free = view(0.3, 1.0, 50);
        // Before, behind, none at all, and to its side.
        for hidden in [view(0.0, 0.9, 90), view(0.0, 1.1, 90), view(0.0, 0.0, 90), view(2.0, 1.0, 90)] {
            let views = ResidualViews(vec![hidden, free.clone()]);
            let found = LEVELS * views.at(Vec3::ZERO, direction(0.0));
            assert!((found - 50.0).abs().max_element() < 1e-3, "{found}");
        }
        let own = view(0.0, 1.0, 90);
        for point in [2.0 * Vec3::X, -2.0 * Vec3::Y, -3.0 * Vec3::Z, 0.1 * Vec3::Z] {
            assert_eq!(own.at(point), None, "{point}: out of the frame, behind the camera, behind the surface");
        }
        assert!(own.at(Vec3::ZERO).is_some());
    }

    #[test]
    fn a_pixel_blends_with_those_around_it_that_are_as_far_away() {
        let mut own = view(0.0, 1.0, 0);
        own.changes[1] = [80; 3];
        let at = |view: &ResidualView, point: Vec3| LEVELS * view.at(point).unwrap().1.x;
        // The middle of the picture lies between all four pixels.
        assert!((at(&own, Vec3::ZERO) - 20.0).abs() < 1e-3);
        assert!((at(&own, Vec3::new(0.25, -0.25, 0.0)) - 80.0).abs() < 1e-3);
        own.depths[1] = f16::from_f32(0.5);
        assert!(at(&own, Vec3::ZERO).abs() < 1e-3 && own.at(Vec3::ZERO).unwrap().0 == 0.75);
        assert_eq!(own.at(Vec3::new(0.25, -0.25, 0.0)), None);
    }
}
