//! One cell: a scene is rendered, reconstructed, measured and judged.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

use anyhow::{Context, Result};
use dvr_core::mesh::read_mesh;
use dvr_render::SlopeRule;
use dvr_stress::{Axis, Case, Cell, GradientTest, Kind, Verdict, judge, measure, write_scene};
use dvr_train::RunFolder;
use serde::{Deserialize, Serialize};

use crate::EXIT_INTERRUPTED;
use crate::args::Variant;
use crate::commands::job::{Ended, Job, once, stored};
use crate::interrupt::INTERRUPTED;

/// Slope rules by name.
const RULES: [(&str, SlopeRule); 2] =
    [("scale-free", SlopeRule::ScaleFree { epsilon: 0.05 }), ("classic-clamp", SlopeRule::CLASSIC)];

/// A cell to compute.
pub struct Task<'a> {
    pub axis: &'a Axis,
    pub difficulty: f64,
    pub seed: u64,
    /// The method; for axes of gradients, the slope rule by its name.
    pub variant: Variant,
    pub out: &'a Path,
}

/// A cell as it is stored, with its time, which results leave out because it varies.
#[derive(Serialize, Deserialize)]
struct Stored {
    cell: Cell,
    seconds: f64,
}

impl Task<'_> {
    /// The slope rules that axes of gradients compare.
    pub fn rules() -> [&'static str; 2] {
        RULES.map(|(name, _)| name)
    }

    /// Name, for progress and files.
    pub fn name(&self) -> String {
        format!("{}.{}", self.scene_name(), self.variant.name)
    }

    /// Whether it is neither the method of this name nor the hull that it is compared with.
    pub fn is_rival_of(&self, name: &str) -> bool {
        matches!(self.axis.kind, Kind::Scene(_)) && ![name, "hull"].contains(&&*self.variant.name)
    }

    fn scene_name(&self) -> String {
        format!("{}.{}.{}", self.axis.name, Axis::label(self.difficulty), self.seed)
    }

    fn file(&self, variant: &str) -> PathBuf {
        self.out.join("cells").join(format!("{}.{variant}.json", self.scene_name()))
    }

    /// How long it took, where it is stored.
    pub fn seconds(&self) -> Result<Option<f64>> {
        Ok(stored::<Stored>(&self.file(&self.variant.name))?.map(|kept| kept.seconds))
    }

    /// The cell, which is computed unless it is stored; `None` after Ctrl-C.
    pub fn cell(&self) -> Result<Option<Cell>> {
        let mut stopped = false;
        let kept = once(&self.file(&self.variant.name), || {
            let start = Instant::now();
            let cell = match self.axis.kind {
                Kind::Gradient(test) => Some(self.gradient(test)),
                Kind::Scene(case) => self.reconstruct(&case(self.difficulty))?,
            };
            stopped = cell.is_none();
            Ok(Stored { cell: cell.context("stopped")?, seconds: start.elapsed().as_secs_f64() })
        });
        match kept {
            Err(_) if stopped => Ok(None),
            kept => Ok(Some(self.judged(kept?.cell)?)),
        }
    }

    /// The cell with its verdict, which depends on the hull, whose cell may be newer.
    fn judged(&self, mut cell: Cell) -> Result<Cell> {
        if let (Some(figures), Some(case)) = (&cell.figures, self.axis.case(self.difficulty)) {
            let hull = stored::<Stored>(&self.file("hull"))?.and_then(|kept| kept.cell.figures);
            cell.verdict = judge(&case, figures, hull.as_ref().filter(|hull| hull.faces > 0));
        }
        Ok(cell)
    }

    fn blank(&self, verdict: Verdict) -> Cell {
        Cell {
            axis: self.axis.name.to_owned(),
            difficulty: self.difficulty,
            method: self.variant.name.clone(),
            seed: self.seed,
            verdict,
            value: None,
            figures: None,
            note: None,
        }
    }

    fn gradient(&self, test: GradientTest) -> Cell {
        let rule = RULES.iter().find(|(name, _)| *name == self.variant.name).map_or(RULES[0].1, |(_, rule)| *rule);
        let figure = test.figure(&|slope, scale| rule.inverse_slope_of(slope, scale), self.difficulty, self.seed);
        let verdict = match figure {
            f if !f.is_finite() => Verdict::Exploded,
            f if f > GradientTest::LIMIT => Verdict::Inaccurate,
            _ => Verdict::Solved,
        };
        Cell { value: Some(figure), ..self.blank(verdict) }
    }

    fn reconstruct(&self, case: &Case) -> Result<Option<Cell>> {
        let scene = self.out.join("scenes").join(self.scene_name());
        if !scene.exists() {
            write_scene(case, &self.scene_name(), self.seed, self.out)?;
        }
        let folder = RunFolder::new(self.out.join("runs").join(self.name()));
        let (variant, seed) = (&self.variant, self.seed);
        let job =
            Job { scene: &scene, folder: &folder, variant, supervision: "rgb", seed, time: None, follow_shape: false };
        let cell = match job.run()? {
            Ended::Measured { metrics, .. } => {
                let mesh = metrics.mesh.map(|_| read_mesh(folder.mesh_ply())).transpose()?;
                let figures = measure(case, self.seed, mesh.as_ref().map(|read| &read.mesh))?;
                let verdict = judge(case, &figures, None);
                let value = figures.seen_chamfer_l1.or(figures.chamfer_l1);
                Some(Cell { value, figures: Some(figures), ..self.blank(verdict) })
            }
            Ended::Failed { code, .. } if code == Some(i32::from(EXIT_INTERRUPTED)) => None,
            Ended::Failed { .. } if INTERRUPTED.load(Ordering::Relaxed) => None,
            Ended::Failed { said, code } => {
                // A loss that is not finite is the method's failure, and so is a crash.
                let is_explosion = code != Some(2) || said.contains("the loss became");
                let verdict = if is_explosion { Verdict::Exploded } else { Verdict::Refused };
                Some(Cell { note: Some(said), ..self.blank(verdict) })
            }
        };
        // Meshes take megabytes and can be made again by one command; figures and scene stay.
        if folder.root().exists() {
            std::fs::remove_dir_all(folder.root()).with_context(|| folder.root().display().to_string())?;
        }
        Ok(cell)
    }
}

#[cfg(test)]
mod tests {
    use dvr_stress::axes;

    use super::*;

    #[test]
    fn the_scale_free_rule_is_independent_of_the_scale_of_the_field_and_the_classic_one_is_not() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("cells")).unwrap();
        let axes = axes();
        let axis = axes.iter().find(|axis| axis.name == "gradient-scale").unwrap();
        let verdict = |rule: &str, difficulty: f64| {
            let variant = Variant { name: rule.into(), method: String::new(), settings: vec![] };
            let task = Task { axis, difficulty, seed: 0, variant, out: folder.path() };
            task.cell().unwrap().unwrap().verdict
        };
        assert_eq!([1.0, 0.0001].map(|scale| verdict("scale-free", scale)), [Verdict::Solved; 2]);
        assert_eq!([1.0, 0.0001].map(|s| verdict("classic-clamp", s)), [Verdict::Solved, Verdict::Inaccurate]);
    }
}
