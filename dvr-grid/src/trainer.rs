//! The fast trainer: grids, exact crossings, gradients by hand.

use std::borrow::Cow;

use crate::active::ActiveNodes;
use crate::field::{GridField, GridValues, file};
use burn::tensor::Device;
use dvr_core::UnitCube;
use dvr_core::hull::MaskDistance;
use dvr_core::voxel::VoxelGrid;
use dvr_render::is_gpu;
use rayon::prelude::*;

use crate::clock::PartTimes;
use crate::config::GridConfig;
use crate::error::{Error, Result};
use crate::growth::{Growth, Reached, Verdict};
use crate::multires::{MultiResGrid, prolonged};
use crate::start::SpaceCarving;
use crate::start::{add_hull_detail, hull_start};
use crate::state;
use crate::step::CpuBackend;
use crate::step::mean_object_color;
use crate::step::{StepBackend, StepInput, StepSums};
use crate::views::{PixelOrder, TrainingView};
use crate::wrong_masks::leave_out_wrong_masks;
use dvr_core::ViewSplit;
use dvr_render::{ViewMetrics, view_metrics};

/// Pixels of held-out views that decide about growth.
const JUDGING_PIXELS: usize = 30_000;

/// How near to the surface a node is taught where not all are, in nodes.
const BAND_NODES: usize = 3;

/// What a step did.
#[derive(Clone, Debug)]
pub struct StepReport {
    /// The step, counted from 1.
    pub step: usize,
    /// The loss. On a GPU it is read back in every tenth step, and is that of the last of these otherwise.
    pub loss: f64,
    /// Name and weighted value of each term.
    pub terms: Vec<(&'static str, f64)>,
    /// Intersection over union of mask and hits in this batch.
    pub mask_iou: f64,
    /// Adam's step size at the coarsest level.
    pub learning_rate: f64,
}

/// What a trainer needs to go on, and what it has learned.
#[derive(Clone, Debug)]
pub struct TrainerState {
    /// The field, as [`crate::grid_file`] stores it.
    pub model: Vec<u8>,
    /// Parameters, moments and progress.
    pub training: Vec<u8>,
}

/// On a GPU, losses are read back once in so many steps: reading them makes the program wait for the device.
pub(crate) const READ_EVERY: usize = 10;

/// A grid field in training.
pub struct GridTrainer<'a> {
    config: GridConfig,
    views: ViewSplit<'a>,
    packed: Vec<TrainingView<'a>>,
    masks: Vec<MaskDistance>,
    carving: Option<SpaceCarving>,
    order: PixelOrder,
    /// What is learned, where `backend` does not keep it to itself: see [`GridTrainer::levels`].
    shape: MultiResGrid<1>,
    color: MultiResGrid<3>,
    backend: Box<dyn StepBackend>,
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

impl<'a> GridTrainer<'a> {
    /// Starts from the visual hull.
    ///
    /// # Errors
    /// When the configuration does not make sense, a view has no mask, or the masks show no object.
    pub fn new(mut views: ViewSplit<'a>, config: GridConfig) -> Result<Self> {
        config.check()?;
        views.require_masks()?;
        let notes = leave_out_wrong_masks(&mut views, &config)?;
        let masks: Vec<MaskDistance> = (views.train.par_iter())
            .filter_map(|view| view.training_pair())
            .map(|(camera, mask)| MaskDistance::new(camera, mask))
            .collect();
        let packed = TrainingView::pack(&views.train, config.neighbours);
        let grid = padded_cube(config.first_cells);
        let carving = carve(&masks, &packed, &grid, &config);
        let shape = shape_start(&masks, &grid, carving.as_ref(), &config);
        let mean_color = mean_object_color(&views.train).to_array();
        let color = color_start(&shape, mean_color, &config);
        // Pixels whose rays come as close to the object as the band around the hull.
        let margin = |view: usize| {
            let camera = &views.train[view].camera;
            let depth = camera.center().length().max(UnitCube::default().half_extent());
            (4.0 * f64::from(grid.spacing()) * camera.intrinsics.x_axis.x.abs() / depth) as f32 + 1.0
        };
        let order = PixelOrder::new(&views.train, &masks, margin);
        if order.is_empty() || shape.active().count() == 0 {
            return Err(Error::NoHull);
        }
        let growth = Growth::plan(&config, &views);
        Ok(Self {
            config,
            views,
            packed,
            masks,
            carving,
            order,
            backend: Box::new(CpuBackend::new(&shape, &color)),
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
    /// When the photographs or the grids do not fit into the device.
    #[cfg_attr(not(feature = "gpu"), expect(unused_mut, reason = "there are no graphics processors in this build"))]
    pub fn on(mut self, device: &Device) -> Result<Self> {
        if !is_gpu(device) || self.config.steps == 0 {
            return Ok(self);
        }
        #[cfg(feature = "gpu")]
        {
            self.backend = Box::new(crate::step::GpuBackend::new(device, &self.packed, &self.config)?);
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
            cells: self.shape.grid().cells(),
            parameters: self.parameters(),
            bytes: model_bytes(&self.shape, &self.color)?.len(),
            held_out: view_metrics(&field_of(&self.shape, &self.color), &self.views.held_out, JUDGING_PIXELS),
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
    pub fn config(&self) -> &GridConfig {
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
    pub fn field(&self) -> Result<GridField> {
        let (shape, color) = self.levels()?;
        Ok(field_of(&shape, &color))
    }

    /// The levels of shape and colour as they are now.
    fn levels(&self) -> Result<(Cow<'_, MultiResGrid<1>>, Cow<'_, MultiResGrid<3>>)> {
        let Some((shape_state, color_state)) = self.backend.levels()? else {
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
        let job = StepInput {
            config: &self.config,
            views: &self.packed,
            order: &self.order,
            rays_drawn: self.rays_drawn,
            mean_color: self.mean_color,
            decay,
            is_reported: last_of_stage || (self.step + 1).is_multiple_of(READ_EVERY) || self.sums.is_none(),
            times: &mut self.times,
        };
        let sums = self.backend.step(job, &mut self.shape, &mut self.color)?;
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
        let cells = 2 * self.shape.grid().cells();
        if cells > self.config.whole_cells {
            let (shape, color) = (self.shape.values().to_vec(), self.color.values().to_vec());
            return self.freeze_base(&shape, &color);
        }
        let grid = padded_cube(cells);
        let disagreeing = self.config.disagreeing_views.of(self.masks.len());
        let (base, active) = hull_start(&self.masks, &grid, disagreeing, self.carving.as_ref());
        self.shape = self.shape.refined(active, base);
        let base = self.mean_color.repeat((cells / self.config.color_coarseness + 1).pow(3));
        self.color = self.color.refined(coarsened(self.shape.active(), self.config.color_coarseness), base);
        self.stage += 1;
    }

    /// A stage that starts from what was learned on grids of half the cells, and only moves what is near the
    /// surface.
    fn freeze_base(&mut self, shape: &[f32], color: &[f32]) {
        let cells = 2 * self.shape.grid().cells();
        let grid = padded_cube(cells);
        let mut base = prolonged::<1>(shape, &grid);
        let near = ActiveNodes::near_surface(&grid, &base, BAND_NODES);
        add_hull_detail(&self.masks, &near, self.config.disagreeing_views.of(self.masks.len()), &mut base);
        let near_color = coarsened(&near, self.config.color_coarseness);
        let color = prolonged::<3>(color, near_color.grid());
        self.color = MultiResGrid::on_frozen_base(near_color, color, self.color.coarser() + 1);
        self.shape = MultiResGrid::on_frozen_base(near, base, self.shape.coarser() + 1);
        self.stage += 1;
    }

    /// Brings everything up to date that follows from the levels.
    fn follow_levels(&mut self) -> Result<()> {
        self.backend.enter(&self.shape, &self.color)
    }

    fn report(&self, sums: &StepSums, learning_rate: f64) -> StepReport {
        let (losses, smoothness, sums) = (&self.config.losses, sums.smoothness, &sums.rays);
        let mean = 1.0 / self.config.rays as f64;
        let terms = vec![
            ("color", losses.color * sums.color * mean),
            ("texture", losses.texture * sums.color * mean),
            (
                "photo_consistency",
                losses.photo_consistency * sums.photo_consistency * mean / self.config.compared_views.max(1) as f64,
            ),
            ("patch_ncc", losses.patch_ncc * sums.patch_ncc * mean / self.config.compared_views.max(1) as f64),
            ("depth", losses.depth * sums.depth * mean),
            ("mask", losses.mask * sums.mask * mean),
            ("smoothness", losses.smoothness * f64::from(smoothness)),
        ];
        StepReport {
            step: self.step,
            loss: terms.iter().map(|(_, value)| value).sum(),
            terms,
            mask_iou: if sums.union == 0 { 1.0 } else { sums.intersection as f64 / sums.union as f64 },
            learning_rate,
        }
    }
}

impl GridTrainer<'_> {
    /// One step; at the end of a stage also what follows from it.
    ///
    /// # Errors
    /// When the loss is not finite, or a GPU fails.
    pub fn step(&mut self) -> Result<StepReport> {
        let report = self.follow_rays()?;
        if !report.loss.is_finite() {
            return Err(Error::Diverged { step: report.step, value: report.loss });
        }
        if self.step == self.config.steps.saturating_mul(self.stage + 1) {
            self.end_stage()?;
        }
        Ok(report)
    }

    /// Steps done so far.
    pub fn steps_done(&self) -> usize {
        self.step
    }

    /// Steps after which training is done, as far as is known: it falls where nothing more is gained.
    pub fn total_steps(&self) -> usize {
        if self.finished { self.step } else { self.config.steps.saturating_mul(self.growth.stages()) }
    }

    /// Metrics on about so many pixels of the held-out views; `None` where none are held out.
    pub fn validate(&self, pixels: usize) -> Option<ViewMetrics> {
        view_metrics(&self.field().ok()?, &self.views.held_out, pixels)
    }

    /// Enough to go on later.
    ///
    /// # Errors
    /// When a GPU that keeps the grids fails.
    pub fn state(&self) -> Result<TrainerState> {
        let (reached, kept) = self.growth.history();
        let progress = state::Progress {
            stage: self.stage,
            cells: self.shape.grid().cells(),
            reached: reached.to_vec(),
            has_kept: kept.is_some(),
            finished: self.finished,
            rays_drawn: self.rays_drawn,
        };
        let kept = kept.map(|(shape, color)| (shape, color));
        let (shape, color) = self.levels()?;
        let training = state::to_bytes(&progress, (&shape, &color), kept)?;
        Ok(TrainerState { model: model_bytes(&shape, &color)?, training })
    }

    /// Goes on where `state` was taken, after so many steps.
    ///
    /// # Errors
    /// When the state is damaged or of another configuration.
    pub fn resume(&mut self, state: &TrainerState, steps: usize) -> Result<()> {
        let progress = state::progress(&state.training)?;
        let mut kept = None;
        // A stage that was taken back left its number, not its cells.
        while self.shape.grid().cells() < progress.cells {
            kept = Some((self.shape.clone(), self.color.clone()));
            let is_last = 2 * self.shape.grid().cells() == progress.cells;
            let names = if is_last { state::PRESENT } else { state::KEPT };
            match state::learned(&state.training, names)? {
                Some((shape, color)) if 2 * self.shape.grid().cells() > self.config.whole_cells => {
                    if (shape.len(), color.len()) != (self.shape.values().len(), self.color.values().len()) {
                        return Err(state::misfit());
                    }
                    self.freeze_base(&shape, &color);
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

    /// What was decided since the last time, for people.
    pub fn notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }
}

/// The field that levels make.
fn field_of(shape: &MultiResGrid<1>, color: &MultiResGrid<3>) -> GridField {
    GridField::new(
        GridValues { grid: *shape.grid(), values: shape.values().to_vec() },
        GridValues { grid: *color.grid(), values: color.values().to_vec() },
    )
}

/// The same as a checkpoint stores it.
fn model_bytes(shape: &MultiResGrid<1>, color: &MultiResGrid<3>) -> Result<Vec<u8>> {
    Ok(file::to_bytes(&field_of(shape, color))?)
}

/// The grid of so many cells along the edge of the padded unit cube.
fn padded_cube(cells: usize) -> VoxelGrid {
    VoxelGrid::new(cells + 1, UnitCube::default().half_extent() as f32)
}

/// The nodes of a grid coarser by a power of two.
fn coarsened(active: &ActiveNodes, factor: usize) -> ActiveNodes {
    (0..factor.ilog2()).fold(active.clone(), |active, _| active.coarser())
}

/// What photographs show to be empty in the hull, where they teach the shape.
fn carve(
    masks: &[MaskDistance],
    views: &[TrainingView],
    grid: &VoxelGrid,
    config: &GridConfig,
) -> Option<SpaceCarving> {
    if config.steps == 0
        || config.plane_sweep_pixels == 0
        || config.losses.patch_ncc + config.losses.photo_consistency == 0.0
    {
        return None;
    }
    let (hull, _) = hull_start(masks, grid, config.disagreeing_views.of(masks.len()), None);
    SpaceCarving::sweep(views, grid, &hull, config.plane_sweep_pixels)
}

fn shape_start(
    masks: &[MaskDistance],
    grid: &VoxelGrid,
    carving: Option<&SpaceCarving>,
    config: &GridConfig,
) -> MultiResGrid<1> {
    let (base, active) = hull_start(masks, grid, config.disagreeing_views.of(masks.len()), carving);
    let coarser = (grid.cells() / config.coarsest_cells).ilog2() as usize;
    MultiResGrid::new(active, base, coarser)
}

fn color_start(shape: &MultiResGrid<1>, mean: [f32; 3], config: &GridConfig) -> MultiResGrid<3> {
    let active = coarsened(shape.active(), config.color_coarseness);
    let grid = *active.grid();
    let base = mean.repeat(grid.len());
    // Two levels of colour: the finest and one coarser.
    MultiResGrid::new(active, base, 1)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use dvr_core::dataset::{ReadOptions, read_scene};
    use dvr_core::mesh::{TexturedMesh, shapes};
    use dvr_core::synth::{SynthConfig, render_dataset};

    use super::*;
    use crate::Capacity;

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
                let config = GridConfig { steps: 20, capacity: Capacity::Cells(64), ..GridConfig::default() };
                let mut trainer = GridTrainer::new(views, config).unwrap();
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
        let config = GridConfig {
            steps: 4,
            first_cells: 16,
            whole_cells: 16,
            color_coarseness: 1,
            capacity: Capacity::Cells(64),
            ..GridConfig::default()
        };
        let start = || GridTrainer::new(ViewSplit::new(&scene, 0).unwrap(), config.clone()).unwrap();
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
