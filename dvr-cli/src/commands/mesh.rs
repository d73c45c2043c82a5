//! `dvr mesh`: the mesh of a run.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, bail};
use dvr_core::files::check_file;
use dvr_core::mesh::check_mesh_format;
use dvr_core::metrics::self_intersections;
use dvr_core::{Cancellation, Similarity};
use dvr_train::{
    RealSize, RunFolder, ViewSplit, method_of, object_mesh, photo_texture, surface_points, write_run_mesh,
};

use super::mesh_line::mesh_line;
use super::real_size::KeptSize;
use super::simplified::simplified_to;
use super::texture::{sentence, takes_normal_map};
use super::{SceneReading, load_model, load_run, place_for, print_notes, run_mesh_options, scene_of_run};
use crate::args::MeshArgs;
use crate::memory;

/// Rays for seed points in parts that the coarse grid may miss.
const SEED_RAYS: usize = 2_000;

/// Extracts and writes.
pub fn run(args: &MeshArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let checkpoint = load_run(&args.run)?;
    let folder = RunFolder::new(if args.run.is_dir() { args.run.clone() } else { parent(&args.run) });
    let own = vec![folder.mesh_ply(), folder.mesh_glb()];
    let (targets, _writing) = place_for(&folder, args.out.as_ref(), own, args.overwrite)?;
    targets.iter().try_for_each(check_mesh_format)?;
    let mut options =
        run_mesh_options(&args.meshing, args.texture, args.preset, cancellation).of_run(&checkpoint.header);
    options.normal_map &= targets.iter().any(|target| takes_normal_map(target));
    for beside in targets.iter().flat_map(|target| files_beside(target, options.texture.is_some())) {
        check_file(&beside, args.overwrite)?;
    }
    let method = method_of(&checkpoint.header.method)?;
    let kept = match method.objects() {
        None => Some(KeptSize::of(&folder, &checkpoint.header)?),
        Some(_) if args.scale.is_empty() => None,
        Some(_) => bail!("--scale needs a photograph of the object, and a model of many objects has no single scene"),
    };
    let device = args.backend.backend.device()?;
    memory::limit(&device, args.memory.memory);
    let model = load_model(&checkpoint, args.object, &device)?;
    let options = options.following(model.cells());
    memory::check_extraction(&options.extraction, &device, args.memory.memory)?;
    // The scene helps to find thin parts and gives sharp colours, but a mesh can do without. Models of many objects have
    // no single scene, and imported runs may have none.
    let has_scene =
        method.objects().is_none() && (args.data.is_some() || !checkpoint.header.scene.as_os_str().is_empty());
    let mut scene = has_scene.then(|| scene_of_run(&checkpoint, args.data.as_ref(), args.memory.memory, cancellation));
    cancellation.check()?;
    let options = match &mut scene {
        Some(Ok(scene)) => memory::make_room_for_mesh(scene, options, &device, args.memory.memory)?,
        _ => options,
    };
    let views = match &scene {
        None => Vec::new(),
        Some(Ok(scene)) => {
            print_notes(&scene.warnings);
            ViewSplit::of(scene)?.train
        }
        Some(Err(error)) if args.data.is_some() => bail!("{error:#}"),
        Some(Err(_)) => {
            eprintln!("note: the run's scene was not found (give its folder with --data): colours come from the field");
            Vec::new()
        }
    };
    let seeds = surface_points(model.thorough_shader().as_ref(), &views, SEED_RAYS);
    let extracted = object_mesh(model.as_ref(), &options, &seeds, &views)?;
    print_notes(&extracted.warnings);
    let mut warnings = Vec::new();
    let textured = photo_texture(&extracted, &views, &options, &mut warnings)?;
    print_notes(&warnings);
    let reading = serde_json::from_value::<SceneReading>(checkpoint.header.reading.clone()).ok();
    let path = args.data.as_ref().unwrap_or(&checkpoint.header.scene);
    let known = match (&scene, &reading) {
        (Some(Ok(scene)), Some(reading)) => Some((path.as_path(), reading, scene)),
        _ => None,
    };
    let real_size = match &kept {
        Some(kept) if !args.object_space => kept.real_size(&args.scale, &extracted.mesh, known, &checkpoint.header)?,
        _ => None,
    };
    if let Some(size) = &real_size {
        print_notes(&size.warning().into_iter().collect::<Vec<_>>());
        println!("real size: {size}");
    }
    // An imported run may not have known its scene.
    let to_world = match &scene {
        _ if args.object_space => Similarity::default(),
        Some(Ok(scene)) => scene.object_to_world,
        _ => checkpoint.header.object_to_world,
    };
    let to_export = RealSize::to_export(real_size.as_ref(), &to_world);
    let mesh = extracted.mesh.transformed(&to_export);
    let crossing = self_intersections(&mesh, cancellation)?;
    println!("{}", mesh_line(mesh.vertices.len(), mesh.faces.len(), crossing));
    if let Some(simplification) = extracted.simplification {
        println!("{}", simplified_to(mesh.faces.len(), &simplification.scaled(to_world.scale), options.remesh));
    }
    if let Some(textured) = &textured {
        println!("{}", sentence(&textured.report));
    }
    let textured = textured.map(|textured| textured.mesh.transformed(&to_export));
    for path in &targets {
        write_run_mesh(path, &mesh, textured.as_ref(), options.style)?;
        println!("wrote {} ({} vertices, {} faces)", path.display(), mesh.vertices.len(), mesh.faces.len());
    }
    if let (Some(kept), None, false) = (kept, &args.out, args.object_space) {
        if real_size.is_some() && !kept.has_figures() {
            eprintln!("note: the run has no metrics.json, and does not keep its real size");
        }
        kept.keep(real_size, &folder)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// What an OBJ with a texture brings along.
fn files_beside(target: &Path, has_texture: bool) -> Vec<PathBuf> {
    let is_obj = target.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("obj"));
    if is_obj && has_texture { ["mtl", "png"].map(|kind| target.with_extension(kind)).into() } else { Vec::new() }
}

fn parent(path: &Path) -> PathBuf {
    path.parent().unwrap_or(Path::new(".")).to_owned()
}
