//! What every training run needs, of a scene or of a dataset: its folder, its options, and what to say after Ctrl-C.

use std::process::ExitCode;

use anyhow::Result;
use burn::tensor::Device;
use dvr_train::{Method, RunFolder, RunOptions, RunOutcome};

use crate::EXIT_INTERRUPTED;
use crate::args::TrainArgs;
use crate::interrupt::{self, INTERRUPTED};

/// How a run is carried out; from here on, Ctrl-C saves.
pub fn run_options(
    args: &TrainArgs,
    folder: &RunFolder,
    reading: serde_json::Value,
    device: Device,
) -> Result<RunOptions<'static>> {
    interrupt::catch()?;
    Ok(RunOptions {
        data_parallel: args.more_devices().iter().map(|backend| backend.device()).collect::<Result<_>>()?,
        reading,
        time_limit: args.time,
        interrupted: &INTERRUPTED,
        ..RunOptions::new(folder.clone(), device)
    })
}

/// What to say, and to exit with, after Ctrl-C.
pub fn interrupted(outcome: &RunOutcome, folder: &RunFolder) -> ExitCode {
    eprintln!(
        "stopped after step {}; everything is saved. Continue with: dvr train --resume --out {}",
        outcome.steps,
        folder.root().display()
    );
    ExitCode::from(EXIT_INTERRUPTED)
}

/// Makes the run's folder and writes the configuration into it.
pub fn prepare(folder: &RunFolder, args: &TrainArgs, method: &dyn Method) -> Result<()> {
    if args.resume {
        return Ok(());
    }
    if args.overwrite {
        folder.clear()?;
    }
    folder.create()?;
    let json = method.record()?.pretty();
    Ok(dvr_core::files::write_bytes_atomically(&folder.config(), json.as_bytes())?)
}
