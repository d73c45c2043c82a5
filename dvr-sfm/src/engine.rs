//! The installed COLMAP: where it is, and what it calls its options.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use dvr_core::Cancellation;

use crate::child::{Heard, Log, Task, run};
use crate::error::{Result, SfmError};

/// COLMAP's command that places all pictures at once.
const GLOBAL_MAPPER: &str = "global_mapper";

/// A program in one of the folders of `PATH`.
pub(crate) fn program(name: &str) -> Option<PathBuf> {
    let paths = std::env::var_os("PATH")?;
    let endings: &[&str] = if cfg!(windows) { &[".exe", ".bat"] } else { &[""] };
    let candidates = std::env::split_paths(&paths)
        .flat_map(|folder| endings.iter().map(move |ending| folder.join(format!("{name}{ending}"))));
    candidates.into_iter().find(|path| path.is_file())
}

/// The installed COLMAP.
pub(crate) struct Engine {
    program: PathBuf,
    /// Its commands.
    commands: BTreeSet<String>,
    /// As its help has it, e.g. `COLMAP 3.8`.
    pub version: String,
    cancellation: Cancellation,
}

impl Engine {
    /// That of `given`, else that in `PATH`; what it is asked about itself ends where `cancellation` says so. `purpose` is
    /// what it does here, in the present tense.
    ///
    /// # Errors
    /// [`SfmError::NotInstalled`].
    pub fn find(given: Option<&Path>, purpose: &'static str, cancellation: &Cancellation) -> Result<Self> {
        let found = given.map_or_else(|| program("colmap"), |given| given.is_file().then(|| given.to_owned()));
        let missing = SfmError::NotInstalled { program: "colmap", purpose };
        let program = found.ok_or(missing)?;
        let cancellation = cancellation.clone();
        let mut engine = Self { program, commands: BTreeSet::new(), version: String::new(), cancellation };
        let help = engine.help("help");
        engine.version = help.split_whitespace().take(2).collect::<Vec<_>>().join(" ");
        engine.commands = help.split_whitespace().map(str::to_owned).collect();
        Ok(engine)
    }

    /// What places all pictures at once: a command of COLMAP's from 4.0 on, before that a program of its own.
    ///
    /// # Errors
    /// [`SfmError::NotInstalled`].
    pub fn global_mapper(&self) -> Result<(Command, &'static str)> {
        if self.commands.contains(GLOBAL_MAPPER) {
            return Ok((self.command(GLOBAL_MAPPER), "colmap"));
        }
        let purpose = "places all pictures at once, as COLMAP from 4.0 on does itself";
        let program = program("glomap").ok_or(SfmError::NotInstalled { program: "glomap", purpose })?;
        let mut command = Command::new(program);
        command.arg("mapper");
        Ok((command, "glomap"))
    }

    /// A command of COLMAP, without a display.
    pub fn command(&self, name: &str) -> Command {
        let mut command = Command::new(&self.program);
        command.arg(name).env("QT_QPA_PLATFORM", "offscreen");
        command
    }

    /// What a command says of itself; nothing where it cannot be run, which is told when it is.
    fn help(&self, name: &str) -> String {
        let mut command = self.command(name);
        if name != "help" {
            command.arg("-h");
        }
        let mut said = String::new();
        let mut heard = |heard: Heard<'_>| {
            if let Heard::Line(line) = heard {
                said += line;
                said.push('\n');
            }
        };
        let task = Task { program: "colmap", step: "help", takes_bytes: false };
        // Where it fails, or is not wanted any more, the step that asks says so.
        let _ = run(&mut command, task, &mut Log::none(), &self.cancellation, &mut heard);
        said
    }

    /// The options of a command.
    pub fn options(&self, name: &str) -> Options {
        Options::of_help(&self.help(name))
    }
}

/// The options of one command.
pub(crate) struct Options(BTreeSet<String>);

impl Options {
    fn of_help(help: &str) -> Self {
        let words = help.split_whitespace().filter_map(|word| word.strip_prefix("--"));
        Self(words.map(|word| word.trim_end_matches([',', ']']).to_owned()).collect())
    }

    /// Appends the first of several names of an option that this version has, with its value. An option that it has not
    /// stays at its default.
    pub fn set(&self, command: &mut Command, names: &[&str], value: impl ToString) {
        if let Some(name) = names.iter().find(|name| self.0.contains(**name)) {
            command.arg(format!("--{name}")).arg(value.to_string());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Excerpts of the help of COLMAP 3.8 and 3.13.
    const HELP: [&str; 2] = [
        "  -h [ --help ] \n  --image_path arg\n  --SiftExtraction.num_threads arg (=-1)\n  --SiftExtraction.use_gpu arg (=1)\n",
        "  -h [ --help ] \n  --image_path arg\n  --FeatureExtraction.num_threads arg (=-1)\n  --FeatureExtraction.use_gpu arg (=1)\n",
    ];

    #[test]
    fn an_option_goes_by_the_name_that_the_version_has() {
        for (help, expected) in HELP.iter().zip(["--SiftExtraction.use_gpu", "--FeatureExtraction.use_gpu"]) {
            let options = Options::of_help(help);
            let mut command = Command::new("colmap");
            options.set(&mut command, &["FeatureExtraction.use_gpu", "SiftExtraction.use_gpu"], 0);
            options.set(&mut command, &["Mapper.unknown"], 1);
            let args: Vec<_> = command.get_args().map(|arg| arg.to_string_lossy().into_owned()).collect();
            assert_eq!(args, [expected, "0"]);
        }
    }
}
