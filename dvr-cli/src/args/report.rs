//! `dvr report`.

use std::path::PathBuf;

use clap::Args;

/// Arguments of `dvr report`.
#[derive(Args, Debug)]
pub struct ReportArgs {
    /// Folders of finished runs; several are compared side by side
    #[arg(required = true)]
    pub runs: Vec<PathBuf>,
    /// Output file [default: report.html in the run's folder, or in the current folder for several runs]
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Replace the file at --out
    #[arg(long)]
    pub overwrite: bool,
    /// The scene of the runs, if it was moved since training
    #[arg(long, value_name = "SCENE")]
    pub data: Option<PathBuf>,
}
