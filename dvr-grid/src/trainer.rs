//! The trainer of the grid method: steps, stages, checkpoints.

use std::borrow::Cow;
use std::collections::BTreeMap;

use burn::tensor::Device;
use dvr_core::hull::{MaskDistance, OutlineContradictions};
use dvr_core::metrics::depth_maps::StereoDepth;
use dvr_core::{Cancellation, Cancelled, Exposure, View, require_masks};
#[cfg(feature = "gpu")]
use dvr_render::is_gpu;
use dvr_render::{SlopeRule, ViewMetrics, view_metrics, view_metrics_at_own_exposure};
use rayon::prelude::*;

use crate::clock::PartTimes;
use crate::color_trust::{self, Agreement};
use crate::config::{ColorTrust, DisagreeingViews, ExposureCorrection, GridConfig};
use crate::error::{Error, Result};
use crate::exposure;
use crate::field::GridField;
use crate::growth::{Growth, NccOfPass, Reached, Verdict};
use crate::losses::LossSums;
use crate::multires::Grids;
use crate::picture_pyramid::{PicturePyramid, PyramidLevel};
use crate::refinement::Refinement;
use crate::report::StepReport;
use crate::step::{CpuBackend, REPORT_EVERY, StepBackend, StepInput};
use crate::validation_ncc::{NccScores, ValidationNcc};
use crate::wrong_masks::leave_out_wrong_masks;

/// Pixels of validation views that decide about growth.
const GROWTH_PIXELS: usize = 30_000;

/// Steps over which the step size of the shape rises to its full size where it starts with much carved. Colours start out the same
/// everywhere: until they are learned, they would close a hollow that is right.
const WARM_UP: usize = 50;

/// A grid field in training.
pub struct GridTrainer<'a> {
    config: GridConfig,
    /// The same with the weights of the losses, and the rays, as they are now.
    weighted: GridConfig,
    /// How far views agree on raw colours, by which these may shape the surface.
    agreement: Agreement,
    validation: Vec<&'a View>,
    validation_ncc: Option<ValidationNcc<'a>>,
    /// NCC scores of the grids that growth keeps, where they are known.
    kept_scores: Option<NccScores>,
    pyramid: PicturePyramid<'a>,
    /// The photographs as this stage sees them.
    photographs: PyramidLevel<'a>,
    /// Names of the views that are learned from.
    names: Vec<String>,
    /// What they are corrected by; empty where they are taken as they are.
    exposures: Vec<Exposure>,
    refinement: Refinement,
    /// Owns the grids.
    backend: Box<dyn StepBackend>,
    /// The losses of the last step that was asked for them.
    sums: Option<LossSums>,
    step: usize,
    /// Steps done before this pass: a stage has one.
    pass_start: usize,
    /// Passes that followed at the size that is kept, this one among them.
    further: usize,
    rays_drawn: u64,
    growth: Growth,
    finished: bool,
    notes: Vec<String>,
    cancellation: Cancellation,
    times: PartTimes,
}

impl<'a> GridTrainer<'a> {
    /// Starts from the visual hull of `train`, the views that are learned from. `validation` decides how fine the field
    /// becomes, and nothing else; without these views it becomes as fine as the pictures and the configuration allow.
    ///
    /// # Errors
    /// When the configuration does not make sense, a view has no mask, or the masks show no object.
    pub fn new(train: Vec<&'a View>, validation: Vec<&'a View>, config: GridConfig) -> Result<Self> {
        Self::start(train, validation, config, &Cancellation::default())
    }

    /// The same; what takes long, here and at the end of a stage, ends where `cancellation` says so. A stage whose end
    /// was stopped so ends when the run is resumed.
    ///
    /// # Errors
    /// As [`GridTrainer::new`]; [`Error::Cancelled`] where somebody wants it to end.
    pub fn start(
        train: Vec<&'a View>,
        validation: Vec<&'a View>,
        config: GridConfig,
        cancellation: &Cancellation,
    ) -> Result<Self> {
        Self::prepare(train, validation, config, None, cancellation)
    }

    /// The same on a device. One that is no GPU leaves all to the CPU.
    ///
    /// On a GPU, distances to the visual hull are measured, photographs compared (plane sweep, stereo), and steps carried out;
    /// a program that emulates one has the steps alone. Steps draw the same rays as on the CPU, and report their losses in
    /// every tenth step. Everything else, such as the decision about a stage, stays on the CPU.
    ///
    /// # Errors
    /// The same; when the photographs or the grids do not fit into the device, or it fails.
    pub fn start_on(
        device: &Device,
        train: Vec<&'a View>,
        validation: Vec<&'a View>,
        config: GridConfig,
        cancellation: &Cancellation,
    ) -> Result<Self> {
        let device = Some(device).filter(|_| config.steps > 0);
        Self::prepare(train, validation, config, device, cancellation)
    }

    /// What is known before training, and the first grids.
    fn prepare(
        mut train: Vec<&'a View>,
        validation: Vec<&'a View>,
        config: GridConfig,
        device: Option<&Device>,
        cancellation: &Cancellation,
    ) -> Result<Self> {
        config.check()?;
        require_masks(train.iter().chain(&validation).copied())?;
        let mut notes = leave_out_wrong_masks(&mut train, &config)?;
        let masks = mask_distances(&train, cancellation)?;
        if config.disagreeing_views == DisagreeingViews::Auto {
            notes.extend(contradictions(&train, &masks, cancellation)?);
        }
        let mut refinement = Refinement::new(masks, &train, &config, device, cancellation)?;
        notes.append(&mut refinement.notes);
        notes.extend(Self::judge_stereo(&train, &config, &mut refinement)?);
        if refinement.is_hollowed() {
            let note;
            (refinement, note) = Self::judged_hollows(&train, &config, refinement, device, cancellation)?;
            notes.extend(note);
        }
        Self::begin(train, validation, config, refinement, notes, device, cancellation)
    }

    /// The same from what is known before training; a device that is a GPU carries out the steps.
    fn begin(
        train: Vec<&'a View>,
        validation: Vec<&'a View>,
        config: GridConfig,
        refinement: Refinement,
        mut notes: Vec<String>,
        device: Option<&Device>,
        cancellation: &Cancellation,
    ) -> Result<Self> {
        let grids = refinement.first(&config)?;
        let growth = Growth::plan(&config, &train);
        let names = train.iter().map(|view| view.name.clone()).collect();
        let pyramid = PicturePyramid::new(train, config.neighbours, grids.shape.grid().spacing());
        let photographs = pyramid.level(pyramid.factor(config.first_cells), refinement.masks());
        if photographs.order.is_empty() || grids.shape.active().count() == 0 {
            return Err(Error::NoHull);
        }
        let judged = pyramid.factor(growth.max_cells());
        let validation_ncc = ValidationNcc::new(&validation, judged, pyramid.views(judged));
        if let Some(ncc) = validation_ncc.as_ref().filter(|_| config.steps == 0) {
            // Nothing follows that would say it.
            notes.push(format!("visual hull: {} cells, NCC score {:.4}", grids.cells(), ncc.scores(&grids).mean()));
        }
        let backend = backend(grids, &photographs, &config, device)?;
        Ok(Self {
            validation_ncc,
            kept_scores: None,
            weighted: GridConfig { rays: config.rays_of(photographs.order.len()), ..config.clone() },
            agreement: Agreement::FULL,
            config,
            validation,
            pyramid,
            photographs,
            names,
            exposures: Vec::new(),
            refinement,
            backend,
            sums: None,
            step: 0,
            pass_start: 0,
            further: 0,
            rays_drawn: 0,
            growth,
            finished: false,
            notes,
            cancellation: cancellation.clone(),
            times: PartTimes::default(),
        })
    }

    /// The depths that stereo found in the views before training, as far as other views confirm them; none where there
    /// was no stereo.
    pub fn stereo_depths(&self) -> &[StereoDepth] {
        &self.refinement.depths
    }

    /// The configuration.
    pub fn config(&self) -> &GridConfig {
        &self.config
    }

    /// Parameters of all levels of shape and colour.
    pub fn parameters(&self) -> usize {
        self.backend.parameters()
    }

    /// Where the time of the steps of this session went.
    pub fn times(&self) -> &PartTimes {
        &self.times
    }

    /// The field as it is now.
    ///
    /// # Errors
    /// When a GPU that keeps it fails.
    pub fn field(&self) -> Result<GridField> {
        Ok(self.backend.grids()?.field())
    }

    /// One step; at the end of a stage also what follows from it.
    ///
    /// # Errors
    /// When the loss is not finite, or a GPU fails.
    pub fn step(&mut self) -> Result<StepReport> {
        let report = self.carry_out()?;
        if !report.loss.is_finite() {
            return Err(Error::Diverged { step: report.step, value: report.loss });
        }
        if self.step == self.end_of_pass() {
            match self.end_pass() {
                // The pass ends when the run is resumed.
                Err(Error::Cancelled(_)) => {}
                ended => ended?,
            }
        }
        Ok(report)
    }

    /// Steps done at the end of this pass.
    fn end_of_pass(&self) -> usize {
        self.pass_start.saturating_add(self.config.steps)
    }

    /// Carries out one step; its losses are those of the last step that was asked for them.
    fn carry_out(&mut self) -> Result<StepReport> {
        let is_last = self.step + 1 == self.end_of_pass();
        let within = self.step - self.pass_start;
        if self.config.exposure == ExposureCorrection::Auto && (within == 0 || self.step == exposure::EARLY) {
            self.solve_exposures()?;
        }
        if self.config.trusts_colors == ColorTrust::Measured
            && self.step > 0
            && within.is_multiple_of(color_trust::EVERY)
        {
            let PyramidLevel { views, order, .. } = &self.photographs;
            let agreement = self.backend.agreement(views, order, &self.config, self.rays_drawn)?;
            self.trust_colors(agreement);
        }
        let (decay, warm_up) = (self.decay(), self.warm_up());
        let input = StepInput {
            config: &self.weighted,
            views: &self.photographs.views,
            order: &self.photographs.order,
            rays_drawn: self.rays_drawn,
            mean_color: self.refinement.mean_color,
            decay,
            warm_up,
            slope_rule: SlopeRule::default(),
            is_reported: is_last || (self.step + 1).is_multiple_of(REPORT_EVERY) || self.sums.is_none(),
            times: &mut self.times,
        };
        let sums = self.backend.step(input)?;
        self.sums = sums.or(self.sums);
        self.step += 1;
        self.rays_drawn += self.weighted.rays as u64;
        let sums = self.sums.unwrap_or_default();
        Ok(StepReport::new(self.step, &self.weighted, &sums, self.config.shape_rate * decay * warm_up))
    }

    /// Lets raw colours shape the surface as far as views agree on them.
    fn trust_colors(&mut self, agreement: Agreement) {
        self.agreement = agreement;
        let (rays, losses) = (self.weighted.rays, self.config.losses.trusting_colors(agreement));
        self.weighted = GridConfig { rays, losses, ..self.config.clone() };
    }

    /// Solves for the exposures of the photographs and corrects them, where that makes views agree.
    fn solve_exposures(&mut self) -> Result<()> {
        let shape = self.backend.shape_values()?;
        let PyramidLevel { views, order, .. } = &self.photographs;
        let solved = exposure::solve(&shape, views, order, &self.config, self.rays_drawn);
        let was_corrected = !self.exposures.is_empty();
        match &solved {
            Some(solved) if !was_corrected => self.notes.push(solved.note()),
            None if was_corrected => self.notes.push("exposures are no longer corrected".to_owned()),
            _ => {}
        }
        if solved.is_some() || was_corrected {
            self.expose(solved.map_or(Vec::new(), |solved| solved.exposures))?;
        }
        Ok(())
    }

    /// Reads the photographs at these exposures; as they are where there are none.
    fn expose(&mut self, exposures: Vec<Exposure>) -> Result<()> {
        self.exposures = exposures;
        self.photographs.expose(&self.exposures);
        self.backend.expose(&self.photographs.views)
    }

    /// Looks at the photographs at the size that grids of this many cells can show.
    fn look_at(&mut self, cells: usize) -> Result<()> {
        let factor = self.pyramid.factor(cells);
        if factor == self.photographs.factor {
            return Ok(());
        }
        self.photographs = self.pyramid.level(factor, self.refinement.masks());
        self.photographs.expose(&self.exposures);
        self.weighted.rays = self.config.rays_of(self.photographs.order.len());
        self.backend.show(&self.photographs.views)
    }

    /// The exposures that photographs are corrected by, with their names: none where all are taken as they are.
    pub fn exposures(&self) -> BTreeMap<String, Exposure> {
        self.names.iter().cloned().zip(self.exposures.iter().copied()).collect()
    }

    /// Factor of the step size of the shape: rises to one.
    fn warm_up(&self) -> f64 {
        let is_hollow = self.refinement.is_hollowed() && self.refinement.is_carved_at(self.config.first_cells);
        if is_hollow { ((self.step + 1) as f64 / WARM_UP as f64).min(1.0) } else { 1.0 }
    }

    /// Ends a pass: that of a stage, or one that followed at the size that is kept.
    fn end_pass(&mut self) -> Result<()> {
        if self.further == 0 { self.end_stage() } else { self.end_further() }
    }

    /// The NCC scores of these grids, and what they say of the pass.
    fn ncc(&self, grids: &Grids) -> (Option<NccScores>, NccOfPass) {
        let judge = self.validation_ncc.as_ref();
        ncc(judge, grids, self.kept_scores.as_ref(), self.growth.history().1)
    }

    /// Ends a stage: keeps its result or takes it back, and grows or ends.
    fn end_stage(&mut self) -> Result<()> {
        let grids = self.backend.grids()?;
        let field = grids.field();
        // What is found out of the same grids does not wait for each other.
        let (judge, kept_scores, kept) =
            (self.validation_ncc.as_ref(), self.kept_scores.as_ref(), self.growth.history().1);
        let (validation, exposures) = (&self.validation, &self.exposures);
        let (bytes, ((scores, ncc), validation)) = rayon::join(
            || grids.field_bytes(),
            || {
                rayon::join(
                    || ncc(judge, &grids, kept_scores, kept),
                    || validated(validation, exposures, &field, GROWTH_PIXELS),
                )
            },
        );
        let bytes = bytes?.len();
        let reached = Reached { cells: grids.cells(), parameters: grids.parameters(), bytes, validation };
        self.cancellation.check()?;
        // The NCC does not see into hollows: no stage is taken back to one without them. Where views hardly agree on
        // colours, it says more of highlights than of the shape.
        let must_gain = self.refinement.is_carved_at(reached.cells / 2) && self.agreement.shine() == 0.0;
        match self.growth.decide(&self.config, reached, ncc, must_gain) {
            Verdict::Grow => {
                let next = self.refinement.refined(&grids, &self.config);
                let next = next.inspect_err(|_| self.growth.undecide())?;
                self.growth.keep(grids.into_owned());
                self.kept_scores = scores;
                let cells = next.cells();
                self.backend.upload(next)?;
                self.look_at(cells)?;
                self.pass_start = self.step;
            }
            Verdict::Stay => {
                self.kept_scores = scores;
                self.go_on(ncc.gain)?;
            }
            Verdict::TakeBack => {
                if let Some(kept) = self.growth.take_back() {
                    self.backend.upload(kept)?;
                }
                self.go_on(None)?;
            }
        }
        self.notes.extend(self.growth.notes());
        Ok(())
    }

    /// Steps done so far.
    pub fn steps_done(&self) -> usize {
        self.step
    }

    /// Steps after which training is done, as far as is known: it falls where nothing more is gained.
    pub fn total_steps(&self) -> usize {
        let stages =
            if self.further == 0 { self.growth.stages().saturating_sub(self.growth.history().0.len()) } else { 1 };
        if self.finished { self.step } else { self.pass_start.saturating_add(self.config.steps.saturating_mul(stages)) }
    }

    /// Metrics on about this many pixels of the validation views; `None` where there are none.
    pub fn validate(&self, pixels: usize) -> Option<ViewMetrics> {
        validated(&self.validation, &self.exposures, &self.field().ok()?, pixels)
    }

    /// What was decided since the last time, for people.
    pub fn notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }
}

/// What carries out steps on these grids: a device, if it is a GPU.
fn backend(
    grids: Grids,
    photographs: &PyramidLevel,
    config: &GridConfig,
    device: Option<&Device>,
) -> Result<Box<dyn StepBackend>> {
    #[cfg(feature = "gpu")]
    if let Some(device) = device.filter(|device| is_gpu(device)) {
        return Ok(Box::new(crate::step::GpuBackend::new(device, &photographs.views, config, grids)?));
    }
    let _ = (photographs, config, device);
    Ok(Box::new(CpuBackend::new(grids)))
}

/// The scores of grids, and what they say of the pass: `kept` are the grids that were kept before it, with their scores where these are known.
fn ncc(
    judge: Option<&ValidationNcc>,
    grids: &Grids,
    kept_scores: Option<&NccScores>,
    kept: Option<&Grids>,
) -> (Option<NccScores>, NccOfPass) {
    let Some(judge) = judge else { return (None, NccOfPass::default()) };
    let now = judge.scores(grids);
    let before = kept.map(|kept| kept_scores.map_or_else(|| Cow::Owned(judge.scores(kept)), Cow::Borrowed));
    let ncc = NccOfPass { mean: Some(now.mean()), gain: before.map(|before| now.gain_over(&before)) };
    (Some(now), ncc)
}

/// Metrics on about this many pixels of the validation views: at their own exposure where light changes.
fn validated(validation: &[&View], exposures: &[Exposure], field: &GridField, pixels: usize) -> Option<ViewMetrics> {
    let metrics = if exposures.is_empty() { view_metrics } else { view_metrics_at_own_exposure };
    metrics(field, validation, pixels)
}

/// The distances of the masks' outlines.
fn mask_distances(train: &[&View], cancellation: &Cancellation) -> std::result::Result<Vec<MaskDistance>, Cancelled> {
    let pairs = train.par_iter().filter_map(|view| view.training_pair());
    pairs.map(|(camera, mask)| cancellation.check().map(|()| MaskDistance::new(camera, mask))).collect()
}

/// What the outlines say against each other.
fn contradictions(
    train: &[&View],
    masks: &[MaskDistance],
    cancellation: &Cancellation,
) -> std::result::Result<Option<String>, Cancelled> {
    let cameras: Vec<_> = train.iter().map(|view| &view.camera).collect();
    let names: Vec<&str> = train.iter().map(|view| view.name.as_str()).collect();
    Ok(OutlineContradictions::find(&cameras, masks, cancellation)?.note(&names))
}

/// The depths that stereo finds in these views before training, as far as other views confirm them; none where this
/// configuration has no stereo.
///
/// # Errors
/// As [`GridTrainer::start`].
pub fn stereo_depths(
    mut train: Vec<&View>,
    config: &GridConfig,
    cancellation: &Cancellation,
) -> Result<Vec<StereoDepth>> {
    require_masks(train.iter().copied())?;
    leave_out_wrong_masks(&mut train, config)?;
    let config = GridConfig { plane_sweep_pixels: 0, ..config.clone() };
    Ok(Refinement::new(mask_distances(&train, cancellation)?, &train, &config, None, cancellation)?.depths)
}

mod band;
mod checkpoint;
mod hollows;
mod passes;
mod rates;
mod stereo;
#[cfg(test)]
mod tests;

pub use rates::Rates;
