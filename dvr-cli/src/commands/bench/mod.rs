//! `dvr bench`: methods side by side on the same scenes and the same machine, with their range over seeds.

mod charts;
mod plan;
mod results;
mod table;

use std::process::ExitCode;

use anyhow::Result;
use dvr_core::Cancellation;
use dvr_core::files::{Claim, FolderKind, OutputFolder, write_bytes_atomically};
use dvr_train::Observer;

use super::kept_row::Standing;
use crate::args::BenchArgs;
use crate::progress::Progress;
use plan::{Run, plan, scenes};
use results::{Outcome, Results};

/// What is written beside the runs and the charts.
const FILES: [&str; 4] = ["results.json", "results.csv", "table.md", "report.html"];

/// Carries out missing runs, then writes `results.json`, `results.csv`, `table.md`, `charts/` and `report.html`.
pub fn run(args: &BenchArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let scenes = scenes(args)?;
    let plan = plan(args, &scenes)?;
    let mut overlays = Vec::new();
    for path in &args.overlay {
        overlays.extend(results::read(path)?);
    }
    let _writing = OutputFolder::claim(&args.out, FolderKind::Benchmark, Claim::NewOrContinue, &FILES)?;
    let outcomes = carry_out(args, &plan, cancellation).inspect_err(|_| {
        if cancellation.is_cancelled() {
            eprintln!("finished runs are kept in {}; the same command continues", args.out.display());
        }
    });
    let mut outcomes = outcomes?;
    outcomes.extend(overlays);
    let results = Results { outcomes };
    write(&results, args)?;
    let failures = plan.iter().zip(&results.outcomes).filter_map(failure);
    let failed = failures.inspect(|(run, said)| eprintln!("failed: {run}: {said}")).count();
    Ok(if failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The outcomes of all runs.
fn carry_out(args: &BenchArgs, plan: &[Run], cancellation: &Cancellation) -> Result<Vec<Outcome>> {
    let mut standing = Standing::default();
    for run in plan {
        standing.count(&run.folder, &run.kept(args)?);
    }
    eprintln!("runs: {standing}");
    let mut progress = Progress::new();
    progress.phase("runs", plan.len());
    let mut outcomes = Vec::new();
    for (i, run) in plan.iter().enumerate() {
        cancellation.check()?;
        outcomes.push(run.outcome(args, cancellation)?);
        progress.progress(i + 1, &run.folder);
    }
    Ok(outcomes)
}

/// The name of a run that failed, and what it said.
fn failure<'a>((run, outcome): (&'a Run, &'a Outcome)) -> Option<(&'a str, &'a str)> {
    Some((&*run.folder, outcome.failure.as_deref()?))
}

/// Writes the results in all forms and prints the table.
fn write(results: &Results, args: &BenchArgs) -> Result<()> {
    results.write(&args.out.join("results.json"))?;
    write_bytes_atomically(&args.out.join("results.csv"), table::csv(&results.outcomes)?.as_bytes())?;
    let table = table::markdown(results);
    write_bytes_atomically(&args.out.join("table.md"), table.as_bytes())?;
    charts::write(results, &args.out)?;
    println!("{table}");
    for name in ["results.json", "results.csv", "table.md", "charts", "report.html"] {
        eprintln!("wrote {}", args.out.join(name).display());
    }
    Ok(())
}
