//! Photographs at the size that a stage can show: larger pixels for larger cells.
//!
//! What pixels far smaller than a cell show, the grid cannot follow: patches of them match by chance, and one of them
//! says little of what is around. So each stage looks at photographs shrunk by a power of two (image pyramids: Burt and
//! Adelson 1983), the coarsest first.

use dvr_core::hull::MaskDistance;
use dvr_core::{Exposure, UnitCube, View};

use crate::pixel_order::PixelOrder;
use crate::views::TrainingView;

/// Most pixels along the edge of a cell. With half as many, patches span more than a cell, and what the coarse stages
/// leave undone the last does not find.
const PIXELS_OF_CELL: f64 = 8.0;

/// Fewest pixels along the side of a photograph that is shrunk.
const SMALLEST: u32 = 32;

/// How near to the object's outline background is learned from, in cells of the first grid.
const MARGIN_CELLS: f64 = 4.0;

/// The photographs that are learned from, at all sizes.
pub(crate) struct PicturePyramid<'a> {
    views: Vec<&'a View>,
    /// How many others each is compared with.
    neighbours: usize,
    /// Edge of a pixel at the object, object units: the median of the views.
    footprint: f64,
    /// Fewest pixels along a side of a view.
    shortest: u32,
    /// How near to the outline background is learned from, object units.
    margin: f64,
}

/// The photographs at one size.
pub(crate) struct PyramidLevel<'a> {
    /// Pixels of the files along the side of one.
    pub factor: u32,
    pub views: Vec<TrainingView<'a>>,
    /// Which pixels are learned from, and when.
    pub order: PixelOrder,
}

impl<'a> PicturePyramid<'a> {
    /// Of views that are compared with `neighbours` others; the first grid has this spacing.
    pub fn new(views: Vec<&'a View>, neighbours: usize, spacing: f32) -> Self {
        let sides = views.iter().map(|view| view.image.width().min(view.image.height()));
        Self {
            footprint: median_footprint(&views),
            shortest: sides.min().unwrap_or(0),
            margin: MARGIN_CELLS * f64::from(spacing),
            views,
            neighbours,
        }
    }

    /// By how much photographs are shrunk for grids of this many cells.
    pub fn factor(&self, cells: usize) -> u32 {
        let spacing = 2.0 * UnitCube::default().half_extent() / cells.max(1) as f64;
        let mut factor = 1;
        while spacing > PIXELS_OF_CELL * self.footprint * f64::from(factor) && self.shortest / (2 * factor) >= SMALLEST
        {
            factor *= 2;
        }
        factor
    }

    /// The photographs, shrunk by `factor`, without an order of their pixels.
    pub fn views(&self, factor: u32) -> Vec<TrainingView<'a>> {
        TrainingView::pack(&self.views, self.neighbours, factor)
    }

    /// The photographs, shrunk by `factor`, and the order in which their pixels are learned from; `masks` holds the
    /// distances of their masks' outlines, at full size.
    pub fn level(&self, factor: u32, masks: &[MaskDistance]) -> PyramidLevel<'a> {
        let views = self.views(factor);
        // Pixels whose rays come as close to the object as the band around the hull.
        let margin = |view: usize| {
            let camera = &self.views[view].camera;
            let depth = camera.center().length().max(UnitCube::default().half_extent());
            (self.margin * camera.intrinsics.x_axis.x.abs() / depth) as f32 + 1.0
        };
        let order = PixelOrder::new(&views, factor, masks, margin);
        PyramidLevel { factor, views, order }
    }
}

impl PyramidLevel<'_> {
    /// Reads the photographs at these exposures; as they are where there are none.
    pub fn expose(&mut self, exposures: &[Exposure]) {
        for (i, view) in self.views.iter_mut().enumerate() {
            view.exposure = exposures.get(i).copied().unwrap_or_default();
        }
    }
}

/// Edge of a pixel at the distance of the object, in object units: the median over views.
pub(crate) fn median_footprint(train: &[&View]) -> f64 {
    let mut footprints: Vec<f64> = train
        .iter()
        .map(|view| {
            let focal = 0.5 * (view.camera.intrinsics.x_axis.x.abs() + view.camera.intrinsics.y_axis.y.abs());
            view.camera.center().length() / focal
        })
        .collect();
    footprints.sort_by(f64::total_cmp);
    footprints.get(footprints.len() / 2).copied().unwrap_or(1.0).max(1e-6)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use image::{GrayImage, Luma, RgbImage};

    use super::*;
    use dvr_core::{Camera, Mask, stored};

    /// A view of this width, square, that shows a disc; a pixel is about 1.4 / `size` wide at the object.
    fn view(size: u32) -> View {
        let camera = Camera::look_at(size, size, 1.5 * f64::from(size), DVec3::Z * 2.0, DVec3::ZERO, DVec3::Y);
        let middle = 0.5 * f64::from(size);
        let distance = |u: u32, v: u32| (f64::from(u) + 0.5 - middle).hypot(f64::from(v) + 0.5 - middle);
        let is_object = |u, v| distance(u, v) < 0.3 * f64::from(size);
        let mask = GrayImage::from_fn(size, size, |u, v| Luma([if is_object(u, v) { 255 } else { 0 }]));
        View::new(format!("{size}"), camera, stored(RgbImage::new(size, size)), Mask::from(mask))
    }

    #[test]
    fn coarse_cells_look_at_shrunk_photographs_and_fine_ones_at_whole_ones() {
        let view = view(800);
        let pyramid = PicturePyramid::new(vec![&view], 2, 0.03);
        // Cells of 19, 9.7, 4.8 and 2.4 pixels.
        assert_eq!([32, 64, 128, 256].map(|cells| pyramid.factor(cells)), [4, 2, 1, 1]);
    }

    #[test]
    fn small_photographs_stay_whole() {
        let view = view(60);
        let pyramid = PicturePyramid::new(vec![&view], 2, 0.2);
        assert_eq!(pyramid.factor(2), 1);
        assert_eq!(PicturePyramid::new(Vec::new(), 2, 0.2).factor(32), 1);
    }

    #[test]
    fn a_level_draws_the_same_part_of_the_picture_at_any_size() {
        let view = view(256);
        let masks = [view.training_pair().map(|(camera, mask)| MaskDistance::new(camera, mask)).unwrap()];
        let pyramid = PicturePyramid::new(vec![&view], 2, 0.03);
        let [whole, half] = [1, 2].map(|factor| pyramid.level(factor, &masks));
        assert_eq!((half.views[0].size(), half.factor), ([128, 128], 2));
        let share = |level: &PyramidLevel| {
            let [width, height] = level.views[0].size();
            level.order.len() as f64 / f64::from(width * height)
        };
        assert!((share(&whole) - share(&half)).abs() < 0.02, "{} {}", share(&whole), share(&half));
        // More than the disc, whose share is .28, less than all.
        assert!((0.3..0.8).contains(&share(&half)), "{}", share(&half));
    }
}
