//! The command line.

mod bench;
mod device;
mod eval;
mod exchange;
mod mesh;
mod method;
mod predict;
mod render;
mod report;
mod scene;
mod stress;
mod synth;
mod train;
mod values;
mod variant;

use clap::{Parser, Subcommand};

pub use bench::BenchArgs;
pub use eval::{Baseline, EvalArgs, SplitArg};
pub use exchange::{ExportArgs, ImportArgs};
pub use mesh::{Colors, ContourName, MeshArgs, MeshingArgs, SurfaceArgs};
pub use method::CapacityArg;
#[cfg(test)]
pub use method::MethodName;
pub use predict::PredictArgs;
pub use render::{Animation, Cameras, RenderArgs, UpAxis};
pub use report::ReportArgs;
pub use scene::{InfoArgs, SceneArgs};
pub use stress::StressArgs;
pub use synth::SynthArgs;
pub use train::TrainArgs;
pub use variant::Variant;

/// Textured meshes from posed photographs, by differentiable volumetric rendering.
#[derive(Debug, Parser)]
#[command(name = "dvr", version, about, long_about = LONG_ABOUT)]
pub struct Cli {
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

const LONG_ABOUT: &str = "Textured meshes from posed photographs, by differentiable volumetric rendering.

dvr reconstructs an object from photographs with known cameras and masks. It trains an occupancy and colour field whose \
rendered depth has an exact, analytic gradient, and extracts a mesh. Check a scene with `dvr info SCENE`; `dvr train SCENE \
--out RUN` then trains, and writes the mesh (PLY and GLB), a preview sheet, metrics and a report.";

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show a scene: views, cameras, masks, bounds, warnings
    Info(InfoArgs),
    /// Reconstruct a scene: train, then write mesh, preview sheet, metrics and report
    Train(TrainArgs),
    /// Extract a run's mesh, at any resolution and in any format
    Mesh(MeshArgs),
    /// Render a run: the dataset's views, or an orbit with a turntable animation
    Render(RenderArgs),
    /// Evaluate a run or a mesh: shape against ground truth, renders against held-out views
    Eval(EvalArgs),
    /// Write a report of one run, or of several side by side, as an HTML page: mesh in 3D, held-out views, curves,
    /// settings
    Report(ReportArgs),
    /// Compare methods, or variants of one: quality, time, memory and size, with their range over seeds
    Bench(BenchArgs),
    /// Test where methods fail: one difficulty at a time in shape, texture, views, masks, cameras or pictures
    Stress(StressArgs),
    /// Render meshes into a ShapeNet-style dataset with images, masks, depth, cameras and ground truth
    Synth(SynthArgs),
    /// Write a run's network as safetensors, with PyTorch names and layout
    Export(ExportArgs),
    /// Convert a checkpoint of DVR's reference code (PyTorch, .pt) to a run
    Import(ImportArgs),
    /// Reconstruct objects from single pictures, with a run trained on a dataset of objects
    Predict(PredictArgs),
    /// List the devices for --backend and --devices
    Devices,
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
