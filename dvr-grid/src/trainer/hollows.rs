//! Which hollows the start is carved with, and from which stage on: a first stage is trained for a look.

use burn::tensor::Device;
use dvr_core::{Cancellation, View};

use super::GridTrainer;
use crate::accelerator::Accelerator;
use crate::color_trust::differences_by;
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

/// The same beside the mean of all other points of the hull: what shines differs everywhere. Measured 2.2 to 11 at mouths.
const MOUTH_CONTRAST: f32 = 1.5;

/// Cells from which on hollows are carved that are not carved from the start: patches alone do not hold the outside of
/// walls that are thinner than two cells, and what is lost there no later stage brings back.
const FINE: usize = 128;

/// The cells of the first stage that has at least [`FINE`], of those from `first` up to `most` cells.
fn fine_stage(first: usize, most: usize) -> Option<usize> {
    std::iter::successors(Some(first), |cells| Some(2 * cells)).take_while(|&cells| cells <= most).find(|&c| c >= FINE)
}

/// What becomes of hollows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    /// They are carved from the start.
    FromStart,
    /// They are carved at the first stage of this many cells.
    At(usize),
    /// They are none.
    Forgotten,
}

/// What becomes of hollows that the look leaves open, or at whose mouths views show different colours; `fine` is the stage
/// that they could wait for, `first` the cells of the look.
fn fate(is_open: bool, mouths_differ: bool, shines: bool, first: usize, fine: Option<usize>) -> Fate {
    match fine {
        Some(cells) if is_open && shines => Fate::At(cells),
        _ if is_open => Fate::FromStart,
        Some(cells) if mouths_differ && cells > first => Fate::At(cells),
        _ => Fate::Forgotten,
    }
}

impl<'a> GridTrainer<'a> {
    /// Decides about what was carved out of the hull, and says so where it is not carved from the start.
    pub(super) fn judged_hollows(
        train: &[&'a View],
        config: &GridConfig,
        refinement: Refinement,
        device: Option<&Device>,
        cancellation: &Cancellation,
    ) -> Result<(Refinement, Option<String>)> {
        let look = GridConfig {
            capacity: Capacity::Cells(config.first_cells),
            further_passes: 0,
            steps: config.steps.min(STEPS),
            ..config.clone()
        };
        let device = Accelerator::new(device).gpu();
        let mut trainer = Self::begin(train.to_vec(), Vec::new(), look, refinement, Vec::new(), device, cancellation)?;
        while !trainer.finished {
            cancellation.check()?;
            trainer.step()?;
        }
        let grids = trainer.backend.grids()?;
        let is_open = trainer.refinement.open_hollows(&grids) >= OPEN;
        let shines = trainer.agreement.shine() > 0.0;
        let most = Growth::plan(config, train).max_cells().min(config.whole_cells).max(config.first_cells);
        // With a bound on its bytes a run may end before that stage.
        let fine = fine_stage(config.first_cells, most).filter(|_| config.max_bytes == 0);
        let fate = fate(is_open, !is_open && trainer.mouths_differ()?, shines, config.first_cells, fine);
        let mut refinement = trainer.refinement;
        let share = 100.0 * refinement.carved_share();
        match fate {
            Fate::FromStart => return Ok((refinement, None)),
            Fate::At(cells) if refinement.carve_from(cells, &grids) => {
                let why = if is_open {
                    "views hardly agree on colours".to_owned()
                } else {
                    format!("{} cells close hollows of the visual hull again", config.first_cells)
                };
                return Ok((refinement, Some(format!("{why}: hollows open at {cells} cells"))));
            }
            Fate::At(_) | Fate::Forgotten => refinement.forget_carving(),
        }
        let note = format!(
            "a plane sweep took {share:.0} % of the visual hull for hollows, which training closed again: training starts from \
             the whole hull"
        );
        Ok((refinement, Some(note)))
    }

    /// Whether views show different colours where the visual hull would close the mouths of hollows.
    fn mouths_differ(&self) -> Result<bool> {
        let hull = self.refinement.first_of_whole_hull(&self.config)?;
        let PyramidLevel { views, order, .. } = &self.photographs;
        let is_mouth = |point| self.refinement.is_carved(point);
        let [mouths, rest] = differences_by(hull.shape.values(), views, order, &self.config, is_mouth);
        let least = MOUTH_DIFFERENCE.max(MOUTH_CONTRAST * rest.unwrap_or(0.0));
        Ok(mouths.is_some_and(|mouths| mouths >= least))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hollows_are_carved_that_are_open_or_whose_mouths_differ_and_wait_where_coarse_cells_do_not_hold_them() {
        let (first, fine) = (32, Some(128));
        assert_eq!(fate(true, false, false, first, fine), Fate::FromStart);
        assert_eq!(fate(true, false, true, first, fine), Fate::At(128));
        assert_eq!(fate(true, false, true, first, None), Fate::FromStart);
        assert_eq!(fate(false, false, false, first, fine), Fate::Forgotten);
        assert_eq!(fate(false, false, true, first, fine), Fate::Forgotten);
        assert_eq!(fate(false, true, false, first, fine), Fate::At(128));
        assert_eq!(fate(false, true, false, first, None), Fate::Forgotten, "coarse cells would close them again");
        assert_eq!(fate(false, true, false, 128, fine), Fate::Forgotten, "no later stage");
    }

    #[test]
    fn a_fine_stage_is_one_that_training_comes_to() {
        assert_eq!(fine_stage(32, 128), Some(128));
        assert_eq!(fine_stage(48, 200), Some(192));
        assert_eq!(fine_stage(256, 256), Some(256), "the first");
        assert_eq!(fine_stage(32, 127), None);
    }
}
