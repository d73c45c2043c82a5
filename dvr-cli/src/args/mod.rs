//! The command line.

mod bench;
mod eval;
mod exchange;
mod mesh;
mod predict;
mod render;
mod report;
mod scene;
mod stress;
mod synth;
mod train;
mod values;

use clap::{Args, Parser, Subcommand};

use crate::backend::{self, Backend};

pub use bench::{BenchArgs, Variant};
pub use eval::{Baseline, EvalArgs, SplitArg};
pub use exchange::{ExportArgs, ImportArgs};
pub use mesh::{Colors, ContourName, MeshArgs, MeshingArgs, SurfaceArgs};
pub use predict::PredictArgs;
pub use render::{Animation, Cameras, RenderArgs, UpAxis};
pub use report::ReportArgs;
pub use scene::{InfoArgs, SceneArgs};
pub use stress::StressArgs;
pub use synth::SynthArgs;
pub use train::{CapacityArg, MethodName, ObjectsArgs, TrainArgs};

/// Posed photos in, a trustworthy textured mesh out.
#[derive(Debug, Parser)]
#[command(name = "dvr", version, about, long_about = LONG_ABOUT)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

const LONG_ABOUT: &str = "Posed photos in, a trustworthy textured mesh out.

dvr reconstructs one object from photographs with known cameras and masks, by differentiable volumetric rendering: a \
neural occupancy and texture field whose surface depth has an exact, analytic gradient. Look at a scene with `dvr info` \
first, then `dvr train SCENE --out RUN` does the whole job: training, mesh (PLY and GLB), preview sheet and figures.";

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show what was found in a scene: views, cameras, masks, bounds, and what may go wrong
    Info(InfoArgs),
    /// Reconstruct a scene: trains, then writes mesh, preview sheet and figures
    Train(TrainArgs),
    /// Extract the mesh of a run again, at another resolution or in another format
    Mesh(MeshArgs),
    /// Render a run: the dataset's views, or an orbit as images and a turntable animation
    Render(RenderArgs),
    /// Measure a run or a mesh: shape against ground truth, pictures against held-out views
    Eval(EvalArgs),
    /// Tell of one run, or of several side by side, on a page for a browser: the mesh in 3D, held-out views, curves,
    /// settings
    Report(ReportArgs),
    /// Compare methods, or variants of one, on scenes: quality, time, memory and bytes with their spread over seeds
    Bench(BenchArgs),
    /// Find out where methods fail: one difficulty at a time, in shape, texture, views, masks, cameras and pictures
    Stress(StressArgs),
    /// Render meshes into a ShapeNet-style dataset with images, masks, depth, cameras and ground truth
    Synth(SynthArgs),
    /// Write the network of a run as safetensors, with PyTorch names and layout
    Export(ExportArgs),
    /// Make a run of a checkpoint of the original PyTorch code (.pt)
    Import(ImportArgs),
    /// Make a mesh of the object in a single picture, with a run that has learned many objects
    Predict(PredictArgs),
    /// List the processors that --backend can choose
    Devices,
}

/// Where the computation runs.
#[derive(Args, Clone, Copy, Debug)]
pub struct BackendArg {
    #[arg(long, value_name = "BACKEND", default_value_t = Backend::Cpu, help = backend::HELP)]
    pub backend: Backend,
}

/// How much memory commands may take that look at what was trained.
#[derive(Args, Clone, Copy, Debug)]
pub struct MemoryArg {
    /// With --backend gpu, the most that tensors may take on the graphics processor, e.g. 500M or 2G: work is cut to fit.
    /// Decoded photographs above it are kept in a scratch file, as by `dvr train` [default: no limit]
    #[arg(long, value_parser = values::parse_memory, value_name = "BYTES")]
    pub memory: Option<u64>,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
