//! The commands: each reads its arguments, calls the library and prints.

pub mod bench;
mod benchmark_page;
pub mod devices;
pub mod eval;
mod eval_objects;
pub mod export;
pub mod import;
pub mod info;
mod job;
mod machine;
pub mod mesh;
pub mod predict;
pub mod render;
pub mod report;
pub mod stress;
pub mod synth;
pub mod train;
mod train_objects;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use burn::tensor::Device;
use dvr_core::dataset::{Normalise, ReadOptions, read_scene};
use dvr_core::{MaskReport, Scene, refine_masks};
use dvr_render::extract::{Contour, ExtractSettings};
use dvr_train::{Checkpoint, ColorSource, MeshOptions, Model, RefinedCameras, RunFolder};

use serde::{Deserialize, Serialize};

use crate::args::{Colors, ContourName, MeshingArgs, SceneArgs, SurfaceArgs};

/// Cells along an edge of a scene's mesh.
pub const SCENE_RESOLUTION: u32 = 256;

/// The checkpoint of a run's folder, or the checkpoint that is given itself.
pub fn load_run(path: &Path) -> Result<Checkpoint> {
    let checkpoint = if path.is_dir() { RunFolder::new(path).load() } else { Checkpoint::load(path) };
    Ok(checkpoint?)
}

/// How a run read its scene, as its checkpoint stores it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SceneReading {
    /// How the files were read.
    #[serde(flatten)]
    pub options: ReadOptions,
    /// Whether masks were refined then.
    #[serde(default)]
    pub refine_masks: bool,
}

impl SceneReading {
    /// As the arguments say.
    pub fn of_arguments(args: &SceneArgs) -> Self {
        Self { options: args.read_options(), refine_masks: !args.no_mask_refinement }
    }

    /// Reads the scene, and refines its masks where that is wanted.
    pub fn read(&self, path: &Path) -> Result<(Scene, MaskReport)> {
        let mut scene = read_scene(path, &self.options)?;
        let report = if self.refine_masks { refine_masks(&mut scene)? } else { MaskReport::default() };
        Ok((scene, report))
    }
}

/// What became of a scene's masks, and how to keep them as they are.
pub fn refinement_notes(report: &MaskReport) -> Vec<String> {
    report.notes().iter().map(|note| format!("{note}; --no-mask-refinement takes masks as they are")).collect()
}

/// The field of a run: of its scene, or of the object that was chosen among those that it knows by their codes.
pub fn load_model(checkpoint: &Checkpoint, object: Option<usize>, device: &Device) -> Result<Model> {
    Ok(match object {
        Some(object) => Model::of_object(checkpoint, object, device)?,
        None => Model::load(checkpoint, device)?,
    })
}

/// The scene of a run, read as it was for training and in the same object space; from `moved` if it was moved, and in
/// `memory` where that is said.
pub fn scene_of_run(checkpoint: &Checkpoint, moved: Option<&PathBuf>, memory: Option<u64>) -> Result<Scene> {
    let header = &checkpoint.header;
    let mut reading: SceneReading =
        serde_json::from_value(header.reading.clone()).context("the checkpoint does not say how its scene was read")?;
    let options = &mut reading.options;
    options.max_memory = memory.or(options.max_memory);
    let is_unknown = header.scene.as_os_str().is_empty();
    // An imported network has the object space of the files, as the original takes it.
    options.normalise = if is_unknown { Normalise::Files } else { Normalise::Given(header.object_to_world) };
    let path = match moved {
        Some(path) => path,
        None if is_unknown => bail!("the run was imported without its scene: say with --data where it lies"),
        None => &header.scene,
    };
    let (mut scene, _) = reading.read(path).with_context(|| format!("the run's scene, {}", path.display()))?;
    RefinedCameras::apply(&header.cameras, &mut scene);
    Ok(scene)
}

/// Meshing as the arguments want it, in `resolution` cells an edge where they do not say.
pub fn mesh_options(args: &MeshingArgs, resolution: u32) -> MeshOptions {
    let colors = match args.colors {
        Colors::Photos => ColorSource::Photos,
        Colors::Field => ColorSource::Field,
    };
    MeshOptions { colors, ..surface_options(&args.surface, resolution) }
}

/// The same without photographs to take colours from.
pub fn surface_options(args: &SurfaceArgs, resolution: u32) -> MeshOptions {
    let resolution = args.resolution.unwrap_or(resolution);
    // The coarse grid has about 64 cells an edge: fine enough for most parts, a 64th of the cost of 256.
    let upsampling_steps = (resolution / 64).max(1).ilog2() as usize;
    let extraction = ExtractSettings {
        resolution: resolution as usize,
        upsampling_steps,
        contour: match args.contour {
            ContourName::MarchingCubes => Contour::MarchingCubes,
            ContourName::Dual => Contour::Dual,
        },
        min_component_share: args.min_component,
        ..ExtractSettings::default()
    };
    MeshOptions { extraction, colors: ColorSource::Field, max_simplification: args.simplify }
}

/// Prints notes on standard error, one a line.
pub fn print_notes(warnings: &[String]) {
    for warning in warnings {
        eprintln!("note: {warning}");
    }
}
