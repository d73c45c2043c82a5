//! The trainer of a field on rays, as a run sees it.

use burn::module::Module;
use dvr_render::{Crossing, FieldShader, MarchSettings, RenderSettings, ViewMetrics, view_metrics};

use crate::error::Result;
use crate::learners::learner::{Learner, LearnerState};
use crate::learners::module_state::{module_bytes, module_state, restore_module, restore_optimizer};
use crate::learners::step_report::StepReport;
use crate::learners::trainer::Trainer;

impl<F: Crossing + Module> Learner for Trainer<'_, F> {
    fn step(&mut self) -> Result<StepReport> {
        self.step()
    }

    fn steps_done(&self) -> usize {
        self.steps_done()
    }

    fn total_steps(&self) -> usize {
        self.config().steps
    }

    fn validate(&self, pixels: usize) -> Option<ViewMetrics> {
        let march = MarchSettings { steps: 64, ..MarchSettings::default() };
        let settings = RenderSettings { march, ..RenderSettings::default() };
        let field = self.frozen();
        view_metrics(&FieldShader::new(&field, settings, self.bound()), self.validation(), pixels)
    }

    fn model(&self) -> Result<Vec<u8>> {
        module_bytes(self.parts().0.clone())
    }

    fn state(&self) -> Result<LearnerState> {
        let (field, optimizer) = self.parts();
        module_state(field.clone(), optimizer)
    }

    fn resume(&mut self, state: &LearnerState, steps: usize) -> Result<()> {
        let field = restore_module(&state.model, self.parts().0.clone())?;
        let optimizer = restore_optimizer(&state.training, self.parts().1.clone())?;
        self.restore(field, optimizer, steps);
        Ok(())
    }
}
