//! `dvr`: textured meshes from posed photographs.

mod args;
mod backend;
mod commands;
#[cfg(feature = "gpu")]
mod gpu;
mod interrupt;
mod memory;
mod progress;
mod remedy;

use std::process::ExitCode;

use clap::Parser;

use args::{Cli, Command};

/// Training allocates and frees large tensors in every step. The system's allocator returns them to the kernel, which
/// clears them again each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Exit code of every refusal of bad input, clap's included.
const EXIT_BAD_INPUT: u8 = 2;

/// Exit code after Ctrl-C, by convention 128 + SIGINT.
pub(crate) const EXIT_INTERRUPTED: u8 = 130;

fn main() -> ExitCode {
    let command = Cli::parse().command;
    #[cfg(feature = "gpu")]
    let result = gpu::guarded(|| run(command));
    #[cfg(not(feature = "gpu"))]
    let result = run(command);
    match result {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {}", message(&error));
            if let Some(remedy) = remedy::remedy(&error) {
                eprintln!("help: {remedy}");
            }
            ExitCode::from(EXIT_BAD_INPUT)
        }
    }
}

/// An error with its causes, on one line. Causes that a message already contains are not repeated.
fn message(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// Carries out a command.
fn run(command: Command) -> anyhow::Result<ExitCode> {
    match command {
        Command::Info(args) => commands::info::run(&args),
        Command::Train(args) => commands::train::run(&args),
        Command::Mesh(args) => commands::mesh::run(&args),
        Command::Render(args) => commands::render::run(&args),
        Command::Eval(args) => commands::eval::run(&args),
        Command::Report(args) => commands::report::run(&args),
        Command::Bench(args) => commands::bench::run(&args),
        Command::Stress(args) => commands::stress::run(&args),
        Command::Synth(args) => commands::synth::run(&args),
        Command::Export(args) => commands::export::run(&args),
        Command::Import(args) => commands::import::run(&args),
        Command::Predict(args) => commands::predict::run(&args),
        Command::Devices => commands::devices::run(),
    }
}
