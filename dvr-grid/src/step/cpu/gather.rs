//! From gradients at points to gradients at nodes.

use dvr_core::voxel::Cell;
use rayon::prelude::*;

use super::rays::RayGradient;
use crate::bricks::{BrickLayout, EDGE, Row};
use crate::color::CHANNELS;

/// Rows that one task clears, and ray gradients whose nodes one task looks up.
const CHUNK: usize = 1 << 10;

/// Where nothing is added.
const NONE: u32 = u32::MAX;

/// Adds up the ray gradients by the shape at each active node; `gradient`, of the rows with active nodes, is
/// overwritten.
pub(crate) fn gather_shape(ray_gradients: &[RayGradient], layout: &BrickLayout, gradient: &mut [Row<1>]) {
    let corners =
        |ray_gradient: &RayGradient| ray_gradient.shape_cell.weights().map(|weight| [weight * ray_gradient.grad_value]);
    gather::<1>(ray_gradients, layout, gradient, |ray_gradient| ray_gradient.shape_cell, corners);
}

/// The same for the colour.
pub(crate) fn gather_color(ray_gradients: &[RayGradient], layout: &BrickLayout, gradient: &mut [Row<CHANNELS>]) {
    let corners = |ray_gradient: &RayGradient| {
        ray_gradient.color_cell.weights().map(|weight| ray_gradient.grad_color.map(|gradient| weight * gradient))
    };
    gather::<CHANNELS>(ray_gradients, layout, gradient, |ray_gradient| ray_gradient.color_cell, corners);
}

/// Nodes are looked up in parallel, and added to one ray after the other: sums have one order whatever the threads do.
fn gather<const C: usize>(
    ray_gradients: &[RayGradient],
    layout: &BrickLayout,
    gradient: &mut [Row<C>],
    cell: impl Fn(&RayGradient) -> Cell + Sync,
    corners: impl Fn(&RayGradient) -> [[f32; C]; 8],
) {
    let places = |ray_gradient: &RayGradient| -> [u32; 8] {
        let [x, y, z] = layout.grid().coordinates(cell(ray_gradient).node);
        std::array::from_fn(|corner| {
            let at = [x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2)];
            layout.active_slot(at).map_or(NONE, |(slot, lane)| (slot * EDGE + lane) as u32)
        })
    };
    let (places, ()) = rayon::join(
        || ray_gradients.par_iter().with_min_len(CHUNK).map(places).collect::<Vec<_>>(),
        || gradient.par_chunks_mut(CHUNK).for_each(|rows| rows.fill([[0.0; C]; EDGE])),
    );
    let gradient = gradient.as_flattened_mut();
    for (ray_gradient, places) in ray_gradients.iter().zip(&places) {
        for (&place, value) in places.iter().zip(corners(ray_gradient)).filter(|(place, _)| **place != NONE) {
            let at = &mut gradient[place as usize];
            (0..C).for_each(|c| at[c] += value[c]);
        }
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::voxel::VoxelGrid;
    use glam::Vec3;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::active::ActiveNodes;
    use crate::bricks::Stored;

    type IsActive<'a> = &'a dyn Fn(&VoxelGrid, usize) -> bool;

    #[test]
    fn active_nodes_get_what_rays_send_them_and_no_others_whatever_is_stored() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let (shape, color) = (VoxelGrid::new(33, 0.55), VoxelGrid::new(17, 0.55));
        let mut random = || rng.random::<f32>() - 0.5;
        let ray_gradient = |_| {
            let point = 1.1 * Vec3::new(random(), random(), random());
            let (shape_cell, color_cell) = (shape.locate(point), color.locate(point));
            RayGradient { shape_cell, color_cell, grad_value: random(), grad_color: [random(), random(), random()] }
        };
        let rays: Vec<RayGradient> = (0..5000).map(ray_gradient).collect();
        let (mut by_shape, mut by_color) = (vec![0.0f32; shape.len()], vec![[0.0f32; CHANNELS]; color.len()]);
        for ray in &rays {
            for (offset, weight) in shape.corner_offsets().into_iter().zip(ray.shape_cell.weights()) {
                by_shape[ray.shape_cell.node + offset] += weight * ray.grad_value;
            }
            for (offset, weight) in color.corner_offsets().into_iter().zip(ray.color_cell.weights()) {
                let sum = &mut by_color[ray.color_cell.node + offset];
                sum.iter_mut().zip(ray.grad_color).for_each(|(sum, gradient)| *sum += weight * gradient);
            }
        }
        let sets: [IsActive; 4] = [
            &|_, _| true,
            &|_, _| false,
            &|grid, node| (grid.position(node).length() - 0.3).abs() < 0.1,
            &|_, node| node.wrapping_mul(2_654_435_761) % 7 < 2,
        ];
        for is_active in sets {
            let of = |grid: &VoxelGrid| ActiveNodes::new(grid, |node| is_active(grid, node));
            let (of_shape, of_color) = (of(&shape), of(&color));
            for stored in [Stored::Active, Stored::Around, Stored::All] {
                let (shapes, colors) = (BrickLayout::new(&of_shape, stored), BrickLayout::new(&of_color, stored));
                // What an earlier step left is overwritten.
                let mut gradient = vec![[[1.0]; EDGE]; shapes.active_rows()];
                gather_shape(&rays, &shapes, &mut gradient);
                let expected: Vec<f32> = of_shape.iter().map(|node| by_shape[node]).collect();
                assert_eq!(gradient, shapes.rows_of(&of_shape, &expected));
                let mut gradient = vec![[[1.0; CHANNELS]; EDGE]; colors.active_rows()];
                gather_color(&rays, &colors, &mut gradient);
                let expected: Vec<f32> = of_color.iter().flat_map(|node| by_color[node]).collect();
                assert_eq!(gradient, colors.rows_of(&of_color, &expected));
            }
        }
    }
}
