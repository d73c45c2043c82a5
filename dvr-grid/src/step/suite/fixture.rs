//! A painted ball in photographs, and grids that are a little off.

use std::sync::Arc;

use dvr_core::hull::MaskDistance;
use dvr_core::voxel::VoxelGrid;
use dvr_core::{Camera, Cancellation, DepthMap, Exposure, Mask, Supervision, View, stored};
use dvr_render::SlopeRule;
use glam::DVec3;
use image::{GrayImage, Rgb, RgbImage};

use crate::accelerator::Accelerator;
use crate::active::ActiveNodes;
use crate::bricks::near_refined_surface;
use crate::clock::PartTimes;
use crate::color::{self, CHANNELS};
use crate::config::GridConfig;
use crate::losses::GridLosses;
use crate::multires::{ColorGrid, Grids, ShapeGrid};
use crate::pixel_order::{PixelOrder, mix};
use crate::start::{MaskDistances, hull_start};
use crate::step::backend::StepInput;
use crate::views::TrainingView;

/// Pixels along the side of a photograph.
pub(crate) const SIZE: u32 = 96;

/// The true ball.
const TRUE_RADIUS: f64 = 0.3;

/// Colour painted on the true ball: texture in every direction.
fn paint(point: DVec3) -> [f64; 3] {
    [
        0.5 + 0.3 * (11.0 * point.x + 3.0 * point.y).sin(),
        0.5 + 0.3 * (9.0 * point.y - 4.0 * point.z).cos(),
        0.5 + 0.3 * (10.0 * point.z + point.x).sin(),
    ]
}

/// The same with speckles some pixels large, which only fit where they are.
fn speckles(point: DVec3) -> [f64; 3] {
    paint(point).map(|channel| channel + 0.15 * (60.0 * point.x).sin() * (55.0 * point.y + 20.0 * point.z).sin())
}

/// A photograph of the true ball, with its depth map.
fn view(eye: DVec3, paint: fn(DVec3) -> [f64; 3]) -> View {
    let camera = Camera::look_at(SIZE, SIZE, 130.0, eye, DVec3::ZERO, DVec3::new(0.1, 1.0, 0.0));
    let (mut image, mut mask) = (RgbImage::new(SIZE, SIZE), GrayImage::new(SIZE, SIZE));
    let mut z_depth = vec![f32::INFINITY; (SIZE * SIZE) as usize];
    for (v, u) in (0..SIZE).flat_map(|v| (0..SIZE).map(move |u| (v, u))) {
        let ray = camera.pixel_ray(u, v);
        let (a, b) = (ray.direction.length_squared(), ray.origin.dot(ray.direction));
        let root = b * b - a * (ray.origin.length_squared() - TRUE_RADIUS * TRUE_RADIUS);
        if root > 0.0 {
            let depth = (-b - root.sqrt()) / a;
            image.put_pixel(u, v, Rgb(paint(ray.at(depth)).map(|c| (255.0 * c).round() as u8)));
            mask.put_pixel(u, v, image::Luma([255]));
            let index = v * SIZE + u;
            // Depth maps have gaps.
            z_depth[index as usize] = if index.is_multiple_of(7) { f32::NAN } else { depth as f32 };
        }
    }
    let depth = Some(DepthMap { width: SIZE, height: SIZE, z_depth });
    View { depth, ..View::new(eye.to_string(), camera, stored(image), Mask::from(mask)) }
}

/// So many photographs of the true ball, speckled, eleven degrees apart: near enough for stereo.
pub(crate) fn speckled_arc(views: usize) -> Vec<View> {
    let eye = |turn: f64| DVec3::new(1.5 * turn.sin(), 0.3, -1.5 * turn.cos());
    (0..views).map(|i| view(eye(0.2 * i as f64), speckles)).collect()
}

/// Photographs, grids and settings of a step.
pub(crate) struct Fixture {
    pub config: GridConfig,
    pub pictures: Vec<&'static View>,
    pub views: Vec<TrainingView<'static>>,
    pub order: PixelOrder,
    pub grids: Grids,
    pub rays_drawn: u64,
    pub slope_rule: SlopeRule,
    pub is_reported: bool,
}

impl Fixture {
    fn new(
        eyes: impl Iterator<Item = DVec3>,
        paint: fn(DVec3) -> [f64; 3],
        config: GridConfig,
        grids: impl Fn(&[MaskDistance]) -> Grids,
    ) -> Self {
        let views: &'static [View] = eyes.map(|eye| view(eye, paint)).collect::<Vec<View>>().leak();
        let references: Vec<&View> = views.iter().collect();
        let masks: Vec<MaskDistance> = views
            .iter()
            .filter_map(View::training_pair)
            .map(|(camera, mask)| MaskDistance::new(camera, mask))
            .collect();
        let views = TrainingView::pack(&references, 2, 1);
        Self {
            config,
            order: PixelOrder::new(&views, 1, &masks, |_| 6.0),
            views,
            grids: grids(&masks),
            pictures: references,
            rays_drawn: 0,
            slope_rule: SlopeRule::default(),
            is_reported: true,
        }
    }

    /// A ball of another radius than the true one, before three cameras close to each other; each pixel at and around
    /// the object is drawn once. Everything is active.
    pub fn ball(radius: f32, losses: GridLosses) -> Self {
        Self::painted_ball(radius, losses, paint)
    }

    /// The same with speckles.
    pub fn speckled_ball(radius: f32, losses: GridLosses) -> Self {
        Self::painted_ball(radius, losses, speckles)
    }

    fn painted_ball(radius: f32, losses: GridLosses, paint: fn(DVec3) -> [f64; 3]) -> Self {
        let eyes = [DVec3::new(0.0, 0.0, -1.6), DVec3::new(0.3, 0.1, -1.57), DVec3::new(-0.25, 0.2, -1.56)];
        let grids = |_: &[MaskDistance]| {
            let (shape, colors) = (VoxelGrid::new(33, 0.55), VoxelGrid::new(17, 0.55));
            let values: Vec<f32> = (0..shape.len()).map(|i| radius - shape.position(i).length()).collect();
            let color = |i: usize| {
                let painted = paint(0.98 * colors.position(i).as_dvec3());
                color::constant(painted.map(|c| 0.1 + 0.7 * c as f32))
            };
            let color_values: Vec<f32> = (0..colors.len()).flat_map(color).collect();
            let inner = |grid: &VoxelGrid| {
                let last = grid.nodes() - 1;
                ActiveNodes::new(grid, |node| grid.coordinates(node).iter().all(|&c| c > 0 && c < last))
            };
            let (active, colored) = (inner(&shape), inner(&colors));
            Grids { shape: ShapeGrid::new(active, &values, 0), color: ColorGrid::new(colored, &color_values, 0) }
        };
        let config = GridConfig { rays: 1, losses, ..GridConfig::new(Supervision::RgbDepth) };
        let mut fixture = Self::new(eyes.into_iter(), paint, config, grids);
        fixture.config.rays = fixture.order.len();
        fixture
    }

    /// The ball's hull from ten sides, on grids of three levels of shape and two of colour, with all losses, depth maps
    /// with gaps, and one more view to compare with than there are. `noise` is added to its distances, in spacings: with
    /// it, rays cross the surface many times.
    pub fn hull(noise: f32, rays: usize) -> Self {
        let eye = |i: usize| {
            let (turn, height) = (0.55 * i as f64, 0.7 * (0.9 * i as f64).sin());
            DVec3::new(1.5 * turn.sin(), height, -1.5 * turn.cos())
        };
        let grids = |masks: &[MaskDistance]| {
            let grid = VoxelGrid::new(33, 0.55);
            let masks = MaskDistances::new(masks.to_vec(), &mut Accelerator::default()).unwrap();
            let (mut base, active) = hull_start(&masks, &grid, 0, None, None, &Cancellation::default()).unwrap();
            for node in active.iter() {
                base[node] += noise * grid.spacing() * (mix(node as u64) as f32 / u64::MAX as f32 - 0.5);
            }
            let shape = ShapeGrid::new(active, &base, 2);
            let colored = shape.active().coarser();
            let gray = vec![0.5; CHANNELS * colored.grid().len()];
            Grids { shape, color: ColorGrid::new(colored, &gray, 1) }
        };
        let config = GridConfig {
            rays,
            compared_views: 3,
            losses: GridLosses::all_for_tests(),
            ..GridConfig::new(Supervision::RgbDepth)
        };
        Self::new((0..10).map(eye), paint, config, grids)
    }

    /// Gives each view another exposure.
    pub fn expose(&mut self) {
        for (i, view) in self.views.iter_mut().enumerate() {
            view.exposure = Exposure::from_logs([0.3, -0.1, 0.2].map(|log| log * (i as f64 - 4.0) / 5.0));
        }
    }

    /// Shrinks the photographs to half their size.
    pub fn shrink(&mut self) {
        let pairs = self.pictures.iter().filter_map(|view| view.training_pair());
        let masks: Vec<MaskDistance> = pairs.map(|(camera, mask)| MaskDistance::new(camera, mask)).collect();
        self.views = TrainingView::pack(&self.pictures, 2, 2);
        self.order = PixelOrder::new(&self.views, 2, &masks, |_| 6.0);
    }

    /// Goes on to twice the cells, some times: only a band around the surface learns then, which starts with a little
    /// noise.
    pub fn refine(&mut self, times: usize) {
        for _ in 0..times {
            let Grids { shape, color } = &self.grids;
            let (learned, colors) = (Arc::new(shape.values().clone()), Arc::new(color.values().clone()));
            let grid = VoxelGrid::new(2 * shape.grid().cells() + 1, 0.55);
            let near = near_refined_surface(&grid, &learned, 3);
            let noise = |node: usize| 0.2 * grid.spacing() * (mix(node as u64) as f32 / u64::MAX as f32 - 0.5);
            let detail: Vec<f32> = near.iter().map(noise).collect();
            self.grids = Grids {
                color: ColorGrid::on_frozen_base(near.coarser(), colors, &[], color.coarser() + 1),
                shape: ShapeGrid::on_frozen_base(near, learned, &detail, shape.coarser() + 1),
            };
        }
    }

    /// What the next step needs to know.
    pub fn input<'a>(&'a self, times: &'a mut PartTimes) -> StepInput<'a> {
        StepInput {
            config: &self.config,
            views: &self.views,
            order: &self.order,
            rays_drawn: self.rays_drawn,
            mean_color: [0.4, 0.5, 0.6],
            decay: 1.0,
            warm_up: 1.0,
            slope_rule: self.slope_rule,
            is_reported: self.is_reported,
            times,
        }
    }

    /// The grids with all values of the shape raised.
    pub fn raised(&self, change: f32) -> Grids {
        let mut grids = self.grids.clone();
        let values: Vec<f32> = grids.shape.values().to_dense().iter().map(|value| value + change).collect();
        grids.shape = ShapeGrid::new(grids.shape.active().clone(), &values, 0);
        grids
    }

    /// The grids with all values of a channel of the colour raised.
    pub fn tinted(&self, channel: usize, change: f32) -> Grids {
        let mut grids = self.grids.clone();
        let raised = |(i, value): (usize, &f32)| value + if i % CHANNELS == channel { change } else { 0.0 };
        let values: Vec<f32> = grids.color.values().to_dense().iter().enumerate().map(raised).collect();
        grids.color = ColorGrid::new(grids.color.active().clone(), &values, 0);
        grids
    }
}
