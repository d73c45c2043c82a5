//! How meshes are made, and `dvr mesh`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::values::parse_share;
use super::{BackendArg, MemoryArg};

/// Where a mesh has its colours from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Colors {
    /// The photographs that see the vertex: sharp
    Photos,
    /// The texture field: smooth, without traces of single pictures
    Field,
}

/// How the surface is made triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ContourName {
    /// Marching cubes: smooth, corners and creases are cut off by up to a cell
    MarchingCubes,
    /// Dual contouring: keeps corners and creases of the field; may intersect itself at thin or noisy parts
    Dual,
}

/// How a surface is extracted.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Mesh")]
pub struct SurfaceArgs {
    /// Grid cells along an edge of the object's cube [default: 256; 128 for objects of a dataset]
    #[arg(long, value_parser = clap::value_parser!(u32).range(8..=2048), value_name = "N")]
    pub resolution: Option<u32>,
    /// How the surface is made triangles; the mesh is watertight either way
    #[arg(long, value_enum, default_value_t = ContourName::MarchingCubes)]
    pub contour: ContourName,
    /// Drop pieces smaller than this share of the largest piece's area; 0 keeps everything
    #[arg(long, default_value_t = 0.01, value_name = "SHARE")]
    pub min_piece: f64,
    /// Save triangles where that moves the surface by no more than this share of the object's cube, e.g. 0.0005
    #[arg(long, default_value_t = 0.0, value_parser = parse_share, value_name = "SHARE")]
    pub simplify: f32,
}

/// How a coloured mesh is made.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Mesh")]
pub struct MeshingArgs {
    #[command(flatten)]
    pub surface: SurfaceArgs,
    /// Where vertex colours come from
    #[arg(long, value_enum, default_value_t = Colors::Photos)]
    pub colors: Colors,
}

/// Arguments of `dvr mesh`.
#[derive(Args, Debug)]
pub struct MeshArgs {
    /// Folder of a run, or one of its checkpoints
    pub run: PathBuf,
    /// File to write: .ply, .obj or .glb by its ending [default: mesh.ply and mesh.glb in the run]
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// For runs that know objects by learned codes: which one, counted from 0
    #[arg(long, value_name = "N")]
    pub object: Option<usize>,
    /// Leave the mesh in object space (the unit cube) instead of the scene's own coordinates
    #[arg(long)]
    pub object_space: bool,
    /// Where the scene lies now, if it was moved since training
    #[arg(long, value_name = "SCENE")]
    pub data: Option<PathBuf>,
    #[command(flatten)]
    pub meshing: MeshingArgs,
    #[command(flatten)]
    pub backend: BackendArg,
    #[command(flatten)]
    pub memory: MemoryArg,
}
