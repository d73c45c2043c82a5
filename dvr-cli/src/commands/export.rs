//! `dvr export`: the network of a run for other programs.

use std::process::ExitCode;

use anyhow::{Result, bail};
use dvr_model::save_safetensors;
use dvr_train::{Method, Model, ObjectModel};

use super::load_run;
use crate::args::ExportArgs;
use crate::backend::Backend;

/// Writes safetensors with PyTorch names and layout.
pub fn run(args: &ExportArgs) -> Result<ExitCode> {
    let checkpoint = load_run(&args.run)?;
    let device = Backend::Cpu.device()?;
    match &checkpoint.header.method {
        Method::Objects(config) => {
            let model = ObjectModel::load(&checkpoint, &device)?;
            save_safetensors(&args.out, model.model(), &config.image_model())?;
        }
        Method::Network(config) => {
            let Model::Network { surface, .. } = Model::load(&checkpoint, &device)? else { bail!("not a network") };
            save_safetensors(&args.out, surface.field().decoder(), &config.model)?;
        }
        Method::Grid(_) => {
            bail!("{} holds a grid field, not a network: `dvr train --method network` makes one", args.run.display());
        }
    }
    println!("wrote {}", args.out.display());
    Ok(ExitCode::SUCCESS)
}
