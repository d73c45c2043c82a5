//! `dvr points2mesh`.

use std::path::PathBuf;

use clap::Args;
use dvr_sfm::PoissonOptions;

use super::faces::{FaceBudget, parse_faces};
use super::scene::SceneArgs;
use super::values::within;

/// Arguments of `dvr points2mesh`.
#[derive(Args, Debug)]
#[command(after_long_help = AFTER_HELP)]
pub struct Points2MeshArgs {
    /// Points with outward normals (nx, ny, nz) and, if known, colours: PLY; of a mesh, the vertices. Or a scene (its folder or
    /// cameras file), whose points are those of the stereo depth maps that `dvr train` starts from
    #[arg(value_name = "CLOUD|SCENE")]
    pub cloud: PathBuf,
    /// Output file: .ply, .glb, .usdz or .obj
    #[arg(long, short, value_name = "FILE")]
    pub out: PathBuf,
    /// Replace the file at --out
    #[arg(long)]
    pub overwrite: bool,
    /// Also write the points of a scene, with normals and colours: .ply
    #[arg(long, value_name = "FILE")]
    pub cloud_out: Option<PathBuf>,
    /// Cut away what lies where the octree of the points is less deep than this: 0 keeps all and closes the surface; papers
    /// take 5 and 7 too [0 to 20]
    #[arg(long, default_value_t = 0.0, value_parser = within(0.0f64, 20.0), value_name = "DEPTH")]
    pub trim: f64,
    /// Depth of the octree: the cloud's longest edge is divided by two to this power [1 to 13]
    #[arg(long, default_value_t = 9, value_parser = within(1u32, 13), value_name = "N")]
    pub depth: u32,
    /// Weight of the points against their normals; 0 is the unscreened reconstruction of 2006 [0 to 1000]
    #[arg(long, default_value_t = 1.0, value_parser = within(0.0f64, 1000.0), value_name = "WEIGHT")]
    pub point_weight: f64,
    /// Simplify the surface to at most so many faces: full, or a number, e.g. 50k [from 4 to 100M; default: full]
    #[arg(long, value_parser = parse_faces, value_name = "N")]
    pub faces: Option<FaceBudget>,
    /// COLMAP's program, which has the reconstruction [default: `colmap` in the folders of PATH]
    #[arg(long, value_name = "PROGRAM")]
    pub colmap: Option<PathBuf>,
    /// Threads of COLMAP [1 to 1024; default: all]
    #[arg(long, value_name = "N", value_parser = within(1usize, 1024))]
    pub colmap_threads: Option<usize>,
    #[command(flatten)]
    pub reading: SceneArgs,
}

const AFTER_HELP: &str = "Examples:
  dvr points2mesh fused.ply --out surface.ply
  dvr points2mesh furu024_l3.ply --trim 7 --out surface.glb
  dvr points2mesh SCENE --trim 7 --out surface.ply
  dvr eval surface.ply --protocol dtu --reference DTU --scan 24

Screened Poisson reconstruction (Kazhdan and Hoppe 2013) by the authors' code, which COLMAP has; COLMAP must be installed. \
Dense clouds of COLMAP (stereo_fusion), PMVS, Tola's and other programs have normals. Where yours has none, let MeshLab or CloudCompare \
compute and orient them.";

impl Points2MeshArgs {
    /// The library's options.
    pub fn options(&self) -> PoissonOptions {
        PoissonOptions {
            depth: self.depth,
            trim: self.trim,
            point_weight: self.point_weight,
            threads: self.colmap_threads,
            program: self.colmap.clone(),
            ..PoissonOptions::default()
        }
    }
}
