//! What a trainer needs to go on later, and how it goes on from that.

use super::GridTrainer;
use crate::color_trust::Agreement;
use crate::error::Result;
use crate::report::TrainerState;
use crate::state;

impl GridTrainer<'_> {
    /// Enough to go on later.
    ///
    /// # Errors
    /// When a GPU that keeps the grids fails.
    pub fn state(&self) -> Result<TrainerState> {
        let grids = self.backend.grids()?;
        let (reached, kept) = self.growth.history();
        let progress = state::Progress {
            pass_start: self.pass_start,
            further: self.further,
            cells: grids.cells(),
            reached: reached.to_vec(),
            has_kept: kept.is_some(),
            finished: self.finished,
            rays_drawn: self.rays_drawn,
            agreement: self.agreement.0.to_bits(),
            doubts_stereo: self.refinement.doubts_stereo(),
            exposures: self.exposures.clone(),
        };
        let training = state::to_bytes(&progress, &grids, kept)?;
        Ok(TrainerState { model: grids.field_bytes()?, training })
    }

    /// Goes on where `state` was taken, after this many steps.
    ///
    /// # Errors
    /// When the state is damaged or of another configuration.
    pub fn resume(&mut self, state: &TrainerState, steps: usize) -> Result<()> {
        let progress = state::progress(&state.training)?;
        let (mut grids, mut kept) = (self.backend.grids()?.into_owned(), None);
        let fits = progress.exposures.is_empty() || progress.exposures.len() == self.names.len();
        if !fits || !progress.exposures.iter().all(|exposure| exposure.is_sound()) {
            return Err(state::misfit());
        }
        if progress.doubts_stereo != self.refinement.doubts_stereo() {
            return Err(state::started_otherwise());
        }
        // Before any grid is made: cells are memory by their cube.
        if progress.cells > self.config.last_cells().max(grids.cells()) {
            return Err(state::misfit());
        }
        let learned = state::learned(&state.training)?;
        let mut learned = learned.as_ref().map(|(shape, color)| (shape.as_slice(), color.as_slice()));
        // A stage that was taken back left its number, not its cells.
        while grids.cells() < progress.cells {
            let next = match &mut learned {
                Some((shape, color)) if 2 * grids.cells() > self.config.whole_cells => {
                    let shape = grids.shape.values().with_learned(shape);
                    let color = grids.color.values().with_learned(color);
                    let (shape, color) = shape.zip(color).ok_or_else(state::misfit)?;
                    self.refinement.on_frozen_base(&grids, shape, color, &self.config)?
                }
                _ => self.refinement.refined(&grids, &self.config)?,
            };
            kept = Some(std::mem::replace(&mut grids, next));
        }
        if learned.is_some_and(|(shape, color)| !shape.is_empty() || !color.is_empty()) {
            return Err(state::misfit());
        }
        state::restore(&state.training, state::PRESENT, &mut grids)?;
        // A pass is taken back to a grid of its own size, a stage to the one before.
        let kept = if progress.further == 0 { kept } else { Some(grids.clone()) };
        let mut kept = kept.filter(|_| progress.has_kept);
        if let Some(kept) = &mut kept {
            state::restore(&state.training, state::KEPT, kept)?;
        }
        (self.pass_start, self.further) = (progress.pass_start, progress.further);
        self.trust_colors(Agreement(f64::from_bits(progress.agreement)));
        self.look_at(grids.cells())?;
        self.expose(progress.exposures)?;
        self.growth.resume(progress.reached, kept);
        self.kept_scores = None;
        (self.finished, self.rays_drawn, self.step) = (progress.finished, progress.rays_drawn, steps);
        self.backend.upload(grids)?;
        let is_cut_short = !self.finished && steps > 0 && steps == self.end_of_pass();
        if is_cut_short { self.end_pass() } else { Ok(()) }
    }
}
