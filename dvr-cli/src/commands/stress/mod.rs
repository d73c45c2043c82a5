//! `dvr stress`: tests where methods fail.

mod charts;
mod plan;
mod results;
mod scene;
mod table;
mod task;

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use dvr_core::Cancellation;
use dvr_core::files::{Claim, FolderKind, OutputFolder, write_bytes_atomically};
use dvr_stress::{Axis, Cell, axes, break_point};
use dvr_train::Observer;

use crate::args::StressArgs;
use crate::progress::Progress;
use plan::{Estimate, plan};
use results::Results;
use task::Task;

/// What is written beside the cells, the scenes and the charts.
const FILES: [&str; 4] = ["results.json", "results.csv", "table.md", "report.html"];

/// Computes missing cells, then writes `results.json`, `results.csv`, `table.md`, `charts/` and `report.html`.
pub fn run(args: &StressArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let axes = chosen(args)?;
    if args.list {
        list(&axes);
        return Ok(ExitCode::SUCCESS);
    }
    let Some(out) = &args.out else { bail!("no output folder was given: add --out DIR") };
    if let Some(name) = &args.against
        && !args.variants().iter().any(|variant| variant.name == *name)
    {
        bail!("--against {name}: there is no method or variant of this name; add it with --methods or --variant");
    }
    let _writing = OutputFolder::claim(out, FolderKind::StressTest, Claim::NewOrContinue, &FILES)?;
    std::fs::create_dir_all(out.join("cells")).with_context(|| out.display().to_string())?;
    let mut results = Results::default();
    let (first, rivals): (Vec<Task>, Vec<Task>) = plan(args, &axes, out)
        .into_iter()
        .partition(|task| !args.against.as_ref().is_some_and(|name| task.is_rival_of(name)));
    compute(&first, &mut results, out, cancellation)?;
    if let Some(name) = &args.against {
        let is_where_it_fails = |task: &Task| {
            let cells: Vec<&Cell> = table::cells(&results, task.axis, name).collect();
            break_point(task.axis.difficulties, cells).breaks == Some(task.difficulty)
        };
        let rivals: Vec<Task> = rivals.into_iter().filter(is_where_it_fails).collect();
        compute(&rivals, &mut results, out, cancellation)?;
    }
    write(&results, &axes, out)?;
    Ok(ExitCode::SUCCESS)
}

/// Computes cells that are not stored.
fn compute(tasks: &[Task], results: &mut Results, out: &Path, cancellation: &Cancellation) -> Result<()> {
    eprintln!("{}", Estimate::of(tasks)?);
    let mut progress = Progress::new();
    progress.phase("cells", tasks.len());
    for (i, task) in tasks.iter().enumerate() {
        let row = cancellation.check().map_err(Into::into).and_then(|()| task.row(cancellation));
        results.cells.push(row.inspect_err(|_| {
            if cancellation.is_cancelled() {
                eprintln!("finished cells are kept in {}; the same command continues", out.display());
            }
        })?);
        progress.progress(i + 1, &task.name());
    }
    Ok(())
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
    for (name, text) in files {
        let path = out.join(name);
        write_bytes_atomically(&path, text.as_bytes())?;
        eprintln!("wrote {}", path.display());
    }
    charts::write(results, axes, out)?;
    println!("{table}");
    for name in ["charts", "report.html"] {
        eprintln!("wrote {}", out.join(name).display());
    }
    Ok(())
}
