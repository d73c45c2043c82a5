//! Silhouettes that a carved solid still has to explain.
//!
//! A pixel that shows the object meets it somewhere on its ray (silhouette consistency: Cremers and Kolev 2011). Votes do
//! not know that: where they carve a thin wall away, rays of object pixels pass through the hull and meet nothing.

use dvr_core::voxel::VoxelGrid;
use glam::Vec3;
use rayon::prelude::*;

use super::carving_votes::nodes_along;
use super::plane_sweep::SweptPixel;
use crate::views::TrainingView;

/// The ray of a pixel that shows the object: where it starts, and the rest.
pub(super) type ObjectRay<'a> = (Vec3, &'a SweptPixel);

/// The rays that meet nothing solid. `hull` holds the hull's distance at the nodes of `grid`, positive inside.
pub(super) fn unexplained<'a>(
    views: &[TrainingView],
    swept: &'a [Vec<SweptPixel>],
    grid: &VoxelGrid,
    hull: &[f32],
    solid: &[bool],
) -> Vec<ObjectRay<'a>> {
    let of_view = |(pixels, view): (&'a Vec<SweptPixel>, &TrainingView)| -> Vec<ObjectRay<'a>> {
        let rays = pixels.iter().map(|pixel| (view.camera.center, pixel));
        rays.filter(|&ray| !way(grid, hull, ray).any(|node| solid[node])).collect()
    };
    swept.par_iter().zip(views).map(of_view).collect::<Vec<_>>().concat()
}

/// The nodes of the hull that a ray passes.
pub(super) fn way<'a>(
    grid: &'a VoxelGrid,
    hull: &'a [f32],
    (origin, pixel): ObjectRay<'a>,
) -> impl Iterator<Item = usize> + 'a {
    let diagonal = 2.0 * 3f32.sqrt() * grid.half_extent();
    let end = pixel.near + diagonal / pixel.direction.length();
    nodes_along(origin, pixel, grid, end).map(|(_, node)| node).filter(move |&node| hull[node] > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::losses::GridLosses;
    use crate::step::suite::Fixture;

    #[test]
    fn a_ray_is_explained_by_whatever_is_solid_on_its_way_through_the_hull() {
        let fixture = Fixture::ball(0.3, GridLosses::default());
        let grid = VoxelGrid::new(23, 0.55);
        let hull: Vec<f32> = (0..grid.len()).map(|node| 0.3 - grid.position(node).length()).collect();
        let origin = fixture.views[0].camera.center;
        let towards = |target: Vec3| {
            let direction = target - origin;
            SweptPixel { direction, near: 1.0 - 0.3 / direction.length(), depth: None }
        };
        let swept = vec![vec![towards(Vec3::ZERO), towards(0.2 * origin.any_orthonormal_vector())]];
        let middle = grid.index([11; 3]);
        let mut solid = vec![false; grid.len()];
        let rays = |solid: &[bool]| unexplained(&fixture.views, &swept, &grid, &hull, solid).len();
        assert_eq!(rays(&solid), 2);
        solid[middle] = true;
        assert_eq!(rays(&solid), 1, "the ray through the middle meets it");
        let passed: Vec<usize> = way(&grid, &hull, (origin, &swept[0][0])).collect();
        assert!(passed.contains(&middle) && passed.iter().all(|&node| hull[node] > 0.0), "{passed:?}");
    }
}
