//! `dvr stress`: where methods fail.

mod charts;
mod plan;
mod results;
mod table;
mod task;

use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use anyhow::{Context, Result, bail};
use dvr_core::files::write_bytes_atomically;
use dvr_stress::{Axis, axes};
use dvr_train::Observer;

use super::bench::machine;
use super::train::{INTERRUPTED, interrupt_on_ctrl_c};
use crate::EXIT_INTERRUPTED;
use crate::args::StressArgs;
use crate::progress::Progress;
use plan::{Estimate, plan};
use results::Results;

/// Tries what is missing, then writes `results.json`, `results.csv`, `table.md`, `charts/` and `report.html`.
pub fn run(args: &StressArgs) -> Result<ExitCode> {
    let axes = chosen(args)?;
    if args.list {
        list(&axes);
        return Ok(ExitCode::SUCCESS);
    }
    let Some(out) = &args.out else { bail!("no output folder was given: add --out DIR") };
    std::fs::create_dir_all(out.join("cells")).with_context(|| out.display().to_string())?;
    let tasks = plan(args, &axes, out);
    let estimate = Estimate::of(&tasks)?;
    eprintln!("{estimate}");
    interrupt_on_ctrl_c()?;
    let mut progress = Progress::new();
    progress.phase("cells", tasks.len());
    let mut results = Results { machine: machine::describe(), cells: Vec::new() };
    for (i, task) in tasks.iter().enumerate() {
        match task.cell()? {
            Some(cell) => results.cells.push(cell),
            None => return Ok(interrupted(out)),
        }
        progress.progress(i + 1, &task.name());
        if INTERRUPTED.load(Ordering::Relaxed) && i + 1 < tasks.len() {
            return Ok(interrupted(out));
        }
    }
    write(&results, &axes, out)?;
    Ok(ExitCode::SUCCESS)
}

fn interrupted(out: &Path) -> ExitCode {
    eprintln!("stopped; what is done is kept in {}. The same command goes on", out.display());
    ExitCode::from(EXIT_INTERRUPTED)
}

/// The axes that the arguments name, by their own name or their group's.
fn chosen(args: &StressArgs) -> Result<Vec<Axis>> {
    let all = axes();
    let is_called = |axis: &Axis, name: &str| axis.name == name || results::group_name(axis.group) == name;
    if let Some(unknown) = args.axis.iter().find(|name| !all.iter().any(|axis| is_called(axis, name))) {
        bail!("there is no axis {unknown:?}; `dvr stress --list` shows all");
    }
    let is_wanted = |axis: &Axis| args.axis.is_empty() || args.axis.iter().any(|name| is_called(axis, name));
    Ok(all.into_iter().filter(is_wanted).collect())
}

fn list(axes: &[Axis]) {
    for axis in axes {
        let labels = |difficulties: &[f64]| difficulties.iter().map(|&d| Axis::label(d)).collect::<Vec<_>>().join(", ");
        println!("{} ({}): {}", axis.name, results::group_name(axis.group), axis.what);
        println!("    {} {}; quick: {}", labels(axis.difficulties), axis.unit, labels(axis.quick));
    }
}

fn write(results: &Results, axes: &[Axis], out: &Path) -> Result<()> {
    let table = table::markdown(results, axes);
    let files = [
        ("results.json", serde_json::to_string_pretty(results)?),
        ("results.csv", results::csv(&results.cells)?),
        ("table.md", table.clone()),
    ];
    println!("{table}");
    for (name, text) in files {
        let path = out.join(name);
        write_bytes_atomically(&path, text.as_bytes())?;
        eprintln!("wrote {}", path.display());
    }
    charts::write(results, axes, out)?;
    for name in ["charts", "report.html"] {
        eprintln!("wrote {}", out.join(name).display());
    }
    Ok(())
}
