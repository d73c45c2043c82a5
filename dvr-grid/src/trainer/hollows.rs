//! Whether hollows that the start is carved with are there: a first stage is trained for a look.

use dvr_core::{Cancellation, View};

use super::GridTrainer;
use crate::config::{Capacity, GridConfig};
use crate::error::Result;
use crate::refinement::Refinement;

/// Steps after which the surface is looked at, at most.
const STEPS: usize = 300;

/// Share of the hollows that must be open.
const OPEN: f64 = 0.5;

impl<'a> GridTrainer<'a> {
    /// Forgets what was carved out of the hull where training closes it again, and says so.
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
        let open = trainer.refinement.open_hollows(&*trainer.backend.grids()?);
        let mut refinement = trainer.refinement;
        if open >= OPEN {
            return Ok((refinement, None));
        }
        let share = 100.0 * refinement.forget_carving();
        let note = format!(
            "a plane sweep took {share:.0} % of the visual hull for hollows, which training closed again: training starts from \
             the whole hull"
        );
        Ok((refinement, Some(note)))
    }
}
