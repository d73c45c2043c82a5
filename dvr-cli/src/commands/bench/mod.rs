//! `dvr bench`: methods side by side on the same scenes and the same machine, with their range over seeds.

mod charts;
mod plan;
mod results;
mod table;

use std::process::ExitCode;

use anyhow::{Context, Result};
use dvr_core::files::write_bytes_atomically;
use dvr_train::Observer;

use super::machine::Machine;
use crate::args::BenchArgs;
use crate::progress::Progress;
use plan::{named, plan};
use results::Results;

/// Carries out missing runs, then writes `results.json`, `results.csv`, `table.md`, `charts/` and `report.html`.
pub fn run(args: &BenchArgs) -> Result<ExitCode> {
    let scenes = named(&args.scenes)?;
    std::fs::create_dir_all(&args.out).with_context(|| args.out.display().to_string())?;
    let plan = plan(args, &scenes);
    let mut results = Results::new(Machine::this());
    let mut progress = Progress::new();
    progress.phase("runs", plan.len());
    for (i, run) in plan.iter().enumerate() {
        results.outcomes.push(run.outcome(args)?);
        progress.progress(i + 1, &run.folder);
    }
    for path in &args.overlay {
        results.outcomes.extend(results::read(path)?);
    }
    results.write(&args.out.join("results.json"))?;
    write_bytes_atomically(&args.out.join("results.csv"), table::csv(&results.outcomes)?.as_bytes())?;
    let table = table::markdown(&results);
    write_bytes_atomically(&args.out.join("table.md"), table.as_bytes())?;
    charts::write(&results, &args.out)?;
    println!("{table}");
    for name in ["results.json", "results.csv", "table.md", "charts", "report.html"] {
        eprintln!("wrote {}", args.out.join(name).display());
    }
    Ok(ExitCode::SUCCESS)
}
