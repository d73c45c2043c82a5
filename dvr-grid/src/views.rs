//! Photographs as the trainer reads them: projections in f32, neighbours, and the pixels where they are.

mod object_pixels;

use std::borrow::Cow;

use dvr_core::{Bilinear, Exposure, Mask, Pinhole, View};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use self::object_pixels::{ObjectPixels, rounded_down};

/// One training view. Its pixels are the scene's own; their colours are read at the mean exposure of the views.
#[derive(Clone, Debug)]
pub(crate) struct TrainingView<'a> {
    pub camera: Pinhole,
    width: u32,
    height: u32,
    /// Red, green and blue.
    colors: Cow<'a, [[u8; 3]]>,
    /// Where the object is; `None` shows none.
    mask: Option<Cow<'a, Mask>>,
    /// Measured z-depth; empty without.
    z_depth: Cow<'a, [f32]>,
    /// What takes its colours to the mean exposure.
    pub exposure: Exposure,
    /// Views that look at the object from close by, nearest first.
    pub neighbours: Vec<u32>,
}

/// A pixel of a view and its ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelRay {
    pub view: u32,
    /// Column and row.
    pub pixel: [u32; 2],
    pub direction: Vec3,
    pub color: Vec3,
    pub object: bool,
    /// Not finite where nothing was measured.
    pub z_depth: f32,
}

/// What a view shows at a point, and how that changes as the point moves along a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reprojection {
    pub color: Vec3,
    pub derivative: Vec3,
}

/// Views beyond this angle from each other show too different sides of a surface to be compared, as a cosine.
const MAX_NEIGHBOUR_ANGLE: f32 = 0.5;

impl<'a> TrainingView<'a> {
    /// Prepares views, shrunk by `factor`; each gets at most `neighbours` neighbours.
    pub fn pack(views: &[&'a View], neighbours: usize, factor: u32) -> Vec<Self> {
        let mut packed: Vec<Self> = views.par_iter().map(|view| Self::new(view, factor)).collect();
        for i in 0..packed.len() {
            let mut near = packed[i].nearest(&packed, 0.0);
            near.retain(|&other| other as usize != i);
            near.truncate(neighbours);
            packed[i].neighbours = near;
        }
        packed
    }

    /// Prepares a view that is not one of `others`, shrunk by `factor`, with neighbours among these at about this angle,
    /// radians.
    pub fn beside(view: &'a View, factor: u32, others: &[TrainingView], neighbours: usize, angle: f32) -> Self {
        let view = Self::new(view, factor);
        let mut near = view.nearest(others, angle);
        near.truncate(neighbours);
        Self { neighbours: near, ..view }
    }

    /// The views that may be compared with this one: those first whose lines of sight to the object are nearest to an
    /// angle from its own, radians.
    fn nearest(&self, views: &[TrainingView], angle: f32) -> Vec<u32> {
        let toward = |view: &TrainingView| view.camera.center.normalize_or_zero();
        let cosines: Vec<f32> = views.iter().map(|view| toward(self).dot(toward(view))).collect();
        let off = |j: u32| (cosines[j as usize].clamp(-1.0, 1.0).acos() - angle).abs();
        let mut near: Vec<u32> =
            (0..views.len() as u32).filter(|&j| cosines[j as usize] > MAX_NEIGHBOUR_ANGLE).collect();
        near.sort_by(|&a, &b| off(a).total_cmp(&off(b)));
        near
    }

    fn new(view: &'a View, factor: u32) -> Self {
        if factor <= 1 {
            return Self {
                colors: view.image.as_raw().as_chunks().0.into(),
                mask: view.training_mask().map(Cow::Borrowed),
                z_depth: view.depth.as_ref().map_or(&[][..], |depth| &depth.z_depth).into(),
                ..Self::blank(view)
            };
        }
        let View { camera, image, mask, refined_mask, depth, .. } = view.downscaled(factor);
        let (width, height) = image.dimensions();
        Self {
            camera: Pinhole::new(&camera),
            width,
            height,
            colors: image.as_raw().as_chunks().0.to_vec().into(),
            mask: refined_mask.or(mask).map(Cow::Owned),
            z_depth: depth.map_or(Vec::new(), |depth| depth.z_depth).into(),
            ..Self::blank(view)
        }
    }

    /// A view that shows nothing yet, as large as the file.
    fn blank(view: &View) -> Self {
        let (width, height) = view.image.dimensions();
        Self {
            camera: Pinhole::new(&view.camera),
            width,
            height,
            colors: Cow::default(),
            mask: None,
            z_depth: Cow::default(),
            exposure: Exposure::default(),
            neighbours: Vec::new(),
        }
    }

    /// A pixel's colour, by its index in the image.
    fn color(&self, index: usize) -> Vec3 {
        self.exposure.corrected(color(self.colors[index]))
    }

    /// Whether a pixel shows the object.
    pub fn is_object(&self, u: u32, v: u32) -> bool {
        self.mask.as_ref().is_some_and(|mask| mask.is_object(u, v))
    }

    /// Whether a pixel and all around it show the object.
    pub fn is_interior(&self, [u, v]: [u32; 2]) -> bool {
        let inside = (1..self.width.saturating_sub(1)).contains(&u) && (1..self.height.saturating_sub(1)).contains(&v);
        inside && (v - 1..=v + 1).all(|v| (u - 1..=u + 1).all(|u| self.is_object(u, v)))
    }

    /// The ray of a pixel, by its index in the image; `view` is this view's index.
    pub fn pixel_ray(&self, view: u32, index: u32) -> PixelRay {
        let (u, v) = (index % self.width, index / self.width);
        PixelRay {
            view,
            pixel: [u, v],
            direction: self.direction(u, v),
            color: self.color(index as usize),
            object: self.is_object(u, v),
            z_depth: self.z_depth.get(index as usize).copied().unwrap_or(f32::NAN),
        }
    }

    /// Direction of unit z-depth through the centre of a pixel.
    pub fn direction(&self, u: u32, v: u32) -> Vec3 {
        self.camera.direction_through(Vec2::new(u as f32 + 0.5, v as f32 + 0.5))
    }

    /// Columns and rows.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// As kernels read it.
    #[cfg(feature = "gpu")]
    pub fn record(&self) -> crate::gpu::views::ViewRecord {
        crate::gpu::views::ViewRecord {
            scale: self.exposure.scale().to_array(),
            shift: self.exposure.offset().to_array(),
            ..crate::gpu::views::ViewRecord::of_camera(&self.camera, self.size())
        }
    }

    /// Its pixels in a word each: red, green and blue from the lowest byte on, and 1 in the highest on the object.
    #[cfg(feature = "gpu")]
    pub fn packed_pixels(&self) -> impl Iterator<Item = u32> {
        (0..).zip(self.colors.iter()).map(|(index, &[red, green, blue])| {
            let object = self.is_object(index % self.width, index / self.width);
            u32::from_le_bytes([red, green, blue, u8::from(object)])
        })
    }

    /// The z-depth of each pixel, `f32::MAX` where nothing was measured.
    #[cfg(feature = "gpu")]
    pub fn z_depths(&self) -> impl Iterator<Item = f32> {
        let measured = |index: usize| self.z_depth.get(index).copied().filter(|depth| depth.is_finite());
        (0..self.colors.len()).map(move |index| measured(index).unwrap_or(f32::MAX))
    }

    /// Brightness of a pixel; `None` out of the frame and off the object.
    pub fn brightness(&self, u: u32, v: u32) -> Option<f32> {
        if u >= self.width || v >= self.height || !self.is_object(u, v) {
            return None;
        }
        Some(ObjectPixels::of(self)?.brightness((v * self.width + u) as usize))
    }

    /// Brightnesses of `SIDE` by `SIDE` pixels around one, `stride` apart; zero in the lanes beyond. `None` out of the
    /// frame and off the object.
    #[inline(always)]
    pub fn brightness_around<const SIDE: usize, const N: usize>(
        &self,
        [u, v]: [u32; 2],
        stride: u32,
    ) -> Option<[f32; N]> {
        let reach = SIDE as u32 / 2 * stride;
        let [first_u, first_v] = [u.checked_sub(reach)?, v.checked_sub(reach)?];
        if u + reach >= self.width || v + reach >= self.height {
            return None;
        }
        let pixels = ObjectPixels::of(self)?;
        let (mut brightness, mut shown) = ([0.0; N], u8::MAX);
        for row in 0..SIDE {
            let start = (first_v as usize + row * stride as usize) * pixels.width + first_u as usize;
            for column in 0..SIDE {
                let at = start + column * stride as usize;
                brightness[row * SIDE + column] = pixels.brightness(at);
                shown &= pixels.coverage[at];
            }
        }
        ObjectPixels::are_object(shown).then_some(brightness)
    }

    /// Brightnesses at the projections of points, and their derivatives as each point moves along a direction of its
    /// own. Points and directions are given by axis; those from `SAMPLES` on are not looked at, and are near enough to
    /// the others not to matter. `None` where the view does not show the object in all four pixels around each: as
    /// [`TrainingView::reproject`] has it, for many at once.
    #[allow(clippy::needless_range_loop, reason = "loops over lanes are compiled to vectors")]
    #[inline(always)]
    pub fn reproject_brightness<const SAMPLES: usize, const N: usize>(
        &self,
        points: &[[f32; N]; 3],
        directions: &[[f32; N]; 3],
    ) -> Option<([f32; N], [f32; N])> {
        let pixels = ObjectPixels::of(self)?;
        let Pinhole { projection, offset, .. } = self.camera;
        let [last_u, last_v] = [self.width, self.height].map(|side| side as f32 - 1.0);
        let (mut s, mut t, mut flow_u, mut flow_v) = ([0.0f32; N], [0.0f32; N], [0.0; N], [0.0; N]);
        let mut is_inside = true;
        for i in 0..N {
            let along = |axis: usize, of: &[[f32; N]; 3]| {
                projection.x_axis[axis] * of[0][i]
                    + projection.y_axis[axis] * of[1][i]
                    + projection.z_axis[axis] * of[2][i]
            };
            let z = along(2, points) + offset.z;
            let [u, v] = [(along(0, points) + offset.x) / z, (along(1, points) + offset.y) / z];
            let away = along(2, directions);
            flow_u[i] = (along(0, directions) - u * away) / z;
            flow_v[i] = (along(1, directions) - v * away) / z;
            (s[i], t[i]) = (u - 0.5, v - 0.5);
            is_inside &= (z > 0.0) & (s[i] >= 0.0) & (t[i] >= 0.0) & (s[i] < last_u) & (t[i] < last_v);
        }
        if !is_inside {
            return None;
        }
        let mut at = [0u32; N];
        for i in 0..N {
            let ((left, u), (above, v)) = (rounded_down(s[i]), rounded_down(t[i]));
            at[i] = v * self.width + u;
            (s[i], t[i]) = (s[i] - left, t[i] - above);
        }
        let (mut corners, mut shown) = ([[0u32; N]; 4], u8::MAX);
        for i in 0..SAMPLES {
            let top = at[i] as usize;
            [corners[0][i], corners[1][i]] = pixels.side_by_side(top);
            [corners[2][i], corners[3][i]] = pixels.side_by_side(top + pixels.width);
            shown &= pixels.common_coverage(top);
        }
        if !ObjectPixels::are_object(shown) {
            return None;
        }
        let mut brightness = [[0.0; N]; 4];
        for (corners, brightness) in corners.iter().zip(&mut brightness) {
            for i in 0..N {
                let [red, green, blue] =
                    [corners[i], corners[i] >> 8, corners[i] >> 16].map(|level| (level & 0xff) as f32);
                brightness[i] = pixels.brightness_of([red, green, blue]);
            }
        }
        let (mut values, mut derivatives) = ([0.0; N], [0.0; N]);
        for i in 0..N {
            let [a, b, c, d] = [0, 1, 2, 3].map(|corner: usize| brightness[corner][i]);
            let (top, bottom) = (a + (b - a) * s[i], c + (d - c) * s[i]);
            values[i] = top + (bottom - top) * t[i];
            let by_u = (b - a) + ((d - c) - (b - a)) * t[i];
            derivatives[i] = by_u * flow_u[i] + (bottom - top) * flow_v[i];
        }
        Some((values, derivatives))
    }

    /// Colour of a pixel; `None` out of the frame and off the object.
    pub fn object_color(&self, u: u32, v: u32) -> Option<Vec3> {
        let is_object = u < self.width && v < self.height && self.is_object(u, v);
        is_object.then(|| self.color((v * self.width + u) as usize))
    }

    /// The least and the greatest colour, by channel, of the object's pixels within `radius` of one; `None` out of the
    /// frame and off the object.
    pub fn color_range(&self, [u, v]: [u32; 2], radius: u32) -> Option<[Vec3; 2]> {
        self.object_color(u, v)?;
        let around = |at: u32, side: u32| at.saturating_sub(radius)..=(at + radius).min(side - 1);
        let pixels = around(v, self.height).flat_map(|v| around(u, self.width).map(move |u| (u, v)));
        let colors = pixels.filter_map(|(u, v)| self.object_color(u, v));
        Some(colors.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], c| [low.min(c), high.max(c)]))
    }

    /// The range of colours around the projection of a point.
    pub fn color_range_at(&self, point: Vec3, radius: u32) -> Option<[Vec3; 2]> {
        let (pixel, z) = self.camera.project(point);
        let is_ahead = z > 0.0 && pixel.cmpge(Vec2::ZERO).all();
        is_ahead.then(|| self.color_range(pixel.as_uvec2().to_array(), radius))?
    }

    /// The colour at the projection of a point, and its derivative as the point moves along `direction`; `None` where
    /// the view does not show the object in all four pixels around.
    pub fn reproject(&self, point: Vec3, direction: Vec3) -> Option<Reprojection> {
        let (pixel, z) = self.camera.project(point);
        if z <= 0.0 {
            return None;
        }
        let at = Bilinear::at_single(pixel, (self.width, self.height))?;
        let (u, v) = at.pixels[0];
        let top = (v * self.width + u) as usize;
        if !ObjectPixels::are_object(ObjectPixels::of(self)?.common_coverage(top)) {
            return None;
        }
        let width = self.width as usize;
        let colors = [top, top + 1, top + width, top + width + 1].map(|index| self.color(index));
        let [by_x, by_y] = at.derivatives(colors);
        let moved = self.camera.projection * direction;
        let flow = (Vec2::new(moved.x, moved.y) - pixel * moved.z) / z;
        Some(Reprojection { color: at.value(colors), derivative: by_x * flow.x + by_y * flow.y })
    }
}

/// A pixel's colour.
fn color(pixel: [u8; 3]) -> Vec3 {
    Vec3::from(pixel.map(f32::from)) / 255.0
}

/// Mean colour of the object's pixels, where colours start.
pub(crate) fn mean_object_color(views: &[&View]) -> Vec3 {
    let (mut sum, mut count) = (glam::DVec3::ZERO, 0usize);
    for view in views {
        for (_, _, pixel) in view.image.enumerate_pixels().filter(|(u, v, _)| view.is_training_object(*u, *v)) {
            sum += glam::DVec3::from(pixel.0.map(f64::from)) / 255.0;
            count += 1;
        }
    }
    (sum / count.max(1) as f64).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::losses::GridLosses;
    use crate::step::suite::Fixture;

    /// By axis, what four lanes have, the last of which is not looked at.
    fn by_axis(of: [Vec3; 4]) -> [[f32; 4]; 3] {
        std::array::from_fn(|axis| of.map(|of| of[axis]))
    }

    #[test]
    fn brightnesses_of_many_points_are_the_means_of_the_channels_of_each() {
        let mut fixture = Fixture::speckled_ball(0.3, GridLosses::default());
        fixture.expose();
        let (mut seen, mut unseen) = (0, 0);
        for view in &fixture.views {
            for i in 0..200 {
                // Some off the ball, where the view shows no object.
                let turn = 0.1 * i as f32;
                let middle = 0.32 * Vec3::new(turn.cos(), turn.sin(), (0.37 * turn).cos() - 0.5);
                let points = [0.0, 0.004, -0.003, 0.0].map(|by| middle + by * Vec3::new(1.0, -0.5, 0.7));
                let directions = [Vec3::X, Vec3::NEG_Y, Vec3::ONE, Vec3::ZERO];
                let found = view.reproject_brightness::<3, 4>(&by_axis(points), &by_axis(directions));
                let expected: Option<Vec<Reprojection>> =
                    (0..3).map(|i| view.reproject(points[i], directions[i])).collect();
                assert_eq!(found.is_some(), expected.is_some(), "{middle}");
                let (Some((values, derivatives)), Some(expected)) = (found, expected) else {
                    unseen += 1;
                    continue;
                };
                seen += 1;
                for (i, expected) in expected.iter().enumerate() {
                    assert!((values[i] - expected.color.element_sum() / 3.0).abs() < 1e-5);
                    assert!((derivatives[i] - expected.derivative.element_sum() / 3.0).abs() < 1e-3);
                }
            }
        }
        assert!(seen > 50 && unseen > 50, "{seen} and {unseen}");
    }

    #[test]
    fn brightnesses_around_a_pixel_are_those_of_its_neighbours() {
        let mut fixture = Fixture::speckled_ball(0.3, GridLosses::default());
        fixture.expose();
        let view = &fixture.views[1];
        let [width, height] = view.size();
        let (mut there, mut missing) = (0, 0);
        for (u, v) in (0..height).step_by(5).flat_map(|v| (0..width).step_by(5).map(move |u| (u, v))) {
            for stride in [1, 4] {
                let around = |at: u32| [-1i64, 0, 1].map(|k| i64::from(at) + k * i64::from(stride));
                let pixels = around(v).into_iter().flat_map(|v| around(u).map(move |u| (u, v)));
                let brightness = |(u, v): (i64, i64)| view.brightness(u.try_into().ok()?, v.try_into().ok()?);
                let expected: Option<Vec<f32>> = pixels.map(brightness).collect();
                let found = view.brightness_around::<3, 16>([u, v], stride);
                assert_eq!(found.map(|found| found[..9].to_vec()), expected, "{u}, {v}");
                assert!(found.is_none_or(|found| found[9..].iter().all(|&beyond| beyond == 0.0)));
                if found.is_some() { there += 1 } else { missing += 1 }
            }
        }
        assert!(there > 50 && missing > 50, "{there} and {missing}");
    }
}
