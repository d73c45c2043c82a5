//! Whether hollows that the start is carved with are there: a first stage is trained for a look.

use dvr_core::{Cancellation, View};

use super::GridTrainer;
use crate::color_trust::difference_where;
use crate::config::{Capacity, GridConfig};
use crate::error::Result;
use crate::growth::Growth;
use crate::picture_pyramid::PyramidLevel;
use crate::refinement::Refinement;

/// Steps after which the surface is looked at, at most.
const STEPS: usize = 300;

/// Share of the hollows that must be open.
const OPEN: f64 = 0.5;

/// Mean difference in colour between views, summed over three channels in `[0, 1]`, of points of the hull that are carved away,
/// from which there is a hollow whatever training closed: the hull closes its mouth, where every view shows other depths
/// of it. Measured .20 to .45 at mouths (mug, plates, helmet, vase), and at most .07 where colours are smooth and a plane
/// sweep finds hollows that are none.
const MOUTH_DIFFERENCE: f32 = 0.12;

/// Cells from which on hollows are carved that are not carved from the start: patches alone do not hold the outside of
/// walls that are thinner than two cells, and what is lost there no later stage brings back.
const FINE: usize = 128;

/// The cells of the first stage that has at least [`FINE`], of those from `first` up to `most` cells.
fn fine_stage(first: usize, most: usize) -> Option<usize> {
    std::iter::successors(Some(first), |cells| Some(2 * cells)).take_while(|&cells| cells <= most).find(|&c| c >= FINE)
}

impl<'a> GridTrainer<'a> {
    /// Forgets what was carved out of the hull where training closes it again and nothing else shows it, and says so. Where
    /// training closes hollows that are there, or views hardly agree on colours, hollows wait for a fine stage.
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
        let is_closed = trainer.refinement.open_hollows(&grids) < OPEN;
        if is_closed && !trainer.mouths_differ()? {
            let mut refinement = trainer.refinement;
            let share = 100.0 * refinement.forget_carving();
            let note = format!(
                "a plane sweep took {share:.0} % of the visual hull for hollows, which training closed again: training starts \
                 from the whole hull"
            );
            return Ok((refinement, Some(note)));
        }
        let shines = trainer.agreement.shine() > 0.0;
        let most = Growth::plan(config, train).max_cells().min(config.whole_cells).max(config.first_cells);
        // With a bound on its bytes a run may end before that stage.
        let waits = (is_closed || shines) && config.max_bytes == 0;
        let mut refinement = trainer.refinement;
        let Some(cells) = fine_stage(config.first_cells, most).filter(|_| waits) else {
            return Ok((refinement, None));
        };
        refinement.carve_from(cells, &grids);
        let why = if is_closed {
            format!("{} cells close hollows of the visual hull again", config.first_cells)
        } else {
            "views hardly agree on colours".to_owned()
        };
        Ok((refinement, Some(format!("{why}: hollows open at {cells} cells"))))
    }

    /// Whether views show different colours where the visual hull would close the mouths of hollows.
    fn mouths_differ(&self) -> Result<bool> {
        let hull = self.refinement.first_of_whole_hull(&self.config)?;
        let is_mouth = |point| self.refinement.is_carved(point);
        let PyramidLevel { views, order, .. } = &self.photographs;
        let difference = difference_where(&hull, views, order, &self.config, is_mouth);
        Ok(difference.is_some_and(|difference| difference >= MOUTH_DIFFERENCE))
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
