//! The table of single pictures: every system trained, measured and shown on the same dataset.

use std::process::ExitCode;

use anyhow::{Result, bail};
use dvr_core::Cancellation;
use dvr_core::dataset::is_object_dataset;
use dvr_core::files::{Claim, FolderKind, OutputFolder, check_beside_data, write_bytes_atomically, write_rgb_png};
use dvr_core::record::Digest;
use dvr_train::Observer;

use super::row::{Place, Row};
use super::systems::{SYSTEMS, System};
use super::table::{Line, Table};
use super::{by_heart, pictures};
use crate::args::PaperArgs;
use crate::commands::kept_row::Standing;
use crate::progress::Progress;

/// What is written beside the runs.
const FILES: [&str; 4] = ["table.md", "table.csv", "pictures.png", "report.html"];

/// Trains, measures and writes what is missing, or says what it would be.
pub fn run(args: &PaperArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let [data] = &args.data[..] else {
        bail!("--table shapenet is made on one dataset; {} paths were given", args.data.len())
    };
    if !is_object_dataset(data)? {
        bail!(
            "{} is not a dataset of objects; `dvr synth MESHES --out DIR` makes one, in the layout of ShapeNet's renders",
            data.display()
        );
    }
    let systems = systems(args)?;
    let by_heart = args.by_heart.map(|count| by_heart::chosen(data, count)).transpose()?;
    check_beside_data(&args.out, data)?;
    if args.plan {
        // Nothing is written, and nothing of the data but its lists is read.
        let digest = Digest::of_bytes(&[]);
        let place = Place::new(args, data, &digest, cancellation);
        return print_plan(&rows(&systems, args.seeds, &place)).map(|()| ExitCode::SUCCESS);
    }
    let _writing = OutputFolder::claim(&args.out, FolderKind::PaperTable, Claim::NewOrContinue, &FILES)?;
    let mut progress = Progress::new();
    let own;
    let data = match &by_heart {
        Some(chosen) => {
            own = args.out.join("objects");
            by_heart::write(chosen, &own, cancellation)?;
            &own
        }
        None => data,
    };
    progress.phase("reading the dataset", 1);
    let digest = Digest::of_files(data, None)?;
    let place = Place::new(args, data, &digest, cancellation);
    let rows = rows(&systems, args.seeds, &place);
    let mut standing = Standing::default();
    for row in &rows {
        standing.count(&row.name(), &row.kept()?);
    }
    eprintln!("trainings: {standing}; about {:.0} CPU minutes for all", total_minutes(&rows)?);
    let lines = make(&rows, args, &mut progress, cancellation)?;
    let pictures = pictures::of_rows(&rows, &lines, &place, &mut progress)?;
    let table = Table { lines, by_heart: args.by_heart };
    write_bytes_atomically(&args.out.join("table.md"), table.markdown().as_bytes())?;
    write_bytes_atomically(&args.out.join("table.csv"), table.csv()?.as_bytes())?;
    if let Some(pictures) = &pictures {
        write_rgb_png(&args.out.join("pictures.png"), pictures)?;
    }
    write_bytes_atomically(&args.out.join("report.html"), table.page(pictures.as_ref())?.as_bytes())?;
    println!("{}", table.markdown());
    for name in FILES.into_iter().filter(|name| pictures.is_some() || *name != "pictures.png") {
        eprintln!("wrote {}", args.out.join(name).display());
    }
    Ok(if table.lines.iter().all(|line| line.failures.is_empty()) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// What will be made, and how long it takes.
fn print_plan(rows: &[Row<'_>]) -> Result<()> {
    println!("{:<18}{:>8}{:>10}", "row", "steps", "CPU min");
    for row in rows {
        println!("{:<18}{:>8}{:>10.0}  {}", row.name(), row.steps()?, minutes(row)?, row.system.title);
    }
    println!("about {:.0} CPU minutes; on two cores, somewhat more than half of that", total_minutes(rows)?);
    Ok(())
}

/// The systems that were asked for. Lookups know all objects by heart already.
fn systems(args: &PaperArgs) -> Result<Vec<&'static System>> {
    if let Some(unknown) = args.rows.iter().find(|name| !SYSTEMS.iter().any(|system| system.row == *name)) {
        let known: Vec<&str> = SYSTEMS.iter().map(|system| system.row).collect();
        bail!("--rows {unknown}: there is no such row; the rows are {}", known.join(", "));
    }
    let asked = |system: &&System| match &args.rows[..] {
        [] => args.by_heart.is_none() || system.maker.training().is_some(),
        rows => rows.iter().any(|name| name == system.row),
    };
    Ok(SYSTEMS.iter().filter(asked).collect())
}

/// All rows, seeds innermost. Lookups have none.
fn rows<'a>(systems: &[&'static System], seeds: u64, place: &'a Place<'a>) -> Vec<Row<'a>> {
    let of = |&system: &&'static System| {
        let seeds = if system.maker.training().is_some() { seeds } else { 1 };
        (0..seeds).map(move |seed| Row { system, seed, place })
    };
    systems.iter().flat_map(of).collect()
}

/// CPU minutes of a row, before it is made.
fn minutes(row: &Row<'_>) -> Result<f64> {
    Ok(row.system.seconds * row.steps()?.max(1) as f64 / 60.0)
}

fn total_minutes(rows: &[Row<'_>]) -> Result<f64> {
    rows.iter().map(minutes).sum()
}

/// Carries out all rows. One that fails does not end the others.
fn make(rows: &[Row<'_>], args: &PaperArgs, progress: &mut Progress, cancellation: &Cancellation) -> Result<Vec<Line>> {
    progress.phase("rows", rows.len());
    let mut lines: Vec<Line> = Vec::new();
    for (i, row) in rows.iter().enumerate() {
        let made = row.make(&mut |said| progress.progress(i, said));
        if cancellation.is_cancelled() {
            eprintln!("finished rows are kept in {}; the same command continues", args.out.display());
            cancellation.check()?;
        }
        if lines.last().is_none_or(|line| line.system.row != row.system.row) {
            lines.push(Line { system: row.system, made: Vec::new(), failures: Vec::new() });
        }
        if let Some(line) = lines.last_mut() {
            match made {
                Ok(made) => line.made.push(made),
                Err(error) => {
                    progress.note(&format!("failed: {error:#}"));
                    line.failures.push(format!("{error:#}"));
                }
            }
        }
        progress.progress(i + 1, &row.name());
    }
    Ok(lines)
}
