//! `dvr paper`: the publication's tables, on the data that there is.

mod by_heart;
mod call;
mod many_views;
mod pictures;
mod row;
mod scans;
mod single_pictures;
mod systems;
mod table;

use std::process::ExitCode;

use anyhow::{Result, bail};
use dvr_core::Cancellation;

use crate::args::{PaperArgs, PaperTable};
use many_views::Comparison;

/// Makes a table, or says what that takes.
pub fn run(args: &PaperArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let has_scans = !args.clouds.is_empty() || args.reference.is_some() || args.points.is_some();
    if args.table != PaperTable::Dtu && has_scans {
        bail!("--cloud, --points and --reference are for --table dtu");
    }
    match args.table {
        PaperTable::Shapenet => single_pictures::run(args, cancellation),
        PaperTable::Dtu => scans::run(args, cancellation),
        PaperTable::Samples => many_views::run(args, Comparison::Samples, cancellation),
        PaperTable::Smoothness => many_views::run(args, Comparison::Smoothness, cancellation),
        PaperTable::Depth => many_views::run(args, Comparison::Supervision, cancellation),
    }
}
