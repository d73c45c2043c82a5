//! How much of the surface has come to the border of the nodes that learn.

use super::GridTrainer;
use crate::bricks::{BrickOccupancy, BrickValues};
use crate::error::Result;

impl GridTrainer<'_> {
    /// Share of the cells that the surface passes through of which a corner does not learn, from 0 to 1; 0 without a surface.
    /// There it has come to the border of the band that it may move in, and will go no further before the next stage or pass,
    /// which has a band of its own.
    ///
    /// # Errors
    /// When a GPU that keeps the field fails.
    pub fn surface_at_border(&self) -> Result<f64> {
        Ok(at_border(&*self.backend.shape_values()?))
    }
}

fn at_border(values: &BrickValues<1>) -> f64 {
    let learns = |cell: &[usize; 3]| {
        let corner = |i: usize| std::array::from_fn(|axis| cell[axis] + (i >> axis & 1));
        (0..8).all(|i| values.layout().active_slot(corner(i)).is_some())
    };
    let (mut at_border, mut all) = (0usize, 0usize);
    for cell in BrickOccupancy::new(values).crossed_cells() {
        all += 1;
        at_border += usize::from(!learns(&cell));
    }
    if all == 0 { 0.0 } else { at_border as f64 / all as f64 }
}

#[cfg(test)]
mod tests {
    use dvr_core::voxel::VoxelGrid;
    use glam::Vec3;

    use super::*;
    use crate::active::ActiveNodes;

    #[test]
    fn a_surface_is_at_the_border_where_a_corner_of_its_cells_does_not_learn() {
        let grid = VoxelGrid::new(33, 0.5);
        let distance = |point: Vec3| 0.3 - point.length();
        let values: Vec<f32> = (0..grid.len()).map(|node| distance(grid.position(node))).collect();
        let share = |learns: &dyn Fn(Vec3) -> bool, values: &[f32]| {
            let active = ActiveNodes::new(&grid, |node| learns(grid.position(node)));
            at_border(&BrickValues::dense(&active, values))
        };
        let is_near = |point: Vec3| distance(point).abs() < 2.0 * grid.spacing();
        assert_eq!(share(&is_near, &values), 0.0);
        let half = share(&|point| is_near(point) && point.x > 0.0, &values);
        assert!((0.5..0.6).contains(&half), "{half}: the other half, and cells between");
        assert_eq!(share(&|_| false, &values), 1.0);
        assert_eq!(share(&|_| false, &vec![-1.0; grid.len()]), 0.0, "no surface");
    }
}
