//! One cell: a scene is rendered, reconstructed, measured and judged.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use dvr_core::Cancellation;
use dvr_core::mesh::read_mesh;
use dvr_core::record::{Digest, RecordKey};
use dvr_render::SlopeRule;
use dvr_stress::{Axis, Case, Cell, GradientTest, Kind, Verdict, judge, measure};
use dvr_train::RunFolder;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::results::Row;
use super::scene::StressScene;
use crate::args::Variant;
use crate::commands::job::{Ended, Job};
use crate::commands::kept_row::{Kept, keep, kept};
use crate::commands::provenance::record_key;

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
pub struct Stored {
    cell: Cell,
    /// Wall seconds that it took.
    pub seconds: f64,
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

    fn scene(&self) -> StressScene<'_> {
        StressScene { axis: self.axis, difficulty: self.difficulty, seed: self.seed, out: self.out }
    }

    fn scene_name(&self) -> String {
        self.scene().name()
    }

    fn file(&self, variant: &str) -> PathBuf {
        self.out.join("cells").join(format!("{}.{variant}.json", self.scene_name()))
    }

    /// The key of this cell on a scene of that digest.
    fn key(&self, scene: Digest) -> Result<RecordKey> {
        let Self { axis, difficulty, seed, .. } = self;
        let of = |settings| json!({ "axis": axis.name, "difficulty": difficulty, "seed": seed, "method": settings });
        if let Kind::Gradient(_) = axis.kind {
            return record_key(scene, &of(json!({ "slope_rule": self.variant.name })), "cpu");
        }
        let (path, folder, token) = (self.scene().folder(), self.run_folder(), Cancellation::default());
        let job = self.job(&path, &folder, &token);
        job.record_key(scene, &of(job.settings().with_context(|| self.name())?))
    }

    /// What is kept of it, on the scene as it lies there.
    ///
    /// # Errors
    /// When its file is damaged, or the method would refuse its settings.
    pub fn kept(&self) -> Result<Kept<Stored>> {
        match self.scene().digest()? {
            Some(digest) => kept(&self.file(&self.variant.name), &self.key(digest)?),
            None => Ok(Kept::Nothing),
        }
    }

    /// The cell, which is computed unless it is kept.
    ///
    /// # Errors
    /// When a file cannot be read or written, the method not be started, or somebody wanted it to end.
    pub fn row(&self, cancellation: &Cancellation) -> Result<Row> {
        let key = self.key(self.scene().ready()?)?;
        let file = self.file(&self.variant.name);
        let stored = match kept::<Stored>(&file, &key)? {
            Kept::Row(stored) => stored,
            _ => {
                let start = Instant::now();
                let cell = match self.axis.kind {
                    Kind::Gradient(test) => self.gradient(test),
                    Kind::Scene(case) => self.reconstruct(&case(self.difficulty), cancellation)?,
                };
                keep(&file, &key, Stored { cell, seconds: start.elapsed().as_secs_f64() })?
            }
        };
        Ok(Row { cell: self.judged(stored.cell, &key)?, key })
    }

    /// The cell with its verdict, which depends on the hull of the same scene, whose cell may be newer.
    fn judged(&self, mut cell: Cell, key: &RecordKey) -> Result<Cell> {
        if let (Some(figures), Some(case)) = (&cell.figures, self.axis.case(self.difficulty)) {
            let variant = Variant { name: "hull".into(), method: "hull".into(), settings: vec![] };
            let hull = Task { variant, ..*self };
            let hull = match kept::<Stored>(&hull.file("hull"), &hull.key(key.scene.clone())?)? {
                Kept::Row(stored) => stored.cell.figures,
                _ => None,
            };
            cell.verdict = judge(&case, figures, hull.as_ref().filter(|hull| hull.faces > 0));
        }
        Ok(cell)
    }

    fn run_folder(&self) -> RunFolder {
        RunFolder::new(self.out.join("runs").join(self.name()))
    }

    fn job<'a>(&'a self, scene: &'a Path, folder: &'a RunFolder, cancellation: &'a Cancellation) -> Job<'a> {
        let (variant, seed) = (&self.variant, self.seed);
        let (supervision, downscale) = ("rgb", None);
        Job { scene, folder, variant, supervision, seed, downscale, time: None, follow_shape: false, cancellation }
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

    fn reconstruct(&self, case: &Case, cancellation: &Cancellation) -> Result<Cell> {
        let (scene, folder) = (self.scene().folder(), self.run_folder());
        let cell = match self.job(&scene, &folder, cancellation).run()? {
            Ended::Measured { metrics, .. } => {
                let mesh = metrics.mesh.map(|_| read_mesh(folder.mesh_ply())).transpose()?;
                let figures = measure(case, self.seed, mesh.as_ref().map(|read| &read.mesh))?;
                let verdict = judge(case, &figures, None);
                let value = figures.seen_chamfer_l1.or(figures.chamfer_l1);
                Cell { value, figures: Some(figures), ..self.blank(verdict) }
            }
            Ended::Failed { said, code } => {
                // A loss that is not finite is the method's failure, and so is a crash.
                let is_explosion = code != Some(2) || said.contains("the loss became");
                let verdict = if is_explosion { Verdict::Exploded } else { Verdict::Refused };
                Cell { note: Some(said), ..self.blank(verdict) }
            }
        };
        // Meshes take megabytes and can be made again by one command; figures and scene stay.
        if folder.is_run() {
            folder.replace()?.remove()?;
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
            task.row(&Cancellation::default()).unwrap().cell.verdict
        };
        assert_eq!([1.0, 0.0001].map(|scale| verdict("scale-free", scale)), [Verdict::Solved; 2]);
        assert_eq!([1.0, 0.0001].map(|s| verdict("classic-clamp", s)), [Verdict::Solved, Verdict::Inaccurate]);
    }
}
