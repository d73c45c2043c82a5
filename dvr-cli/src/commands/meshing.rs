//! Meshing options from arguments.

use dvr_core::Cancellation;
use dvr_render::extract::{Contour, ExtractSettings};
use dvr_train::{ColorSource, MeshOptions};

use crate::args::{Colors, ContourName, FaceBudget, MeshingArgs, PresetArg, SurfaceArgs, TextureArg};

/// Cells per edge of a scene's mesh.
pub const SCENE_RESOLUTION: u32 = 256;

/// Cells per edge of the mesh of an object of a dataset, as in DVR's reference code.
pub const OBJECT_RESOLUTION: u32 = 128;

/// The meshing options of the arguments; `resolution` is the default number of cells per edge, `cancellation` ends the
/// work early.
pub fn mesh_options(args: &MeshingArgs, resolution: u32, cancellation: &Cancellation) -> MeshOptions {
    let colors = match args.colors {
        Colors::Photos => ColorSource::Photos,
        Colors::Field => ColorSource::Field,
    };
    MeshOptions { colors, ..surface_options(&args.surface, resolution, cancellation) }
}

/// The same with a texture, of a scene's run.
pub fn run_mesh_options(
    args: &MeshingArgs,
    texture: TextureArg,
    preset: PresetArg,
    cancellation: &Cancellation,
) -> MeshOptions {
    MeshOptions {
        texture: texture.settings(preset),
        normal_map: texture.finish.has_normal_map(),
        style: texture.finish.style(),
        max_faces: preset.max_faces(args.surface.faces),
        ..mesh_options(args, SCENE_RESOLUTION, cancellation)
    }
}

/// The same for meshes without photographs.
pub fn surface_options(args: &SurfaceArgs, resolution: u32, cancellation: &Cancellation) -> MeshOptions {
    let base = match args.resolution {
        Some(resolution) => MeshOptions::with_resolution(resolution as usize),
        None => MeshOptions::within_resolution(resolution as usize),
    };
    let extraction = ExtractSettings {
        contour: match args.contour {
            ContourName::MarchingCubes => Contour::MarchingCubes,
            ContourName::Dual => Contour::Dual,
        },
        min_component_share: args.min_component,
        cancellation: cancellation.clone(),
        ..base.extraction
    };
    MeshOptions {
        extraction,
        colors: ColorSource::Field,
        max_simplification: args.simplify,
        max_faces: args.faces.and_then(FaceBudget::limit),
        remesh: args.remesh,
        cut: None,
        texture: None,
        ..base
    }
}
