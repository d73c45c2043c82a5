//! `dvr export`: the network of a run for other programs.

use std::process::ExitCode;

use anyhow::Result;
use dvr_model::save_safetensors;
use dvr_train::decoder_of;

use super::load_run;
use crate::args::ExportArgs;
use crate::backend::Backend;

/// Writes safetensors with PyTorch names and layout.
pub fn run(args: &ExportArgs) -> Result<ExitCode> {
    let checkpoint = load_run(&args.run)?;
    let decoder = decoder_of(&checkpoint, &Backend::Cpu.device())?;
    save_safetensors(&args.out, &decoder, &checkpoint.header.config.model)?;
    println!("wrote {}", args.out.display());
    Ok(ExitCode::SUCCESS)
}
