//! Gradients by hand against differences of the losses themselves.

use crate::active::ActiveNodes;
use crate::occupancy::OccupancyBitmask;
use dvr_core::voxel::VoxelGrid;
use dvr_core::{Camera, DepthMap, Mask, stored};
use glam::DVec3;
use image::{GrayImage, Rgb, RgbImage};

use super::*;

/// The true ball; the field's is a little larger, so that all losses pull.
const TRUE_RADIUS: f64 = 0.3;
const RADIUS: f32 = 0.31;

/// Colour painted on the true ball: structure in every direction.
fn paint(point: DVec3) -> [f64; 3] {
    [
        0.5 + 0.3 * (11.0 * point.x + 3.0 * point.y).sin(),
        0.5 + 0.3 * (9.0 * point.y - 4.0 * point.z).cos(),
        0.5 + 0.3 * (10.0 * point.z + point.x).sin(),
    ]
}

/// A photograph of the true ball, with its depth map.
pub(crate) fn view(eye: DVec3) -> View {
    let size = 96;
    let camera = Camera::look_at(size, size, 130.0, eye, DVec3::ZERO, DVec3::new(0.1, 1.0, 0.0));
    let (mut image, mut mask) = (RgbImage::new(size, size), GrayImage::new(size, size));
    let mut z_depth = vec![f32::INFINITY; (size * size) as usize];
    for v in 0..size {
        for u in 0..size {
            let ray = camera.pixel_ray(u, v);
            let (a, b) = (ray.direction.length_squared(), ray.origin.dot(ray.direction));
            let root = b * b - a * (ray.origin.length_squared() - TRUE_RADIUS * TRUE_RADIUS);
            if root > 0.0 {
                let depth = (-b - root.sqrt()) / a;
                image.put_pixel(u, v, Rgb(paint(ray.at(depth)).map(|c| (255.0 * c).round() as u8)));
                mask.put_pixel(u, v, image::Luma([255]));
                z_depth[(v * size + u) as usize] = depth as f32;
            }
        }
    }
    let depth = Some(DepthMap { width: size, height: size, z_depth });
    let (image, mask) = (stored(image), Mask::from(mask));
    View { depth, ..View::new(eye.to_string(), camera, image, mask) }
}

/// A ball on a grid, and three cameras close to each other.
struct Fixture {
    views: Vec<View>,
    shape: VoxelGrid,
    values: Vec<f32>,
    active: Vec<bool>,
    colors: VoxelGrid,
    color_values: Vec<f32>,
}

impl Fixture {
    fn new() -> Self {
        let eyes = [DVec3::new(0.0, 0.0, -1.6), DVec3::new(0.3, 0.1, -1.57), DVec3::new(-0.25, 0.2, -1.56)];
        let (shape, colors) = (VoxelGrid::new(33, 0.55), VoxelGrid::new(17, 0.55));
        let values: Vec<f32> = (0..shape.len()).map(|i| RADIUS - shape.position(i).length()).collect();
        let color = |i: usize| paint(0.98 * colors.position(i).as_dvec3()).map(|c| 0.1 + 0.7 * c as f32);
        Self {
            views: eyes.into_iter().map(view).collect(),
            active: vec![true; shape.len()],
            color_values: (0..colors.len()).flat_map(color).collect(),
            shape,
            values,
            colors,
        }
    }

    fn views(&self) -> Vec<TrainingView<'_>> {
        TrainingView::pack(&self.views.iter().collect::<Vec<_>>(), 2)
    }

    /// The ray_gradient and the weighted loss of a pixel of the first view, with the whole field raised by `change`: a single
    /// node would tilt the plane of a patch too, which the gradient leaves out on purpose.
    fn look(&self, pixel: u32, losses: &GridLosses, change: f32) -> (Option<RayGradient>, f64) {
        let values: Vec<f32> = self.values.iter().map(|value| value + change).collect();
        let map = OccupancyBitmask::new(&self.shape, &values);
        let views = self.views();
        let scene = Scene {
            views: &views,
            shape: &self.shape,
            values: &values,
            active: &self.active,
            map: &map,
            colors: &self.colors,
            color_values: &self.color_values,
            losses,
            compared_views: 2,
        };
        let mut sums = LossSums::default();
        let ray_gradient = scene.ray_gradient(&views[0].pixel_ray(0, pixel), 7, &mut sums);
        let loss = losses.color * sums.color
            + 0.5 * losses.photo_consistency * sums.photo_consistency
            + 0.5 * losses.patch_ncc * sums.patch_ncc
            + losses.depth * sums.depth
            + losses.mask * sums.mask;
        (ray_gradient, loss)
    }

    /// The gradient of a pixel's loss by the field's value at its point: by hand, and by differences.
    fn gradients(&self, pixel: u32, losses: &GridLosses) -> (f64, f64) {
        let by_hand = self.look(pixel, losses, 0.0).0.expect("the pixel teaches").grad_value;
        let step = 2e-4;
        let loss = |change| self.look(pixel, losses, change).1;
        (f64::from(by_hand), (loss(step) - loss(-step)) / (2.0 * f64::from(step)))
    }
}

fn nothing() -> GridLosses {
    GridLosses {
        color: 0.0,
        texture: 0.0,
        photo_consistency: 0.0,
        patch_ncc: 0.0,
        depth: 0.0,
        mask: 0.0,
        ..GridLosses::default()
    }
}

/// Compares on pixels in the middle of the ball; the damping of grazing rays and f32 differences leave a few percent.
/// `slack` is a share of the largest gradient.
fn check(losses: &GridLosses, slack: f64) {
    let fixture = Fixture::new();
    let (mut compared, mut size) = (0, 0.0f64);
    for pixel in (36..60).step_by(5).flat_map(|v| (38..60).step_by(4).map(move |u| v * 96 + u)) {
        let (by_hand, difference) = fixture.gradients(pixel, losses);
        let tolerance = 0.05 * (by_hand.abs() + difference.abs()) + slack * size.max(0.1);
        // Piecewise linear losses have kinks (a channel's sign, a pixel's border) that differences step over.
        compared += usize::from((by_hand - difference).abs() < tolerance);
        size = size.max(difference.abs());
    }
    assert!(size > 0.05, "the loss depends on the field: {size}");
    assert!(compared >= 26, "{compared} of 30 agree");
}

#[test]
fn colour_moves_the_surface_as_differences_say() {
    check(&GridLosses { color: 1.0, ..nothing() }, 0.02);
}

#[test]
fn cross_view_colour_moves_the_surface_as_differences_say() {
    check(&GridLosses { photo_consistency: 1.0, photo_consistency_limit: 3.0, ..nothing() }, 0.02);
}

#[test]
fn structure_moves_the_surface_as_differences_say() {
    // The surface turns a little as the point moves on the ball; the gradient takes its plane for fixed.
    check(&GridLosses { patch_ncc: 1.0, patch_ncc_min: -1.0, ..nothing() }, 0.2);
}

#[test]
fn depth_moves_the_surface_as_differences_say() {
    check(&GridLosses { depth: 1.0, ..nothing() }, 0.02);
}

#[test]
fn masks_push_the_densest_point_in_or_out() {
    let mut fixture = Fixture::new();
    let losses = GridLosses { mask: 1.0, ..nothing() };
    // A ray just beside the true ball meets the field's, which is larger.
    let pixel = (0..96).map(|u| 48 * 96 + u).find(|&p| {
        let object = fixture.views[0].is_object(p % 96, p / 96);
        !object && fixture.look(p, &losses, 0.0).0.is_some()
    });
    let (ray_gradient, loss) = fixture.look(pixel.unwrap(), &losses, 0.0);
    assert!(ray_gradient.unwrap().grad_value > 0.0 && loss > 0.5, "pushed out");
    // The same ball shrunk: object pixels at its rim miss.
    fixture.values.iter_mut().for_each(|v| *v -= 0.05);
    let pixel = (0..96).map(|u| 48 * 96 + u).find(|&p| fixture.views[0].is_object(p % 96, p / 96)).unwrap();
    let (by_hand, difference) = fixture.gradients(pixel, &losses);
    assert!(by_hand < 0.0, "pulled in");
    assert!((by_hand - difference).abs() < 0.05 * difference.abs(), "{by_hand} {difference}");
}

#[test]
fn other_cells_are_left_alone() {
    let fixture = Fixture::new();
    let active = ActiveNodes::new(&fixture.shape, |_| true);
    let ray_gradients = [fixture.look(48 * 96 + 48, &GridLosses::default(), 0.0).0.unwrap()];
    let mut gradient = vec![0.0; fixture.shape.len()];
    crate::step::gather::gather_shape(&ray_gradients, &active, &fixture.active, &mut gradient);
    let touched: Vec<usize> = (0..gradient.len()).filter(|&i| gradient[i] != 0.0).collect();
    let cell = ray_gradients[0].shape_cell;
    assert!(!touched.is_empty() && touched.iter().all(|i| fixture.shape.corner_offsets().contains(&(i - cell.node))));
    let sum: f32 = gradient.iter().sum();
    assert!((sum - ray_gradients[0].grad_value).abs() < 1e-3 * sum.abs(), "weights sum to one, slopes to zero");
}
