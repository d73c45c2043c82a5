//! The fast trainer: lattices, exact crossings, gradients by hand.

use std::borrow::Cow;

use burn::tensor::Device;
use dvr_core::UnitCube;
use dvr_core::hull::MaskDistance;
use dvr_kernels::{ActiveNodes, Lattice};
use dvr_model::{LatticeField, LatticeValues, lattice_file};
use dvr_render::is_gpu;
use rayon::prelude::*;

use super::clock::PartTimes;
use super::config::FastConfig;
use super::cpu::CpuStepper;
use super::growth::{Growth, Reached, Verdict};
use super::levels::{Levels, prolonged};
use super::rays::mean_object_color;
use super::start::{add_hull_detail, hull_start};
use super::state;
use super::stepper::{StepJob, StepSums, Stepper};
use super::sweep::Carving;
use super::views::{FastView, PixelOrder};
use super::wrong_masks::leave_out_wrong_masks;
use crate::checkpoint::LearnerState;
use crate::error::{Error, Result};
use crate::learner::Learner;
use crate::trainer::{READ_EVERY, StepReport, ViewSplit};
use crate::validate::{Agreement, agreement};

/// Pixels of held-out views that decide about growth.
const JUDGING_PIXELS: usize = 30_000;

/// How near to the surface a node is taught where not all are, in nodes.
const BAND_NODES: usize = 3;

/// A lattice field in training.
pub struct FastTrainer<'a> {
    config: FastConfig,
    views: ViewSplit<'a>,
    packed: Vec<FastView<'a>>,
    masks: Vec<MaskDistance>,
    carving: Option<Carving>,
    order: PixelOrder,
    /// What is learned, where `stepper` does not keep it to itself: see [`FastTrainer::levels`].
    shape: Levels<1>,
    color: Levels<3>,
    stepper: Box<dyn Stepper>,
    /// The losses of the last step that looked at them.
    sums: Option<StepSums>,
    mean_color: [f32; 3],
    stage: usize,
    step: usize,
    rays_drawn: u64,
    growth: Growth,
    finished: bool,
    notes: Vec<String>,
    times: PartTimes,
}

impl<'a> FastTrainer<'a> {
    /// Starts from the visual hull.
    ///
    /// # Errors
    /// When the configuration does not make sense, or the masks show no object.
    pub fn new(mut views: ViewSplit<'a>, config: FastConfig) -> Result<Self> {
        config.check()?;
        let notes = leave_out_wrong_masks(&mut views, &config)?;
        let masks: Vec<MaskDistance> =
            views.train.par_iter().map(|view| MaskDistance::new(&view.camera, &view.mask)).collect();
        let packed = FastView::pack(&views.train, config.neighbours);
        let lattice = padded_cube(config.first_cells);
        let carving = carve(&masks, &packed, &lattice, &config);
        let shape = shape_start(&masks, &lattice, carving.as_ref(), &config);
        let mean_color = mean_object_color(&views.train).to_array();
        let color = color_start(&shape, mean_color, &config);
        // Pixels whose rays come as close to the object as the band around the hull.
        let margin = |view: usize| {
            let camera = &views.train[view].camera;
            let depth = camera.center().length().max(UnitCube::default().half_extent());
            (4.0 * f64::from(lattice.spacing()) * camera.intrinsics.x_axis.x.abs() / depth) as f32 + 1.0
        };
        let order = PixelOrder::new(&views.train, &masks, margin);
        if order.is_empty() || shape.active().count() == 0 {
            return Err(Error::Config(
                "the masks have no visual hull in common: no point of space is object in all of them. Check masks and \
                 cameras with `dvr info`"
                    .into(),
            ));
        }
        let growth = Growth::plan(&config, &views);
        Ok(Self {
            config,
            views,
            packed,
            masks,
            carving,
            order,
            stepper: Box::new(CpuStepper::new(&shape, &color)),
            shape,
            color,
            sums: None,
            mean_color,
            stage: 0,
            step: 0,
            rays_drawn: 0,
            growth,
            finished: false,
            notes,
            times: PartTimes::default(),
        })
    }

    /// Lets a device carry out the steps. What is no graphics processor leaves them where they are.
    ///
    /// Steps on a graphics processor draw the same rays as on the processor, and tell their losses in every tenth step.
    /// Everything else, from the visual hull to the judging of a stage, stays on the processor.
    ///
    /// # Errors
    /// When the photographs or the lattices do not fit into the device.
    #[cfg_attr(not(feature = "gpu"), expect(unused_mut, reason = "there are no graphics processors in this build"))]
    pub fn on(mut self, device: &Device) -> Result<Self> {
        if !is_gpu(device) || self.config.steps == 0 {
            return Ok(self);
        }
        #[cfg(feature = "gpu")]
        {
            self.stepper = Box::new(super::device::DeviceStepper::new(device, &self.packed, &self.config)?);
            self.follow_levels()?;
        }
        Ok(self)
    }

    /// Ends a stage: keeps what it brought or takes it back, and grows or ends.
    fn end_stage(&mut self) -> Result<()> {
        if let (Cow::Owned(shape), Cow::Owned(color)) = self.levels()? {
            (self.shape, self.color) = (shape, color);
        }
        let reached = Reached {
            cells: self.shape.lattice().cells(),
            parameters: self.parameters(),
            bytes: model_bytes(&self.shape, &self.color)?.len(),
            held_out: agreement(&field_of(&self.shape, &self.color), &self.views.held_out, JUDGING_PIXELS),
        };
        match self.growth.judge(&self.config, reached) {
            Verdict::Grow => {
                self.growth.keep(self.shape.clone(), self.color.clone());
                self.refine();
                self.follow_levels()?;
            }
            Verdict::Stay => self.finished = true,
            Verdict::TakeBack => {
                if let Some((shape, color)) = self.growth.take_back() {
                    (self.shape, self.color) = (shape, color);
                    self.follow_levels()?;
                }
                self.finished = true;
            }
        }
        self.notes.extend(self.growth.notes());
        Ok(())
    }

    /// The configuration.
    pub fn config(&self) -> &FastConfig {
        &self.config
    }

    /// The views, divided.
    pub fn views(&self) -> &ViewSplit<'a> {
        &self.views
    }

    /// Parameters of all levels of shape and colour.
    pub fn parameters(&self) -> usize {
        self.shape.parameters() + self.color.parameters()
    }

    /// Where the time of the steps of this session went.
    pub fn times(&self) -> &PartTimes {
        &self.times
    }

    /// The field as it is now.
    ///
    /// # Errors
    /// When a graphics processor that keeps it fails.
    pub fn field(&self) -> Result<LatticeField> {
        let (shape, color) = self.levels()?;
        Ok(field_of(&shape, &color))
    }

    /// The levels of shape and colour as they are now.
    fn levels(&self) -> Result<(Cow<'_, Levels<1>>, Cow<'_, Levels<3>>)> {
        let Some((shape_state, color_state)) = self.stepper.levels()? else {
            return Ok((Cow::Borrowed(&self.shape), Cow::Borrowed(&self.color)));
        };
        let (mut shape, mut color) = (self.shape.clone(), self.color.clone());
        if !(shape.restore(&shape_state) && color.restore(&color_state)) {
            return Err(state::misfit());
        }
        Ok((Cow::Owned(shape), Cow::Owned(color)))
    }

    /// Carries out one step; its losses are those of the last step that looked at them.
    fn follow_rays(&mut self) -> Result<StepReport> {
        let last_of_stage = self.step + 1 == self.config.steps.saturating_mul(self.stage + 1);
        let decay = self.decay();
        let job = StepJob {
            config: &self.config,
            views: &self.packed,
            order: &self.order,
            rays_drawn: self.rays_drawn,
            mean_color: self.mean_color,
            decay,
            is_reported: last_of_stage || (self.step + 1).is_multiple_of(READ_EVERY) || self.sums.is_none(),
            times: &mut self.times,
        };
        let sums = self.stepper.step(job, &mut self.shape, &mut self.color)?;
        self.sums = sums.or(self.sums);
        self.step += 1;
        self.rays_drawn += self.config.rays as u64;
        Ok(self.report(&self.sums.unwrap_or_default(), self.config.shape_rate * decay))
    }

    /// Factor of the step sizes: falls exponentially to `final_rate` in each stage.
    fn decay(&self) -> f64 {
        let within = self.step - self.stage * self.config.steps;
        self.config.final_rate.powf(within as f64 / self.config.steps.max(1) as f64)
    }

    /// The next stage: twice the cells. Beyond `whole_cells`, they are taught near the surface alone.
    fn refine(&mut self) {
        let cells = 2 * self.shape.lattice().cells();
        if cells > self.config.whole_cells {
            let (shape, color) = (self.shape.baked().to_vec(), self.color.baked().to_vec());
            return self.settle_on(&shape, &color);
        }
        let lattice = padded_cube(cells);
        let disagreeing = self.config.disagreeing_views.of(self.masks.len());
        let (base, active) = hull_start(&self.masks, &lattice, disagreeing, self.carving.as_ref());
        self.shape = self.shape.refined(active, base);
        let base = self.mean_color.repeat((cells / self.config.color_coarseness + 1).pow(3));
        self.color = self.color.refined(coarsened(self.shape.active(), self.config.color_coarseness), base);
        self.stage += 1;
    }

    /// A stage that starts from what was learned on lattices of half the cells, and only moves what is near the
    /// surface.
    fn settle_on(&mut self, shape: &[f32], color: &[f32]) {
        let cells = 2 * self.shape.lattice().cells();
        let lattice = padded_cube(cells);
        let mut base = prolonged::<1>(shape, &lattice);
        let near = ActiveNodes::near_surface(&lattice, &base, BAND_NODES);
        add_hull_detail(&self.masks, &near, self.config.disagreeing_views.of(self.masks.len()), &mut base);
        let near_color = coarsened(&near, self.config.color_coarseness);
        let color = prolonged::<3>(color, near_color.lattice());
        self.color = Levels::settled(near_color, color, self.color.coarser() + 1);
        self.shape = Levels::settled(near, base, self.shape.coarser() + 1);
        self.stage += 1;
    }

    /// Brings everything up to date that follows from the levels.
    fn follow_levels(&mut self) -> Result<()> {
        self.stepper.enter(&self.shape, &self.color)
    }

    fn report(&self, sums: &StepSums, learning_rate: f64) -> StepReport {
        let (losses, tally) = (&self.config.losses, &sums.tally);
        let mean = 1.0 / self.config.rays as f64;
        let terms = vec![
            ("color", losses.color * tally.color * mean),
            ("texture", losses.texture * tally.color * mean),
            ("cross_view", losses.cross_view * tally.cross_view * mean / self.config.compared_views.max(1) as f64),
            ("structure", losses.structure * tally.structure * mean / self.config.compared_views.max(1) as f64),
            ("depth", losses.depth * tally.depth * mean),
            ("mask", losses.mask * tally.mask * mean),
            ("roughness", losses.roughness * f64::from(sums.roughness)),
        ];
        StepReport {
            step: self.step,
            loss: terms.iter().map(|(_, value)| value).sum(),
            terms,
            mask_iou: if tally.union == 0 { 1.0 } else { tally.intersection as f64 / tally.union as f64 },
            learning_rate,
            samples: 0,
        }
    }
}

impl Learner for FastTrainer<'_> {
    fn step(&mut self) -> Result<StepReport> {
        let report = self.follow_rays()?;
        if !report.loss.is_finite() {
            return Err(Error::Diverged { step: report.step, value: report.loss });
        }
        if self.step == self.config.steps.saturating_mul(self.stage + 1) {
            self.end_stage()?;
        }
        Ok(report)
    }

    fn steps_done(&self) -> usize {
        self.step
    }

    fn total_steps(&self) -> usize {
        if self.finished { self.step } else { self.config.steps.saturating_mul(self.growth.stages()) }
    }

    fn validate(&self, pixels: usize) -> Option<Agreement> {
        agreement(&self.field().ok()?, &self.views.held_out, pixels)
    }

    fn state(&self) -> Result<LearnerState> {
        let (reached, kept) = self.growth.history();
        let progress = state::Progress {
            stage: self.stage,
            cells: self.shape.lattice().cells(),
            reached: reached.to_vec(),
            has_kept: kept.is_some(),
            finished: self.finished,
            rays_drawn: self.rays_drawn,
        };
        let kept = kept.map(|(shape, color)| (shape, color));
        let (shape, color) = self.levels()?;
        let training = state::to_bytes(&progress, (&shape, &color), kept)?;
        Ok(LearnerState { model: model_bytes(&shape, &color)?, training })
    }

    fn resume(&mut self, state: &LearnerState, steps: usize) -> Result<()> {
        let progress = state::progress(&state.training)?;
        let mut kept = None;
        // A stage that was taken back left its number, not its cells.
        while self.shape.lattice().cells() < progress.cells {
            kept = Some((self.shape.clone(), self.color.clone()));
            let is_last = 2 * self.shape.lattice().cells() == progress.cells;
            let names = if is_last { state::PRESENT } else { state::KEPT };
            match state::learned(&state.training, names)? {
                Some((shape, color)) if 2 * self.shape.lattice().cells() > self.config.whole_cells => {
                    if (shape.len(), color.len()) != (self.shape.baked().len(), self.color.baked().len()) {
                        return Err(state::misfit());
                    }
                    self.settle_on(&shape, &color);
                }
                _ => self.refine(),
            }
        }
        state::restore(&state.training, state::PRESENT, &mut self.shape, &mut self.color)?;
        if let Some((shape, color)) = kept.as_mut().filter(|_| progress.has_kept) {
            state::restore(&state.training, state::KEPT, shape, color)?;
        }
        self.stage = progress.stage;
        self.growth.resume(progress.reached, kept.filter(|_| progress.has_kept));
        (self.finished, self.rays_drawn, self.step) = (progress.finished, progress.rays_drawn, steps);
        self.follow_levels()
    }

    fn notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }
}

/// The field that levels make.
fn field_of(shape: &Levels<1>, color: &Levels<3>) -> LatticeField {
    LatticeField::new(
        LatticeValues { lattice: *shape.lattice(), values: shape.baked().to_vec() },
        LatticeValues { lattice: *color.lattice(), values: color.baked().to_vec() },
    )
}

/// The same as a checkpoint stores it.
fn model_bytes(shape: &Levels<1>, color: &Levels<3>) -> Result<Vec<u8>> {
    let bytes = lattice_file::to_bytes(&field_of(shape, color));
    bytes.map_err(|e| Error::Config(format!("the field cannot be stored: {e}")))
}

/// The lattice of so many cells along the edge of the padded unit cube.
fn padded_cube(cells: usize) -> Lattice {
    Lattice::new(cells + 1, UnitCube::default().half_extent() as f32)
}

/// The nodes of a lattice coarser by a power of two.
fn coarsened(active: &ActiveNodes, factor: usize) -> ActiveNodes {
    (0..factor.ilog2()).fold(active.clone(), |active, _| active.coarser())
}

/// What photographs show to be empty in the hull, where they teach the shape.
fn carve(masks: &[MaskDistance], views: &[FastView], lattice: &Lattice, config: &FastConfig) -> Option<Carving> {
    if config.steps == 0 || config.swept_pixels == 0 || config.losses.structure + config.losses.cross_view == 0.0 {
        return None;
    }
    let (hull, _) = hull_start(masks, lattice, config.disagreeing_views.of(masks.len()), None);
    Carving::sweep(views, lattice, &hull, config.swept_pixels)
}

fn shape_start(masks: &[MaskDistance], lattice: &Lattice, carving: Option<&Carving>, config: &FastConfig) -> Levels<1> {
    let (base, active) = hull_start(masks, lattice, config.disagreeing_views.of(masks.len()), carving);
    let coarser = (lattice.cells() / config.coarsest_cells).ilog2() as usize;
    Levels::new(active, base, coarser)
}

fn color_start(shape: &Levels<1>, mean: [f32; 3], config: &FastConfig) -> Levels<3> {
    let active = coarsened(shape.active(), config.color_coarseness);
    let lattice = *active.lattice();
    let base = mean.repeat(lattice.len());
    // Two levels of colour: the finest and one coarser.
    Levels::new(active, base, 1)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use dvr_core::dataset::{ReadOptions, read_scene};
    use dvr_core::mesh::{TexturedMesh, shapes};
    use dvr_core::synth::{SynthConfig, render_dataset};

    use super::*;
    use crate::fast::Capacity;

    /// A small scene of a torus.
    fn scene(folder: &Path) -> dvr_core::Scene {
        let torus = TexturedMesh { mesh: shapes::torus(1.0, 0.45, 32, 16), ..TexturedMesh::default() };
        let few = SynthConfig { views: 8, width: 32, height: 32, ..SynthConfig::default() };
        render_dataset(&torus, "torus", "rings", folder, &few, &|_, _| ()).unwrap();
        read_scene(&folder.join("rings/torus"), &ReadOptions::default()).unwrap()
    }

    #[test]
    fn a_field_does_not_depend_on_the_number_of_threads() {
        let folder = tempfile::tempdir().unwrap();
        let scene = scene(folder.path());
        let field = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let views = ViewSplit::new(&scene, 0).unwrap();
                let config = FastConfig { steps: 20, capacity: Capacity::Cells(64), ..FastConfig::default() };
                let mut trainer = FastTrainer::new(views, config).unwrap();
                while trainer.steps_done() < trainer.total_steps() {
                    trainer.step().unwrap();
                }
                trainer.state().unwrap()
            })
        };
        let (one, three) = (field(1), field(3));
        assert!(one.model == three.model && one.training == three.training, "bit for bit");
    }

    #[test]
    fn a_run_goes_on_from_any_step_as_if_it_had_not_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let scene = scene(folder.path());
        // Stages of 16 cells, taught as a whole, and of 32 and 64, taught near the surface.
        let config = FastConfig {
            steps: 4,
            first_cells: 16,
            whole_cells: 16,
            color_coarseness: 1,
            capacity: Capacity::Cells(64),
            ..FastConfig::default()
        };
        let start = || FastTrainer::new(ViewSplit::new(&scene, 0).unwrap(), config.clone()).unwrap();
        let mut unbroken = start();
        let mut states = Vec::new();
        for _ in 0..12 {
            unbroken.step().unwrap();
            states.push(unbroken.state().unwrap());
        }
        let last = &states[11];
        for (done, state) in states.iter().enumerate().map(|(i, state)| (i + 1, state)) {
            let mut resumed = start();
            resumed.resume(state, done).unwrap();
            (done..12).for_each(|_| drop(resumed.step().unwrap()));
            let end = resumed.state().unwrap();
            assert!(end.model == last.model && end.training == last.training, "from step {done}, bit for bit");
        }
    }
}
