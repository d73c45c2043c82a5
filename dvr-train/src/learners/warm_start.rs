//! A first shape for the network: the visual hull of the masks, fitted as plain occupancy.
//!
//! A network that starts from noise has to find the object before it can refine it, and thin objects are lost on the
//! way: no ray hits them, so no ray moves them. The hull is cheap, needs nothing but masks and cameras, and contains
//! the object.

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::hull::{HullSettings, VisualHull};
use dvr_core::{Cancellation, Cancelled, UnitCube, View};
use dvr_render::{Field, Query, SkipGrid};
use glam::Vec3;
use rand::Rng;

use crate::config::TrainConfig;
use crate::learners::adam::adam;
use crate::learners::losses;
use crate::learners::trainer::step_rng;

/// Half of the points lie in the whole cube, half beside a hull voxel, where the surface is.
const SHARE_NEAR: f64 = 0.5;

/// Fits the occupancy of `field` to the hull of the views' masks. `progress` hears the step after each.
///
/// # Errors
/// [`Cancelled`] where somebody wants it to end.
pub fn warm_start<F: Field + Module>(
    mut field: F,
    hull: &VisualHull,
    config: &TrainConfig,
    device: &Device,
    cancellation: &Cancellation,
    mut progress: impl FnMut(usize),
) -> Result<F, Cancelled> {
    let voxels: Vec<Vec3> = hull.centers().map(|center| center.as_vec3()).collect();
    if voxels.is_empty() {
        return Ok(field);
    }
    let settings = &config.hull;
    let mut optimizer = adam();
    // A stream of its own, far from those of the steps.
    let mut rng = step_rng(config.seed, u64::MAX);
    let half = UnitCube::default().half_extent() as f32;
    let reach = 4.0 * 2.0 * half / settings.resolution as f32;
    for step in 0..settings.warm_start_steps {
        let mut points = Vec::with_capacity(3 * settings.warm_start_points);
        let mut sign = Vec::with_capacity(settings.warm_start_points);
        for _ in 0..settings.warm_start_points {
            let noise = Vec3::new(rng.random(), rng.random(), rng.random()) * 2.0 - 1.0;
            let point = if rng.random_bool(SHARE_NEAR) {
                (voxels[rng.random_range(0..voxels.len())] + noise * reach).clamp(Vec3::splat(-half), Vec3::splat(half))
            } else {
                noise * half
            };
            points.extend(point.to_array());
            sign.push(if hull.contains(point.as_dvec3()) { 1.0f32 } else { -1.0 });
        }
        let n = settings.warm_start_points;
        let query = Query::new(Tensor::from_data(TensorData::new(points, [n, 3]), &device.clone().autodiff()));
        let sign = Tensor::<1>::from_data(TensorData::new(sign, [n]), &device.clone().autodiff());
        let loss = losses::known_occupancy(field.occupancy_logit(&query), sign) / n as f64;
        let gradients = GradientsParams::from_grads(loss.backward(), &field);
        field = optimizer.step(config.learning_rate, field, gradients);
        progress(step + 1);
        cancellation.check()?;
    }
    Ok(field)
}

/// The hull of some views in the unit cube.
///
/// Masks may be wrong by a pixel, and one view in twenty altogether: a hull that is a little too fat costs some steps,
/// one that lacks a part may cost the part.
///
/// # Errors
/// When a mask has another size than its camera's image.
pub fn carve_hull(views: &[&View], resolution: usize) -> crate::error::Result<VisualHull> {
    let pairs: Vec<_> = views.iter().filter_map(|view| view.training_pair()).collect();
    let settings = HullSettings { max_disagreeing: views.len() / 20, ..HullSettings::default() };
    Ok(VisualHull::carve(&pairs, UnitCube::default().into(), resolution, &settings)?)
}

/// Where the object can be: the hull and a voxel around it, or `None` where it is empty.
pub fn hull_bound(hull: &VisualHull) -> Option<SkipGrid> {
    let may_hold = |voxel| hull.voxel(voxel);
    (!hull.is_empty()).then(|| SkipGrid::of_cells(UnitCube::default(), hull.resolution(), may_hold))
}
