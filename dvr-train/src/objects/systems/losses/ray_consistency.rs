//! Rays through voxels against what a view shows (Tulsiani et al. 2017, Differentiable Ray Consistency).

use burn::tensor::Tensor;
use dvr_core::Ray;
use dvr_core::voxel::{VoxelGrid, VoxelTraversal};
use rayon::prelude::*;

use super::surrogate::with_gradient;

/// What it costs that a ray passes where it should meet the object, or meets something where it should pass, with depths:
/// an edge of the object cube.
const ESCAPE_COST: f64 = 1.0;

/// A ray and what its pixel shows.
#[derive(Clone, Copy, Debug)]
pub struct VoxelRay {
    /// In object space; its depth is z-depth.
    pub ray: Ray,
    /// Whether it meets the object.
    pub is_object: bool,
    /// At which depth, where that is learned from.
    pub z_depth: Option<f32>,
}

/// The mean cost of rays through voxels of logits `[b, n, n, n]`, `[1]`, x fastest; `rays` are those of each object.
pub(crate) fn ray_consistency(logits: &Tensor<4>, rays: &[Vec<VoxelRay>], grid: &VoxelGrid) -> Tensor<1> {
    let voxels = grid.cells().pow(3);
    let data: Vec<f32> = logits.clone().inner().into_data().iter::<f32>().collect();
    let count = rays.iter().map(Vec::len).sum::<usize>().max(1) as f64;
    let of_each: Vec<(f64, Vec<f64>)> = data
        .par_chunks(voxels)
        .zip(rays)
        .map(|(logits, rays)| {
            let occupancy: Vec<f64> = logits.iter().map(|&logit| 1.0 / (1.0 + f64::from(-logit).exp())).collect();
            let mut gradient = vec![0.0; voxels];
            let cost = rays.iter().map(|ray| ray_cost(&occupancy, ray, grid, &mut gradient)).sum::<f64>();
            for (gradient, o) in gradient.iter_mut().zip(&occupancy) {
                *gradient *= o * (1.0 - o) / count;
            }
            (cost / count, gradient)
        })
        .collect();
    let value = of_each.iter().map(|(cost, _)| cost).sum();
    let gradient = of_each.iter().flat_map(|(_, gradient)| gradient).map(|&g| g as f32).collect();
    with_gradient(value, logits.clone(), gradient)
}

/// The expected cost of one ray through voxels of these occupancies (the paper's equations 2 to 6); adds its gradient by
/// them.
///
/// A ray ends in voxel `i` with probability `o_i` times those of passing all before it. With the cost `c_i` of ending there, what is
/// expected from voxel `i` on is `e_i = o_i c_i + (1 - o_i) e_(i+1)`, and the derivative by `o_i` is the probability of
/// coming so far times `c_i - e_(i+1)`.
fn ray_cost(occupancy: &[f64], ray: &VoxelRay, grid: &VoxelGrid, gradient: &mut [f64]) -> f64 {
    let VoxelRay { ray, is_object, z_depth } = ray;
    let n = grid.cells();
    let walk = VoxelTraversal::new(grid, ray.origin.as_vec3(), ray.direction.as_vec3(), 0.0, f32::MAX);
    let passed: Vec<(usize, f64)> = walk
        .into_iter()
        .flatten()
        .map(|segment| {
            let [x, y, z] = segment.cell;
            let cost = match (is_object, z_depth) {
                (false, None) => 1.0,
                (false, Some(_)) => ESCAPE_COST,
                (true, None) => 0.0,
                (true, Some(depth)) => (f64::from(segment.enter.midpoint(segment.leave)) - f64::from(*depth)).abs(),
            };
            (x + n * (y + n * z), cost)
        })
        .collect();
    let escape = match (is_object, z_depth) {
        (false, _) => 0.0,
        (true, None) => 1.0,
        (true, Some(_)) => ESCAPE_COST,
    };
    let mut expected = vec![escape; passed.len() + 1];
    for (i, (voxel, cost)) in passed.iter().enumerate().rev() {
        let o = occupancy[*voxel];
        expected[i] = o * cost + (1.0 - o) * expected[i + 1];
    }
    let mut reached = 1.0;
    for (i, (voxel, cost)) in passed.iter().enumerate() {
        gradient[*voxel] += reached * (cost - expected[i + 1]);
        reached *= 1.0 - occupancy[*voxel];
    }
    expected[0]
}

/// The voxels of the padded cube, as cells of a grid.
pub(crate) fn voxel_grid(voxels: usize) -> VoxelGrid {
    VoxelGrid::new(voxels + 1, dvr_core::UnitCube::default().half_extent() as f32)
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, TensorData};
    use glam::DVec3;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn random_rays(rng: &mut ChaCha8Rng, count: usize) -> Vec<VoxelRay> {
        let mut unit = || DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        let directions: Vec<(DVec3, DVec3)> = (0..count).map(|_| (unit().normalize() * 2.0, unit() * 0.3)).collect();
        let ray = |(i, (origin, aim)): (usize, &(DVec3, DVec3))| VoxelRay {
            ray: Ray { origin: *origin, direction: (*aim - *origin).normalize() },
            is_object: i % 2 == 0,
            z_depth: (i % 3 == 0).then_some(if i % 2 == 0 { 1.9 } else { f32::INFINITY }),
        };
        directions.iter().enumerate().map(ray).collect()
    }

    #[test]
    fn the_gradient_is_that_of_differences() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let grid = voxel_grid(6);
        let mut occupancy: Vec<f64> = (0..216).map(|_| rng.random_range(0.02..0.98)).collect();
        for ray in random_rays(&mut rng, 60) {
            let mut gradient = vec![0.0; 216];
            ray_cost(&occupancy, &ray, &grid, &mut gradient);
            let mut nothing = vec![0.0; 216];
            for voxel in (0..216).filter(|v| gradient[*v] != 0.0).collect::<Vec<_>>() {
                let here = occupancy[voxel];
                let mut at = |shift: f64| {
                    occupancy[voxel] = here + shift;
                    ray_cost(&occupancy, &ray, &grid, &mut nothing)
                };
                let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
                occupancy[voxel] = here;
                assert!((difference - gradient[voxel]).abs() < 1e-6, "{difference} {}", gradient[voxel]);
            }
        }
    }

    #[test]
    fn a_solid_block_costs_nothing_where_rays_meet_it_and_all_where_they_should_pass() {
        let grid = voxel_grid(4);
        let towards = |is_object, z_depth| VoxelRay {
            ray: Ray { origin: DVec3::new(0.1, 0.1, -2.0), direction: DVec3::Z },
            is_object,
            z_depth,
        };
        let cost = |ray| ray_cost(&[1.0; 64], &ray, &grid, &mut [0.0; 64]);
        assert_eq!(cost(towards(true, None)), 0.0);
        assert_eq!(cost(towards(false, None)), 1.0);
        // The first voxel's middle lies at a depth of 2 - .55 + .1375.
        assert!((cost(towards(true, Some(1.5875 - 0.2))) - 0.2).abs() < 1e-6);
        let empty = ray_cost(&[0.0; 64], &towards(true, Some(1.5)), &grid, &mut [0.0; 64]);
        assert_eq!(empty, ESCAPE_COST);
        let beside =
            VoxelRay { ray: Ray { origin: DVec3::new(2.0, 0.0, -2.0), direction: DVec3::Z }, ..towards(true, None) };
        assert_eq!(cost(beside), 1.0, "a ray that misses the cube passes");
    }

    #[test]
    fn voxels_learn_a_ball_from_its_silhouettes_and_depths() {
        let device = Device::flex().autodiff();
        let grid = voxel_grid(8);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let rays = |rng: &mut ChaCha8Rng| -> Vec<VoxelRay> {
            let mut all = random_rays(rng, 400);
            for ray in &mut all {
                // Where the ray meets a ball of radius .35.
                let (b, c) = (ray.ray.origin.dot(ray.ray.direction), ray.ray.origin.length_squared() - 0.35 * 0.35);
                ray.is_object = b * b > c;
                ray.z_depth = Some(if ray.is_object { (-b - (b * b - c).sqrt()) as f32 } else { f32::INFINITY });
            }
            all
        };
        let mut logits =
            Tensor::<4>::from_data(TensorData::new(vec![-2f32; 512], [1, 8, 8, 8]), &device).require_grad();
        let mut last = f32::MAX;
        for step in 0..60 {
            let loss = ray_consistency(&logits, &[rays(&mut rng)], &grid);
            if step % 59 == 0 {
                let now = loss.clone().into_scalar::<f32>();
                assert!(now < 0.6 * last, "{now} {last}");
                last = now;
            }
            let gradient = logits.grad(&loss.backward()).unwrap();
            let moved = logits.inner() - gradient * 200.0;
            logits = Tensor::from_inner(moved).require_grad();
        }
        let values: Vec<f32> = logits.into_data().iter::<f32>().collect();
        // A voxel that the ball's front passes is solid, and one beside it empty.
        assert!(values[4 + 8 * (4 + 8 * 6)] > 0.0 && values[7 + 8 * (7 + 8 * 7)] < 0.0);
    }
}
