//! Photographs as the trainer reads them: projections in f32, neighbours, and the pixels where they are.

use std::borrow::Cow;

use dvr_core::{Bilinear, Exposure, Mask, Pinhole, View};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

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
            center: self.camera.center.to_array(),
            to_direction: self.camera.to_direction.to_cols_array(),
            projection: self.camera.projection.to_cols_array(),
            offset: self.camera.offset.to_array(),
            width: self.width,
            height: self.height,
            first_pixel: 0,
            scale: self.exposure.scale().to_array(),
            shift: self.exposure.offset().to_array(),
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
        let levels = Vec3::from(self.colors[(v * self.width + u) as usize].map(f32::from));
        Some(self.exposure.scale().dot(levels) / (3.0 * 255.0) + self.exposure.offset().element_sum() / 3.0)
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
        if !at.pixels.iter().all(|&(u, v)| self.is_object(u, v)) {
            return None;
        }
        let colors = at.pixels.map(|(u, v)| self.color((v * self.width + u) as usize));
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
