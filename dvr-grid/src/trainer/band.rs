//! How much of the surface has come to the border of the nodes that learn.

use super::GridTrainer;
use crate::bricks::BrickOccupancy;
use crate::error::Result;

impl GridTrainer<'_> {
    /// Share of the cells that the surface passes through of which a corner does not learn, from 0 to 1; 0 without a surface.
    /// There it has come to the border of the band that it may move in, and will go no further before the next stage or pass,
    /// which has a band of its own.
    ///
    /// # Errors
    /// When a GPU that keeps the field fails.
    pub fn surface_at_border(&self) -> Result<f64> {
        let values = self.backend.shape_values()?;
        let occupancy = BrickOccupancy::new(&values);
        let learns = |cell: &[usize; 3]| {
            let corner = |i: usize| std::array::from_fn(|axis| cell[axis] + (i >> axis & 1));
            (0..8).all(|i| values.layout().active_slot(corner(i)).is_some())
        };
        let (mut at_border, mut all) = (0usize, 0usize);
        for cell in occupancy.crossed_cells() {
            all += 1;
            at_border += usize::from(!learns(&cell));
        }
        Ok(if all == 0 { 0.0 } else { at_border as f64 / all as f64 })
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::View;

    use super::*;
    use crate::config::{Capacity, GridConfig};
    use crate::step::suite::speckled_arc;

    #[test]
    fn a_surface_stays_within_its_band_unless_steps_are_so_long_that_they_carry_it_out() {
        let views = speckled_arc(4);
        let views: Vec<&View> = views.iter().collect();
        let at_border = |shape_rate: f64| {
            let config = GridConfig {
                capacity: Capacity::Cells(64),
                first_cells: 32,
                whole_cells: 32,
                steps: 10,
                further_passes: 0,
                shape_rate,
                ..GridConfig::default()
            };
            let mut trainer = GridTrainer::new(views.clone(), Vec::new(), config).unwrap();
            while trainer.steps_done() < trainer.total_steps() {
                trainer.step().unwrap();
            }
            trainer.surface_at_border().unwrap()
        };
        let (short, long) = (at_border(1e-4), at_border(0.1));
        assert!(short < 0.05 && long > short + 0.2, "{short} {long}");
    }
}
