//! Further passes at the size that is kept: training goes on while the photographs fit together better than before.

use super::GridTrainer;
use crate::error::Result;
use crate::growth::NccOfPass;
use crate::validation_ncc::Gain;

/// Where further passes begin on the way from the first step size to the last, as a share of its logarithm: what was
/// learned must not be shaken off.
const FURTHER_START: f64 = 0.5;

impl GridTrainer<'_> {
    /// Factor of the step sizes: falls exponentially to `final_rate` in each pass.
    pub(super) fn decay(&self) -> f64 {
        let within = (self.step - self.pass_start) as f64 / self.config.steps.max(1) as f64;
        let start = if self.further == 0 { 0.0 } else { FURTHER_START };
        self.config.final_rate.powf(start + (1.0 - start) * within)
    }

    /// Begins a further pass at the present size, or finishes; `gain` is what the stage or pass before brought, if that
    /// is known. Where raw colours count in full there is none: they pull from afar, and are done after a stage; patches
    /// are alike within a pixel or two alone, and take longer.
    pub(super) fn go_on(&mut self, gain: Option<Gain>) -> Result<()> {
        let is_judged = self.validation_ncc.is_some() && self.agreement.trust() < 1.0;
        let is_worth_it = gain.is_none_or(|gain| gain.mean >= self.config.further_after_gain);
        if self.further == self.config.further_passes || !is_judged || !is_worth_it {
            self.finished = true;
            return Ok(());
        }
        let grids = self.backend.grids()?.into_owned();
        let cells = grids.cells();
        self.growth.keep(grids);
        self.look_at(cells)?;
        (self.further, self.pass_start) = (self.further + 1, self.step);
        Ok(())
    }

    /// Ends a further pass: takes it back and finishes where it gained nothing that stands out from the noise.
    pub(super) fn end_further(&mut self) -> Result<()> {
        let grids = self.backend.grids()?;
        let (scores, NccOfPass { gain, .. }) = self.ncc(&grids);
        self.cancellation.check()?;
        let is_kept = self.growth.keeps_further(&self.config, grids.cells(), gain);
        self.notes.extend(self.growth.notes());
        if is_kept {
            self.kept_scores = scores;
            return self.go_on(gain);
        }
        if let Some(before) = self.growth.take_back() {
            self.backend.upload(before)?;
        }
        self.finished = true;
        Ok(())
    }
}
