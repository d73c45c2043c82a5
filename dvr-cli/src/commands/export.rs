//! `dvr export`: the network of a run for other programs.

use std::process::ExitCode;

use anyhow::{Result, bail};
use dvr_model::save_safetensors;
use dvr_train::{Method, Model};

use super::load_run;
use crate::args::ExportArgs;
use crate::backend::Backend;

/// Writes safetensors with PyTorch names and layout.
pub fn run(args: &ExportArgs) -> Result<ExitCode> {
    let checkpoint = load_run(&args.run)?;
    let model = Model::load(&checkpoint, &Backend::Cpu.device())?;
    let (Model::Network { surface, .. }, Method::Network(config)) = (&model, &checkpoint.header.method) else {
        bail!("{} holds a lattice field, not a network: `dvr train --method network` makes one", args.run.display());
    };
    save_safetensors(&args.out, surface.field(), &config.model)?;
    println!("wrote {}", args.out.display());
    Ok(ExitCode::SUCCESS)
}
