//! Commands that a row is made by: this program again, as a user would call it.

use std::ffi::OsString;
use std::process::Command;

use anyhow::{Context, Result, bail};
use dvr_core::Cancellation;

use crate::commands::child::{EndedChild, run_child_heard};

/// Calls on behalf of a row.
pub struct Caller<'a> {
    /// The row.
    pub name: &'a str,
    pub cancellation: &'a Cancellation,
}

impl Caller<'_> {
    /// Runs this program with other arguments; what it says is passed on.
    ///
    /// # Errors
    /// What the command said at last, where it failed.
    pub fn call(&self, arguments: Vec<OsString>, hear: &mut dyn FnMut(&str)) -> Result<()> {
        let Self { name, cancellation } = self;
        let mut command = Command::new(std::env::current_exe().context("this program cannot be started again")?);
        command.args(&arguments);
        let EndedChild { status, said } =
            run_child_heard(&mut command, cancellation, &mut |line| hear(&format!("{name}: {line}")))?;
        cancellation.check()?;
        if !status.success() {
            let error = said.lines().rfind(|line| line.starts_with("error: ")).or(said.lines().last());
            let error = error.map_or_else(|| status.to_string(), |line| line.trim_start_matches("error: ").to_owned());
            bail!("dvr {} of {name}: {error}", arguments[0].to_string_lossy());
        }
        Ok(())
    }
}
