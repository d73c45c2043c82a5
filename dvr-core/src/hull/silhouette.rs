//! A mask that answers at once whether any pixel of a box shows the object.

use glam::DVec3;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::raster::Mask;

/// Masks larger than this are pooled first (a pooled pixel shows the object if any of its pixels does), so that a
/// hundred large photographs fit in memory; a hull voxel is wider than a pooled pixel anyway.
const MAX_SIDE: u32 = 1600;

/// What a view knows about a piece of space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sight {
    /// Some of it projects to the object.
    Object,
    /// All of it projects to background.
    Background,
    /// Some of it is out of the frame or behind the camera, and the rest is background.
    Unknown,
}

/// A camera with its mask as a summed-area table (Crow 1984).
pub(super) struct Silhouette {
    /// Rows of `K [R | t]`; the last gives the z-depth.
    rows: [(DVec3, f64); 3],
    frame: [f64; 2],
    /// Pixels along the side of a pooled pixel.
    pool: u32,
    /// Width and height in pooled pixels.
    size: [usize; 2],
    sums: SummedArea,
}

/// Counts of object pixels, kept for the smallest window that holds them all.
struct SummedArea {
    /// First column and row of the window, in pooled pixels.
    origin: [usize; 2],
    /// Columns and rows of the window.
    size: [usize; 2],
    /// `(columns + 1) * (rows + 1)` counts of object pixels above and left.
    sums: Vec<u32>,
}

impl Silhouette {
    /// Prepares all views, in order.
    pub(super) fn all(views: &[(&Camera, &Mask)]) -> Result<Vec<Self>> {
        views.iter().enumerate().map(|(index, (camera, mask))| Self::new(index, camera, mask)).collect()
    }

    fn new(index: usize, camera: &Camera, mask: &Mask) -> Result<Self> {
        let (width, height) = mask.size();
        if (width, height) != (camera.width, camera.height) || width == 0 || height == 0 {
            let (mask, camera) = ((width, height), (camera.width, camera.height));
            return Err(Error::MaskSize { view: index, mask, camera });
        }
        let projection = camera.intrinsics * camera.rotation;
        let offset = camera.intrinsics * camera.translation;
        let pool = width.max(height).div_ceil(MAX_SIDE);
        let size = [width.div_ceil(pool) as usize, height.div_ceil(pool) as usize];
        Ok(Self {
            rows: std::array::from_fn(|i| (projection.row(i), offset[i])),
            frame: [f64::from(width), f64::from(height)],
            pool,
            size,
            sums: SummedArea::new(mask, pool, size),
        })
    }

    /// What this view knows of the box `center +- half`, the mask being right to `margin` pixels.
    ///
    /// A `half` of zero asks for a point.
    pub(super) fn look(&self, center: DVec3, half: DVec3, margin: f64) -> Sight {
        let Some([low, high]) = self.footprint(center, half, margin) else { return Sight::Unknown };
        if self.any_object(low, high) {
            return Sight::Object;
        }
        let inside = (0..2).all(|i| low[i] >= 0.0 && high[i] < self.frame[i]);
        if inside { Sight::Background } else { Sight::Unknown }
    }

    /// Whether the whole projection of the box is object, in the frame.
    pub(super) fn is_filled_by_object(&self, center: DVec3, half: DVec3) -> bool {
        let Some([low, high]) = self.footprint(center, half, 0.0) else { return false };
        let inside = (0..2).all(|i| low[i] >= 0.0 && high[i] < self.frame[i]);
        let pixels = if inside { self.pixels(low, high) } else { None };
        pixels.is_some_and(|[x, y]| self.count(x.clone(), y.clone()) as usize == x.len() * y.len())
    }

    /// Whether the whole box is in front of the camera and beside its frame.
    pub(super) fn is_out_of_frame(&self, center: DVec3, half: DVec3) -> bool {
        self.footprint(center, half, 0.0).is_some_and(|[low, high]| self.pixels(low, high).is_none())
    }

    /// A pixel box around the projection of the box `center +- half`; `None` where that reaches behind the camera.
    ///
    /// For an offset `e` from the centre, `u` moves by `(a - u c) . e / (z + c . e)` with `a`, `c` the first and last
    /// rows of the projection, so the largest numerator over the smallest denominator bounds it.
    pub(super) fn footprint(&self, center: DVec3, half: DVec3, margin: f64) -> Option<[[f64; 2]; 2]> {
        let (axis, offset) = self.rows[2];
        let z = axis.dot(center) + offset;
        let nearest = z - axis.abs().dot(half);
        if nearest.is_nan() || nearest <= 0.0 {
            return None;
        }
        let range: [[f64; 2]; 2] = std::array::from_fn(|i| {
            let (row, offset) = self.rows[i];
            let pixel = (row.dot(center) + offset) / z;
            let reach = (row - pixel * axis).abs().dot(half) / nearest + margin;
            [pixel - reach, pixel + reach]
        });
        Some([[range[0][0], range[1][0]], [range[0][1], range[1][1]]])
    }

    /// Whether a pixel that the box touches shows the object. Parts of the box out of the frame do not count.
    fn any_object(&self, low: [f64; 2], high: [f64; 2]) -> bool {
        let Some([x, y]) = self.pixels(low, high) else { return false };
        self.count(x, y) > 0
    }

    /// The ranges of (pooled) pixels that a box touches, or `None` out of the frame.
    pub(super) fn pixels(&self, low: [f64; 2], high: [f64; 2]) -> Option<[std::ops::Range<usize>; 2]> {
        if !(0..2).all(|i| high[i] >= 0.0 && low[i] < self.frame[i]) {
            return None;
        }
        let pool = f64::from(self.pool);
        // `as` saturates: negative becomes 0.
        Some(std::array::from_fn(|i| (low[i] / pool) as usize..((high[i] / pool) as usize).min(self.size[i] - 1) + 1))
    }

    fn count(&self, x: std::ops::Range<usize>, y: std::ops::Range<usize>) -> u32 {
        let at = |x: usize, y: usize| self.sums.above_and_left(x, y);
        at(x.end, y.end) + at(x.start, y.start) - at(x.end, y.start) - at(x.start, y.end)
    }

    /// Whether (pooled) pixel `(x, y)` shows the object.
    pub(super) fn is_object(&self, x: usize, y: usize) -> bool {
        self.count(x..x + 1, y..y + 1) > 0
    }

    /// Width and height in (pooled) pixels.
    pub(super) fn size(&self) -> [usize; 2] {
        self.size
    }
}

impl SummedArea {
    /// Sums a mask whose `pool` x `pool` blocks make `width` x `height` pooled pixels.
    fn new(mask: &Mask, pool: u32, [width, height]: [usize; 2]) -> Self {
        let mut object = vec![false; width * height];
        let (mut low, mut high) = ([width, height], [0, 0]);
        for (x, y, _) in mask.coverage.enumerate_pixels().filter(|&(x, y, _)| mask.is_object(x, y)) {
            let at = [(x / pool) as usize, (y / pool) as usize];
            object[at[1] * width + at[0]] = true;
            low = std::array::from_fn(|i| low[i].min(at[i]));
            high = std::array::from_fn(|i| high[i].max(at[i] + 1));
        }
        let size: [usize; 2] = std::array::from_fn(|i| high[i].saturating_sub(low[i]));
        let [columns, rows] = size;
        let mut sums = vec![0; (columns + 1) * (rows + 1)];
        for y in 0..rows {
            let mut row = 0;
            for x in 0..columns {
                row += u32::from(object[(low[1] + y) * width + low[0] + x]);
                sums[(y + 1) * (columns + 1) + x + 1] = row + sums[y * (columns + 1) + x + 1];
            }
        }
        Self { origin: low, size, sums }
    }

    /// How many object pixels there are in columns before `x` and rows before `y`.
    fn above_and_left(&self, x: usize, y: usize) -> u32 {
        let [column, row] = [(0, x), (1, y)].map(|(i, at)| at.saturating_sub(self.origin[i]).min(self.size[i]));
        self.sums[row * (self.size[0] + 1) + column]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_pixel(u: u32, v: u32) -> Silhouette {
        let mut mask = Mask::from(image::GrayImage::new(20, 10));
        mask.coverage.put_pixel(u, v, image::Luma([255]));
        let camera = Camera::look_at(20, 10, 10.0, DVec3::new(0.0, 0.0, -2.0), DVec3::ZERO, DVec3::Y);
        Silhouette::new(0, &camera, &mask).unwrap()
    }

    #[test]
    fn a_box_that_touches_an_object_pixel_sees_the_object_and_its_centre_may_not() {
        // One pixel is 0.2 units wide at the origin; the pixel right of the principal point is the object.
        let silhouette = one_pixel(10, 5);
        // Image y runs down, so object pixel (10, 5) is below the axis; x of the image is -x of the world here.
        let camera = Camera::look_at(20, 10, 10.0, DVec3::new(0.0, 0.0, -2.0), DVec3::ZERO, DVec3::Y);
        let beside = camera.pixel_ray(11, 5).at(2.0);
        assert_eq!(silhouette.look(beside, DVec3::ZERO, 0.0), Sight::Background);
        assert_eq!(silhouette.look(beside, DVec3::splat(0.11), 0.0), Sight::Object);
        assert_eq!(silhouette.look(beside, DVec3::ZERO, 0.6), Sight::Object);
        assert_eq!(silhouette.look(camera.pixel_ray(10, 5).at(2.0), DVec3::ZERO, 0.0), Sight::Object);
    }

    #[test]
    fn a_view_knows_nothing_out_of_its_frame_or_behind_its_camera() {
        let silhouette = one_pixel(10, 5);
        assert_eq!(silhouette.look(DVec3::new(30.0, 0.0, 0.0), DVec3::ZERO, 0.0), Sight::Unknown);
        assert_eq!(silhouette.look(DVec3::new(0.0, 0.0, -3.0), DVec3::ZERO, 0.0), Sight::Unknown);
        assert_eq!(silhouette.look(DVec3::new(2.0, 0.0, 0.0), DVec3::splat(0.2), 0.0), Sight::Unknown, "half out");
    }

    #[test]
    fn a_footprint_holds_the_projections_of_the_corners() {
        let camera = Camera::look_at(80, 60, 70.0, DVec3::new(1.0, 0.4, -1.2), DVec3::new(0.1, 0.0, 0.0), DVec3::Y);
        let mask = Mask::from(image::GrayImage::new(80, 60));
        let silhouette = Silhouette::new(0, &camera, &mask).unwrap();
        let (center, half) = (DVec3::new(0.1, 0.05, -0.2), DVec3::new(0.1, 0.02, 0.3));
        let [low, high] = silhouette.footprint(center, half, 0.0).unwrap();
        for corner in 0..8 {
            let sign = |bit: usize| if corner & bit == 0 { -1.0 } else { 1.0 };
            let (pixel, _) = camera.project(center + half * DVec3::new(sign(1), sign(2), sign(4)));
            assert!(pixel.x >= low[0] && pixel.x <= high[0] && pixel.y >= low[1] && pixel.y <= high[1]);
        }
    }

    #[test]
    fn a_large_mask_is_pooled_without_losing_a_pixel() {
        let mut mask = Mask::from(image::GrayImage::new(2 * MAX_SIDE + 1, 7));
        mask.coverage.put_pixel(2 * MAX_SIDE, 6, image::Luma([255]));
        let camera = Camera::look_at(2 * MAX_SIDE + 1, 7, 10.0, DVec3::new(0.0, 0.0, -2.0), DVec3::ZERO, DVec3::Y);
        let silhouette = Silhouette::new(0, &camera, &mask).unwrap();
        assert_eq!(silhouette.pool, 3);
        assert!(silhouette.is_object(silhouette.size()[0] - 1, silhouette.size()[1] - 1));
    }

    #[test]
    fn a_mask_of_another_size_is_refused_by_view() {
        let mask = Mask::from(image::GrayImage::new(20, 11));
        let camera = Camera::look_at(20, 10, 10.0, DVec3::new(0.0, 0.0, -2.0), DVec3::ZERO, DVec3::Y);
        let message = Silhouette::new(7, &camera, &mask).err().unwrap().to_string();
        assert!(message.contains("view 7") && message.contains("20x11"));
    }
}
