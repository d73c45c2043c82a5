//! Meshing options from arguments.

use dvr_render::extract::{Contour, ExtractSettings};
use dvr_train::{ColorSource, MeshOptions};

use crate::args::{Colors, ContourName, MeshingArgs, SurfaceArgs};

/// Cells per edge of a scene's mesh.
pub const SCENE_RESOLUTION: u32 = 256;

/// Cells per edge of the mesh of an object of a dataset, as in DVR's reference code.
pub const OBJECT_RESOLUTION: u32 = 128;

/// The meshing options of the arguments; `resolution` is the default number of cells per edge.
pub fn mesh_options(args: &MeshingArgs, resolution: u32) -> MeshOptions {
    let colors = match args.colors {
        Colors::Photos => ColorSource::Photos,
        Colors::Field => ColorSource::Field,
    };
    MeshOptions { colors, ..surface_options(&args.surface, resolution) }
}

/// The same for meshes without photographs.
pub fn surface_options(args: &SurfaceArgs, resolution: u32) -> MeshOptions {
    let resolution = args.resolution.unwrap_or(resolution);
    // The coarse grid has about 64 cells per edge: fine enough for most parts, a 64th of the cost of 256.
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
