//! The command line.

mod bench;
mod cameras;
mod device;
mod eval;
mod exchange;
mod faces;
mod known_length;
mod masks;
mod mesh;
mod method;
mod paper;
mod points2mesh;
mod predict;
mod preset;
mod render;
mod report;
mod scene;
mod stress;
mod symmetry;
mod synth;
mod texture;
mod train;
mod values;
mod variant;

use clap::{Parser, Subcommand};

pub use bench::BenchArgs;
pub use cameras::{CamerasArgs, FindingArgs};
pub use eval::{Baseline, EvalArgs, EvalPointsArgs, SplitArg};
pub use exchange::{ExportArgs, ImportArgs};
pub use faces::FaceBudget;
pub use known_length::{KnownLengthArg, ScaleArg};
pub use masks::{MasksArgs, MasksFrom, SegmentArg};
pub use mesh::{Colors, ContourName, MeshArgs, MeshingArgs, SurfaceArgs};
pub use method::CapacityArg;
#[cfg(test)]
pub use method::MethodName;
pub use paper::{NamedCloud, PaperArgs, PaperTable};
pub use points2mesh::Points2MeshArgs;
pub use predict::PredictArgs;
pub use preset::PresetArg;
pub use render::{Animation, Cameras, RenderArgs, UpAxis, ViewColorChoice};
pub use report::ReportArgs;
pub use scene::{InfoArgs, SceneArgs};
pub use stress::StressArgs;
pub use symmetry::SymmetryArg;
pub use synth::SynthArgs;
pub use texture::{TextureArg, TextureArgs, texture_settings};
pub use train::TrainArgs;
pub use variant::Variant;

/// Textured meshes from posed photographs, by differentiable volumetric rendering.
#[derive(Debug, Parser)]
#[command(name = "dvr", version = VERSION, about, long_about = LONG_ABOUT)]
pub struct Cli {
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// Version and commit.
const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("DVR_COMMIT"), ")");

const LONG_ABOUT: &str = "Textured meshes from posed photographs, by differentiable volumetric rendering.

dvr reconstructs an object from photographs; cameras that are not known are found by COLMAP, masks from all views together. It trains an occupancy and colour field whose \
rendered depth has an exact, analytic gradient, and extracts a mesh. Check a scene with `dvr info SCENE`; `dvr train SCENE \
--out RUN` then trains, and writes the mesh (PLY, and GLB with a texture), a preview sheet, metrics and a report.";

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show a scene: views, cameras, masks, bounds, warnings
    Info(InfoArgs),
    /// Find the cameras of photographs or of a clip, by structure from motion with COLMAP
    Cameras(CamerasArgs),
    /// Find the masks of pictures that have none, from all views together
    Masks(MasksArgs),
    /// Reconstruct a scene: train, then write mesh, preview sheet, metrics and report
    Train(Box<TrainArgs>),
    /// Extract a run's mesh, at any resolution and in any format
    Mesh(MeshArgs),
    /// Give any mesh a texture from a scene's photographs
    Texture(TextureArgs),
    /// Make a surface of a dense cloud of points with normals, by screened Poisson reconstruction with COLMAP
    #[command(name = "points2mesh")]
    Points2Mesh(Points2MeshArgs),
    /// Render a run or a mesh: the dataset's views, or an orbit with a turntable animation
    Render(RenderArgs),
    /// Evaluate a run or a mesh: shape against ground truth, verified points or a DTU scan, renders against test views
    Eval(Box<EvalArgs>),
    /// Write a report of one run, or of several side by side, as an HTML page: mesh in 3D, test views, curves,
    /// settings
    Report(ReportArgs),
    /// Compare methods, or variants of one: quality, time, memory and size, with their range over seeds
    Bench(BenchArgs),
    /// Test where methods fail: one difficulty at a time in shape, texture, views, masks, cameras or pictures
    Stress(StressArgs),
    /// Make a table of the publication with the data that you have, published figures beside yours
    Paper(PaperArgs),
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
    use std::any::TypeId;
    use std::time::Duration;

    use clap::{Arg, ArgAction, CommandFactory};

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    /// Arguments that take numbers, of all commands, with the command's name.
    fn numeric() -> Vec<(String, Arg)> {
        let numbers = [
            TypeId::of::<u8>(),
            TypeId::of::<u32>(),
            TypeId::of::<u64>(),
            TypeId::of::<usize>(),
            TypeId::of::<f32>(),
            TypeId::of::<f64>(),
            TypeId::of::<(u32, u32)>(),
            TypeId::of::<Duration>(),
            TypeId::of::<dvr_train::Shard>(),
        ];
        let is_numeric = |arg: &Arg| {
            let takes_value = matches!(arg.get_action(), ArgAction::Set | ArgAction::Append);
            takes_value && numbers.iter().any(|number| arg.get_value_parser().type_id() == *number)
        };
        let command = Cli::command();
        let of = |command: &clap::Command| {
            let name = command.get_name().to_owned();
            command.get_arguments().filter(|arg| is_numeric(arg)).map(|arg| (name.clone(), arg.clone())).collect()
        };
        command.get_subcommands().flat_map::<Vec<_>, _>(of).collect()
    }

    /// What an argument says of a value, where it refuses it.
    fn refusal(arg: &Arg, value: &str) -> Option<String> {
        let alone = Arg::new("value").long("value").value_parser(arg.get_value_parser().clone());
        let command = clap::Command::new("dvr").arg(alone);
        command.try_get_matches_from(["dvr".to_owned(), format!("--value={value}")]).err().map(|e| e.to_string())
    }

    #[test]
    fn every_number_has_a_range_that_its_help_tells_and_its_refusal_names() {
        let numeric = numeric();
        assert!(numeric.len() > 25, "{}", numeric.len());
        for (command, arg) in numeric {
            let flag = arg.get_long().unwrap_or_default().to_owned();
            let help = arg.get_help().map(ToString::to_string).unwrap_or_default().replace('\n', " ");
            for absurd in ["-1e300", "nan", "inf", "-inf", "much", ""] {
                let said = refusal(&arg, absurd).unwrap_or_else(|| panic!("{command} --{flag} takes {absurd}"));
                assert!(!said.contains("panicked"), "{said}");
            }
            for absurd in ["1e18", "99999999999999999999999999"] {
                assert!(refusal(&arg, absurd).is_some(), "{command} --{flag} takes {absurd}");
            }
            // Any whole number is a seed.
            if flag == "seed" {
                continue;
            }
            let said = refusal(&arg, "99999999999999999999999999").unwrap_or_default();
            let range = said.split("from ").nth(1).unwrap_or_default().lines().next().unwrap_or_default();
            assert!(!range.is_empty() && help.contains(range), "{command} --{flag}: {range:?} is not in {help:?}");
            assert!(said.contains("99999999999999999999999999"), "{said}");
        }
    }

    #[test]
    fn other_values_that_hold_a_number_have_a_range_too() {
        assert!(method::parse_capacity("4294967295").is_err_and(|said| said.contains("from 32 to 512")));
        assert!(values::parse_shard("1/99999999999").is_err_and(|said| said.contains("1000000")));
        for absurd in ["0", "-1", "nan", "4294967295", "1e18"] {
            assert!(method::parse_capacity(absurd).is_err() && values::parse_size(absurd).is_err(), "{absurd}");
        }
    }
}
