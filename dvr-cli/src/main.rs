//! `dvr`: textured meshes from posed photographs.

#[macro_use]
mod output;

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
use dvr_core::{Cancellation, Cancelled};

use args::{Cli, Command};

/// Training allocates and frees large tensors in every step. The system's allocator returns them to the kernel, which
/// clears them again each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Exit code of every refusal of bad input, clap's included.
const EXIT_BAD_INPUT: u8 = 2;

/// Exit code after Ctrl-C, by convention 128 + SIGINT, and after SIGTERM.
pub(crate) const EXIT_INTERRUPTED: u8 = 130;

fn main() -> ExitCode {
    let command = Cli::parse().command;
    match interrupt::listen().and_then(|cancellation| guarded(command, &cancellation)) {
        Ok(code) => code,
        Err(error) if error.chain().any(|cause| cause.is::<Cancelled>()) => {
            eprintln!("stopped");
            ExitCode::from(EXIT_INTERRUPTED)
        }
        Err(error) => {
            eprintln!("error: {}", message(&error));
            if let Some(remedy) = remedy::remedy(&error) {
                eprintln!("help: {remedy}");
            }
            ExitCode::from(EXIT_BAD_INPUT)
        }
    }
}

/// Carries out a command; a GPU that panics is an error.
fn guarded(command: Command, cancellation: &Cancellation) -> anyhow::Result<ExitCode> {
    #[cfg(feature = "gpu")]
    return gpu::guarded(|| run(command, cancellation));
    #[cfg(not(feature = "gpu"))]
    run(command, cancellation)
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
fn run(command: Command, cancellation: &Cancellation) -> anyhow::Result<ExitCode> {
    match command {
        Command::Info(args) => commands::info::run(&args, cancellation),
        Command::Cameras(args) if !args.more.is_empty() => commands::pose_sets::run(&args, cancellation),
        Command::Cameras(args) => commands::cameras::run(&args, cancellation),
        Command::Masks(args) => commands::masks::run(&args, cancellation),
        Command::Train(args) => commands::train::run(&args, cancellation),
        Command::Mesh(args) => commands::mesh::run(&args, cancellation),
        Command::Texture(args) => commands::texture::run(&args, cancellation),
        Command::Points2Mesh(args) => commands::points2mesh::run(&args, cancellation),
        Command::Render(args) => commands::render::run(&args, cancellation),
        Command::Eval(args) => commands::eval::run(&args, cancellation),
        Command::Report(args) => commands::report::run(&args, cancellation),
        Command::Paper(args) => commands::paper::run(&args, cancellation),
        Command::Bench(args) => commands::bench::run(&args, cancellation),
        Command::Stress(args) => commands::stress::run(&args, cancellation),
        Command::Synth(args) => commands::synth::run(&args, cancellation),
        Command::Export(args) => commands::export::run(&args),
        Command::Import(args) => commands::import::run(&args, cancellation),
        Command::Predict(args) => commands::predict::run(&args, cancellation),
        Command::Devices => commands::devices::run(),
    }
}
