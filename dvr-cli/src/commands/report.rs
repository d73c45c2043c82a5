//! `dvr report`: runs as an HTML page.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use dvr_core::Scene;
use dvr_core::files::write_bytes_atomically;
use dvr_report::{ReportWords, SourceRun, run_report};
use dvr_train::{Checkpoint, CheckpointHeader, METHODS, Observer, RunFolder};

use super::scene_of_run;
use crate::args::ReportArgs;
use crate::progress::Progress;
use crate::remedy::remedy_of_diagnostic;

/// Reads the runs and their scenes, and writes the page.
pub fn run(args: &ReportArgs) -> Result<ExitCode> {
    let mut progress = Progress::new();
    progress.phase("report", args.runs.len() + 1);
    let mut sources: Vec<(RunFolder, CheckpointHeader, Option<Scene>)> = Vec::new();
    for (i, path) in args.runs.iter().enumerate() {
        let folder = RunFolder::new(path);
        let checkpoint = folder.load()?;
        let scene = scene_if_found(&checkpoint, args.data.as_ref(), &mut progress)?;
        sources.push((folder, checkpoint.header, scene));
        progress.progress(i + 1, &path.display().to_string());
    }
    let runs: Vec<SourceRun> = sources
        .iter()
        .map(|(folder, header, scene)| SourceRun {
            folder: folder.clone(),
            header: header.clone(),
            scene: scene.as_ref(),
        })
        .collect();
    let out = match (&args.out, args.runs.as_slice()) {
        (Some(path), _) => path.clone(),
        (None, [run]) => RunFolder::new(run).report(),
        (None, _) => PathBuf::from("report.html"),
    };
    write_report(&runs, &out)?;
    progress.progress(args.runs.len() + 1, "");
    println!("wrote {}", out.display());
    Ok(ExitCode::SUCCESS)
}

/// Writes the page of some runs.
pub fn write_report(runs: &[SourceRun], out: &Path) -> Result<()> {
    let words = ReportWords { program: &program(), remedy: &remedy_of_diagnostic };
    Ok(write_bytes_atomically(out, run_report(runs, &words)?.as_bytes())?)
}

/// Name, version and commit of this program.
fn program() -> String {
    format!("dvr {} ({})", env!("CARGO_PKG_VERSION"), env!("DVR_COMMIT"))
}

/// The scene of a run. Without --data, a scene that cannot be read is left out of the report.
fn scene_if_found(checkpoint: &Checkpoint, moved: Option<&PathBuf>, progress: &mut Progress) -> Result<Option<Scene>> {
    if METHODS.iter().any(|entry| entry.name == checkpoint.header.method.method && entry.learns_objects) {
        return Ok(None);
    }
    match scene_of_run(checkpoint, moved, None) {
        Ok(scene) => Ok(Some(scene)),
        Err(error) if moved.is_some() => Err(error),
        Err(error) => {
            progress.note(&format!("no views in the report: {error:#}"));
            Ok(None)
        }
    }
}
