//! No more model than the scene needs: when the grids grow, and when growth is taken back.

use dvr_core::{UnitCube, View};
use serde::{Deserialize, Serialize};

use crate::config::{Capacity, GridConfig};
use crate::multires::Grids;
use crate::picture_pyramid::median_footprint;
use crate::validation_ncc::Gain;
use dvr_render::ViewMetrics;

/// A cell that is smaller than this share of a pixel's footprint cannot show more than the pictures do.
const FINEST_CELL: f64 = 0.5;

/// Gain in NCC score from which on a further pass is kept where the number of cells is given, and loss from which on a stage
/// has the worse shape, in standard errors.
const MIN_GAIN_ERRORS: f64 = 2.0;

/// What a stage came to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Reached {
    pub cells: usize,
    pub parameters: usize,
    pub bytes: usize,
    #[serde(with = "super::exact")]
    pub validation: Option<ViewMetrics>,
}

/// The shape at the end of a pass, by the NCC of validation photographs.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct NccOfPass {
    /// Mean score; `None` where these photographs are plain or there are none.
    pub mean: Option<f64>,
    /// How much better than what was kept before it.
    pub gain: Option<Gain>,
}

/// What to do after a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    Grow,
    Stay,
    TakeBack,
}

/// The course of a run's growth.
pub(crate) struct Growth {
    /// Most cells along an edge.
    max_cells: usize,
    stages: usize,
    reached: Vec<Reached>,
    kept: Option<Grids>,
    notes: Vec<String>,
}

impl Growth {
    /// Plans as many stages as the configuration and the pictures allow.
    pub fn plan(config: &GridConfig, train: &[&View]) -> Self {
        let limit = match config.capacity {
            Capacity::Cells(cells) => cells,
            Capacity::Auto { max_cells, .. } => {
                let useful = 2.0 * UnitCube::default().half_extent() / (FINEST_CELL * median_footprint(train));
                max_cells.min(useful as usize)
            }
        };
        let mut max_cells = config.first_cells;
        let mut stages = 1;
        while 2 * max_cells <= limit {
            max_cells *= 2;
            stages += 1;
        }
        Self { max_cells, stages, reached: Vec::new(), kept: None, notes: Vec::new() }
    }

    /// Most cells along an edge.
    pub fn max_cells(&self) -> usize {
        self.max_cells
    }

    /// Stages that there will be, as far as is known.
    pub fn stages(&self) -> usize {
        self.stages
    }

    /// Decides after a stage. One that must gain is taken back where it gains too little over the stage before.
    pub fn decide(&mut self, config: &GridConfig, now: Reached, ncc: NccOfPass, must_gain: bool) -> Verdict {
        let (Reached { cells, parameters, bytes, validation }, NccOfPass { mean, gain }) = (now, ncc);
        let mut metrics =
            validation.map_or(String::new(), |v| format!(", validation {:.2} dB, IoU {:.4}", v.psnr, v.mask_iou));
        metrics += &mean.map_or(String::new(), |mean| format!(", NCC score {mean:.4}"));
        metrics += &gain.map_or(String::new(), |gain| format!(" ({:+.4} +- {:.4})", gain.mean, gain.error));
        self.notes.push(format!("{cells} cells: {parameters} parameters in training, {bytes} bytes stored{metrics}"));
        let before = self.reached.last().copied();
        self.reached.push(now);
        if config.max_bytes > 0 && bytes > config.max_bytes {
            let verdict = if before.is_some() { Verdict::TakeBack } else { Verdict::Stay };
            self.notes.push(match before {
                Some(before) => {
                    format!("{} cells are kept: more would take over {} bytes", before.cells, config.max_bytes)
                }
                None => format!("{bytes} bytes are more than {}: set first_cells lower", config.max_bytes),
            });
            return verdict;
        }
        if let (Capacity::Auto { min_cells, min_gain_errors, min_gain_db, .. }, Some(before)) =
            (config.capacity, before)
            && cells > min_cells
            && must_gain
        {
            let brought = before.validation.zip(validation).map(|(old, new)| new.psnr - old.psnr);
            let is_better_picture = brought.is_some_and(|brought| brought >= min_gain_db);
            let too_little = match gain {
                // A better picture counts where the shape is no worse.
                Some(gain) if is_better_picture && gain.mean > -MIN_GAIN_ERRORS * gain.error => None,
                Some(gain) if gain.mean < min_gain_errors * gain.error => {
                    Some(brought.map_or(gain.to_string(), |brought| format!("{gain} and {brought:+.2} dB")))
                }
                None if !is_better_picture => brought.map(|brought| format!("{brought:+.2} dB")),
                _ => None,
            };
            if let Some(gain) = too_little {
                self.notes.push(format!("{} cells are kept: {cells} bring {gain}", before.cells));
                return Verdict::TakeBack;
            }
        }
        if 2 * cells > self.max_cells { Verdict::Stay } else { Verdict::Grow }
    }

    /// Whether what a further pass learned is kept: where validation photographs gain more than noise does.
    pub fn keeps_further(&mut self, config: &GridConfig, cells: usize, gain: Option<Gain>) -> bool {
        let min_errors = match config.capacity {
            Capacity::Auto { min_gain_errors, .. } => min_gain_errors,
            Capacity::Cells(_) => MIN_GAIN_ERRORS,
        };
        let is_kept = gain.is_some_and(|gain| gain.mean > min_errors * gain.error);
        let brought = gain.map_or("nothing that is known".to_owned(), |gain| gain.to_string());
        let verdict = if is_kept { "are kept" } else { "are not: training ends" };
        self.notes.push(format!("{} more steps with {cells} cells bring {brought}, and {verdict}", config.steps));
        is_kept
    }

    /// Takes the last decision back: what followed from it was stopped half-way.
    pub fn undecide(&mut self) {
        self.reached.pop();
        self.notes.clear();
    }

    /// Keeps a stage's result while the next one is tried.
    pub fn keep(&mut self, grids: Grids) {
        self.kept = Some(grids);
    }

    /// The result of the stage before.
    pub fn take_back(&mut self) -> Option<Grids> {
        self.kept.take()
    }

    /// The stages so far, and the result that may be taken back to.
    pub fn history(&self) -> (&[Reached], Option<&Grids>) {
        (&self.reached, self.kept.as_ref())
    }

    /// Takes up the history of an interrupted run.
    pub fn resume(&mut self, reached: Vec<Reached>, kept: Option<Grids>) {
        (self.reached, self.kept) = (reached, kept);
    }

    /// What was decided since the last time, for people.
    pub fn notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is decided after a stage of 128 cells that follows one of 64, with this gain of NCC score and this PSNR.
    fn decided(gain: Option<Gain>, psnr: f64) -> (Verdict, String) {
        decided_where(true, gain, psnr)
    }

    /// The same where the stage must gain, or need not.
    fn decided_where(must_gain: bool, gain: Option<Gain>, psnr: f64) -> (Verdict, String) {
        let config = GridConfig::default();
        let metrics = |psnr| Some(ViewMetrics { psnr, mask_iou: 1.0, pixels: 1 });
        let reached = |cells, psnr| Reached { cells, parameters: 1, bytes: 1, validation: metrics(psnr) };
        let mut growth =
            Growth { max_cells: 256, stages: 4, reached: vec![reached(64, 20.0)], kept: None, notes: Vec::new() };
        let verdict = growth.decide(&config, reached(128, psnr), NccOfPass { mean: Some(0.5), gain }, must_gain);
        (verdict, growth.notes().join("; "))
    }

    #[test]
    fn a_further_pass_is_kept_where_its_gain_stands_out_from_noise() {
        let decided = |capacity, gain| {
            let config = GridConfig { capacity, ..GridConfig::default() };
            let mut growth = Growth { max_cells: 64, stages: 2, reached: Vec::new(), kept: None, notes: Vec::new() };
            let is_kept = growth.keeps_further(&config, 64, gain);
            (is_kept, growth.notes().join("; "))
        };
        let gain = |mean| Some(Gain { mean, error: 0.001 });
        let patient = Capacity::Auto { min_cells: 64, max_cells: 64, min_gain_errors: -5.0, min_gain_db: 0.1 };
        for capacity in [GridConfig::default().capacity, Capacity::Cells(64)] {
            assert!(decided(capacity, gain(0.0021)).0 && !decided(capacity, gain(0.0019)).0);
            assert!(!decided(capacity, None).0, "nothing judges");
        }
        assert!(decided(patient, gain(-0.004)).0, "as the configuration says");
        let (_, said) = decided(Capacity::Cells(64), gain(0.0004));
        let expected = "300 more steps with 64 cells bring +0.0004 +- 0.0010 of NCC score, and are not: training ends";
        assert_eq!(said, expected);
    }

    #[test]
    fn the_ncc_decides_and_psnr_where_the_ncc_sees_no_difference_or_there_is_none() {
        let gain = |mean| Some(Gain { mean, error: 0.001 });
        assert_eq!(decided(gain(0.01), 15.0).0, Verdict::Grow, "a worse picture of a better shape");
        assert_eq!(decided(gain(-0.001), 25.0).0, Verdict::Grow, "a better picture of a shape that is no worse");
        assert_eq!(decided(gain(0.001), 20.01).0, Verdict::TakeBack, "neither is better");
        let (verdict, said) = decided(gain(-0.003), 25.0);
        assert_eq!(verdict, Verdict::TakeBack, "a better picture of a worse shape");
        assert!(said.contains("64 cells are kept: 128 bring -0.0030 +- 0.0010 of NCC score and +5.00 dB"), "{said}");
        assert_eq!(decided(None, 25.0).0, Verdict::Grow);
        assert_eq!(decided(None, 20.01).0, Verdict::TakeBack);
        assert_eq!(decided_where(false, gain(-0.01), 15.0).0, Verdict::Grow, "nothing judges it");
    }
}
