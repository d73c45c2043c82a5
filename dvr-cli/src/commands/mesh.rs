//! `dvr mesh`: the mesh of a run, again.

use std::process::ExitCode;

use anyhow::Result;
use dvr_core::mesh::write_mesh;
use dvr_train::{RunFolder, ViewSplit, decoder_of, extraction_warnings, object_mesh, surface_points, world_mesh};

use super::{extract_settings, load_run, print_notes, scene_of_run};
use crate::args::MeshArgs;

/// Rays that look for parts which the coarse grid may miss.
const SEED_RAYS: usize = 2_000;

/// Extracts and writes.
pub fn run(args: &MeshArgs) -> Result<ExitCode> {
    let checkpoint = load_run(&args.run)?;
    let field = decoder_of(&checkpoint, &args.backend.backend.device())?;
    // The scene only helps to find thin parts; a run can be meshed without it.
    let seeds = match scene_of_run(&checkpoint, None) {
        Ok(scene) => {
            let views = ViewSplit::new(&scene, checkpoint.header.config.hold_out_every)?;
            surface_points(&field, &views.train, SEED_RAYS)
        }
        Err(_) => Vec::new(),
    };
    let extracted = object_mesh(&field, &extract_settings(&args.extraction), &seeds)?;
    print_notes(&extraction_warnings(&extracted));
    let mesh = if args.object_space {
        extracted.mesh
    } else {
        world_mesh(&extracted.mesh, &checkpoint.header.object_to_world)
    };
    let folder = RunFolder::new(if args.run.is_dir() { args.run.clone() } else { parent(&args.run) });
    let targets = match &args.out {
        Some(path) => vec![path.clone()],
        None => vec![folder.mesh_ply(), folder.mesh_glb()],
    };
    for path in &targets {
        write_mesh(path, &mesh)?;
        println!("wrote {} ({} vertices, {} faces)", path.display(), mesh.vertices.len(), mesh.faces.len());
    }
    Ok(ExitCode::SUCCESS)
}

fn parent(path: &std::path::Path) -> std::path::PathBuf {
    path.parent().unwrap_or(std::path::Path::new(".")).to_owned()
}
