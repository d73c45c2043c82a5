//! How meshes are made, and `dvr mesh`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::device::{BackendArg, MemoryArg};
use super::faces::{FaceBudget, parse_faces};
use super::known_length::ScaleArg;
use super::preset::PresetArg;
use super::texture::TextureArg;
use super::values::within;

/// Where the colours of a mesh come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Colors {
    /// The photographs that see the vertex: sharp
    Photos,
    /// The colour field: smooth, without seams between photographs
    Field,
}

/// How the surface is triangulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ContourName {
    /// Marching cubes: cuts corners and creases off by up to one cell
    MarchingCubes,
    /// Dual contouring: keeps corners and creases; may intersect itself at thin or noisy parts
    Dual,
}

/// How a surface is extracted.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Mesh")]
pub struct SurfaceArgs {
    /// Cells per edge of the object cube [8 to 2048; default: twice those of a grid, at most 256 or those of
    /// the grid; 128 for objects of a dataset]
    #[arg(long, value_parser = within(8u32, 2048), value_name = "N")]
    pub resolution: Option<u32>,
    /// How the surface is triangulated; the mesh is watertight either way
    #[arg(long, value_enum, default_value_t = ContourName::MarchingCubes)]
    pub contour: ContourName,
    /// Drop connected components with less than this share of the largest one's area; 0 keeps all [0 to 1]
    #[arg(long, default_value_t = 0.01, value_parser = within(0.0, 1.0), value_name = "SHARE")]
    pub min_component: f64,
    /// Simplify the mesh; the surface moves by at most this share of the object cube's edge, e.g. 0.0005
    /// [0 to 1]
    #[arg(long, default_value_t = 0.0, value_parser = within(0f32, 1.0), value_name = "SHARE")]
    pub simplify: f32,
    /// Simplify the mesh to at most so many faces, those first whose loss moves the surface least: full, or a number, e.g.
    /// 5k, 50k or 200k [from 4 to 100M; default: full, or what --preset says]
    #[arg(long, value_parser = parse_faces, value_name = "N")]
    pub faces: Option<FaceBudget>,
    /// Make the triangles near equilateral, all about the same size (isotropic remeshing), about as many as --faces or
    /// --preset says, or as the mesh has; sharp edges are kept
    #[arg(long, conflicts_with = "simplify")]
    pub remesh: bool,
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
    /// Output file, .ply, .obj, .glb or .usdz [default: mesh.ply and mesh.glb in the run]
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Replace the file at --out
    #[arg(long)]
    pub overwrite: bool,
    /// Which object, counted from 0, for runs with one learned code per object [0 to 9999999]
    #[arg(long, value_parser = within(0usize, 9_999_999), value_name = "N")]
    pub object: Option<usize>,
    /// Write the mesh in object space (the unit cube) instead of scene coordinates
    #[arg(long)]
    pub object_space: bool,
    /// Real size, as of `dvr train --scale`, e.g. "IMG_1.jpg:(120,340)-(510,352)=12cm" (pixels [0 to 1000000], lengths
    /// [0.000001 to 1000000]); repeatable. off writes the units of the scene's files. Without --out, the run keeps it
    /// [default: the run's]
    #[arg(long, value_name = "LENGTH", conflicts_with = "object_space")]
    pub scale: Vec<ScaleArg>,
    /// The run's scene, if it was moved since training
    #[arg(long, value_name = "SCENE")]
    pub data: Option<PathBuf>,
    #[command(flatten)]
    pub meshing: MeshingArgs,
    #[command(flatten)]
    pub preset: PresetArg,
    #[command(flatten)]
    pub texture: TextureArg,
    #[command(flatten)]
    pub backend: BackendArg,
    #[command(flatten)]
    pub memory: MemoryArg,
}
