//! `dvr report`: runs as an HTML page.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use dvr_core::files::write_bytes_atomically;
use dvr_core::{Cancellation, Scene};
use dvr_report::{ReportWords, SourceRun, run_report};
use dvr_train::{Checkpoint, CheckpointHeader, METHODS, Observer, RunFolder};

use super::{place_for, scene_of_run};
use crate::args::ReportArgs;
use crate::progress::Progress;
use crate::remedy::remedy_of_diagnostic;

/// Reads the runs and their scenes, and writes the page.
pub fn run(args: &ReportArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let own = match args.runs.as_slice() {
        [run] => RunFolder::new(run),
        _ => RunFolder::new("."),
    };
    let place = if args.runs.len() == 1 { None } else { Some(PathBuf::from("report.html")) };
    let (files, _writing) = place_for(&own, args.out.as_ref().or(place.as_ref()), vec![own.report()], args.overwrite)?;
    let mut progress = Progress::new();
    progress.phase("report", args.runs.len() + 1);
    let mut sources: Vec<(RunFolder, CheckpointHeader, Option<Scene>)> = Vec::new();
    for (i, path) in args.runs.iter().enumerate() {
        let folder = RunFolder::new(path);
        let checkpoint = folder.load()?;
        let scene = scene_if_found(&checkpoint, args.data.as_ref(), cancellation, &mut progress)?;
        cancellation.check()?;
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
    for out in &files {
        write_report(&runs, out)?;
        println!("wrote {}", out.display());
    }
    progress.progress(args.runs.len() + 1, "");
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
fn scene_if_found(
    checkpoint: &Checkpoint,
    moved: Option<&PathBuf>,
    cancellation: &Cancellation,
    progress: &mut Progress,
) -> Result<Option<Scene>> {
    if METHODS.iter().any(|entry| entry.name == checkpoint.header.method.method && entry.learns_objects) {
        return Ok(None);
    }
    match scene_of_run(checkpoint, moved, None, cancellation) {
        Ok(scene) => {
            scene.warnings.iter().for_each(|warning| progress.note(warning));
            Ok(Some(scene))
        }
        Err(error) if moved.is_some() => Err(error),
        Err(error) => {
            progress.note(&format!("no views in the report: {error:#}"));
            Ok(None)
        }
    }
}
