//! Whether hollows that the start is carved with are there: a first stage is trained for a look.

use dvr_core::{Cancellation, View};

use super::GridTrainer;
use crate::config::{Capacity, GridConfig};
use crate::error::Result;
use crate::growth::Growth;
use crate::refinement::Refinement;

/// Steps after which the surface is looked at, at most.
const STEPS: usize = 300;

/// Share of the hollows that must be open.
const OPEN: f64 = 0.5;

/// Cells from which on hollows are carved where views hardly agree on colours: patches alone do not hold the outside of walls
/// that are thinner than two cells, and what is lost there no later stage brings back.
const FINE: usize = 128;

/// The cells of the first stage that has at least [`FINE`], of those from `first` up to `most` cells.
fn fine_stage(first: usize, most: usize) -> Option<usize> {
    std::iter::successors(Some(first), |cells| Some(2 * cells)).take_while(|&cells| cells <= most).find(|&c| c >= FINE)
}

impl<'a> GridTrainer<'a> {
    /// Forgets what was carved out of the hull where training closes it again, and says so. Where views hardly
    /// agree on colours, what stays open waits for a fine stage.
    pub(super) fn without_closed_hollows(
        train: &[&'a View],
        config: &GridConfig,
        refinement: Refinement,
        cancellation: &Cancellation,
    ) -> Result<(Refinement, Option<String>)> {
        let look = GridConfig {
            capacity: Capacity::Cells(config.first_cells),
            further_passes: 0,
            steps: config.steps.min(STEPS),
            ..config.clone()
        };
        let mut trainer = Self::begin(train.to_vec(), Vec::new(), look, refinement, Vec::new(), cancellation)?;
        while !trainer.finished {
            cancellation.check()?;
            trainer.step()?;
        }
        let grids = trainer.backend.grids()?;
        let open = trainer.refinement.open_hollows(&grids);
        let shines = trainer.agreement.shine() > 0.0;
        let mut refinement = trainer.refinement;
        if open >= OPEN {
            let most = Growth::plan(config, train).max_cells().min(config.whole_cells).max(config.first_cells);
            // With a bound on its bytes a run may end before that stage.
            let waits = shines && config.max_bytes == 0;
            let Some(cells) = fine_stage(config.first_cells, most).filter(|_| waits) else {
                return Ok((refinement, None));
            };
            refinement.carve_from(cells, &grids);
            let note = format!("views hardly agree on colours: hollows of the visual hull open at {cells} cells");
            return Ok((refinement, Some(note)));
        }
        let share = 100.0 * refinement.forget_carving();
        let note = format!(
            "a plane sweep took {share:.0} % of the visual hull for hollows, which training closed again: training starts from \
             the whole hull"
        );
        Ok((refinement, Some(note)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fine_stage_is_one_that_training_comes_to() {
        assert_eq!(fine_stage(32, 128), Some(128));
        assert_eq!(fine_stage(48, 200), Some(192));
        assert_eq!(fine_stage(256, 256), Some(256), "the first");
        assert_eq!(fine_stage(32, 127), None);
    }
}
