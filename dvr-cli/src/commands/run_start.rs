//! What every training run needs, of a scene or of a dataset: its folder, its options, and what to say after Ctrl-C.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Result, bail};
use burn::tensor::Device;
use dvr_core::Cancellation;
use dvr_core::files::{OutputFolder, check_beside_data};
use dvr_sfm::Source;
use dvr_train::{Checkpoint, Method, RunFolder, RunOptions, RunOutcome};

use super::stored_run::find_masks_again;
use crate::EXIT_INTERRUPTED;
use crate::args::TrainArgs;

/// Where a run is stored, and what it goes on from.
pub struct RunStart {
    /// Its folder.
    pub folder: RunFolder,
    /// The checkpoint that is resumed.
    pub resumed: Option<Checkpoint>,
    /// The folder of a run that is resumed is ours from the start; others are taken when everything else is in order.
    taken: Option<OutputFolder>,
    may_replace: bool,
}

impl RunStart {
    /// As the arguments have it; of folders that are not ours, nothing is touched.
    pub fn new(args: &TrainArgs, out: &Path) -> Result<Self> {
        // A clip is a file among others; what is made of it lies beside it.
        let scene = args.scene.iter().chain(&args.more).filter(|scene| !Source::is_clip(scene));
        for data in scene.chain(&args.objects.inputs) {
            check_beside_data(out, data)?;
        }
        let folder = RunFolder::new(out);
        if !args.resume {
            folder.check(args.overwrite)?;
            return Ok(Self { folder, resumed: None, taken: None, may_replace: args.overwrite });
        }
        let taken = Some(folder.resume()?);
        let resumed = match (folder.last().exists(), &args.scene) {
            (true, _) => {
                let mut checkpoint = Checkpoint::load(&folder.last())?;
                find_masks_again(&mut checkpoint, Some(out));
                Some(checkpoint)
            }
            (false, Some(_)) => {
                eprintln!("note: the run was stopped before its first checkpoint; it starts from its beginning");
                None
            }
            (false, None) => bail!(
                "{}: the run was stopped before its first checkpoint. Give its scene and options again",
                out.display()
            ),
        };
        Ok(Self { folder, resumed, taken, may_replace: false })
    }

    /// Takes the run's folder, where that is yet to be done, and writes the configuration into it. The folder is ours as
    /// long as the value that is returned lives.
    pub fn prepare(&mut self, method: &dyn Method) -> Result<OutputFolder> {
        let taken = match self.taken.take() {
            Some(taken) => taken,
            None if self.may_replace => self.folder.replace()?,
            None => self.folder.create()?,
        };
        let json = method.record()?.pretty();
        dvr_core::files::write_bytes_atomically(&self.folder.config(), json.as_bytes())?;
        Ok(taken)
    }
}

/// How a run is carried out.
pub fn run_options(
    args: &TrainArgs,
    folder: &RunFolder,
    reading: serde_json::Value,
    device: Device,
    cancellation: &Cancellation,
) -> Result<RunOptions> {
    Ok(RunOptions {
        data_parallel: args.more_devices().iter().map(|backend| backend.device()).collect::<Result<_>>()?,
        reading,
        time_limit: args.time,
        cancellation: cancellation.clone(),
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
