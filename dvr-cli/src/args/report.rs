//! `dvr report`.

use std::path::PathBuf;

use clap::Args;

/// Arguments of `dvr report`.
#[derive(Args, Debug)]
pub struct ReportArgs {
    /// Folders of finished runs; several are told side by side
    #[arg(required = true)]
    pub runs: Vec<PathBuf>,
    /// File to write [default: report.html in the run's folder, or here for several runs]
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Where the scene of the runs lies now, if it was moved since training
    #[arg(long, value_name = "SCENE")]
    pub data: Option<PathBuf>,
}
