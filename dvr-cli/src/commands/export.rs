//! `dvr export`: the network of a run as safetensors.

use std::process::ExitCode;

use anyhow::{Context, Result};
use dvr_core::files::check_file;
use dvr_train::{ObjectModel, method_of};

use super::{load_model, load_run};
use crate::args::ExportArgs;
use crate::backend::Backend;

/// Writes safetensors with PyTorch names and layout.
pub fn run(args: &ExportArgs) -> Result<ExitCode> {
    let checkpoint = load_run(&args.run)?;
    check_file(&args.out, args.overwrite)?;
    let device = Backend::Cpu.device()?;
    if method_of(&checkpoint.header.method)?.objects().is_some() {
        ObjectModel::load(&checkpoint, &device)?.save_network(&args.out)?;
    } else {
        let about = || format!("{}, made by method {}", args.run.display(), checkpoint.header.method.method);
        load_model(&checkpoint, None, &device)?.save_network(&args.out).with_context(about)?;
    }
    println!("wrote {}", args.out.display());
    Ok(ExitCode::SUCCESS)
}
