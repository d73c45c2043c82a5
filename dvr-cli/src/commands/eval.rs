//! `dvr eval`: figures of a run or a mesh.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use dvr_core::dataset::read_scene;
use dvr_core::mesh::{Mesh, read_mesh};
use dvr_core::{Scene, View};
use dvr_render::{MeshShader, Shader};
use dvr_train::{
    Checkpoint, ColorSource, Error, GridConfig, MeshOptions, Observer, ShapeEvaluation, Supervision, ViewEvaluation,
    ViewSplit, evaluate_shape, evaluate_views, method_of, object_mesh, surface_points, unseen_views,
};
use serde::Serialize;

use super::shape_table::print_shape;
use super::{SCENE_RESOLUTION, eval_objects, load_model, load_run, mesh_options, scene_of_run};
use crate::args::EvalArgs;
use crate::memory;
use crate::progress::Progress;

/// What is written with `--json`.
#[derive(Serialize)]
struct Report {
    scene: String,
    shape: ShapeEvaluation,
    views: Vec<ViewEvaluation>,
}

/// Measures and prints.
pub fn run(args: &EvalArgs) -> Result<ExitCode> {
    let Some(subject) = &args.subject else { return eval_objects::without_run(args) };
    let is_mesh = subject.is_file() && subject.extension().is_none_or(|e| e != "ckpt" && e != "dvr");
    let report = if is_mesh {
        refuse_objects(args)?;
        of_mesh(args, subject)?
    } else {
        let checkpoint = load_run(subject)?;
        if method_of(&checkpoint.header.method)?.objects().is_some() {
            return eval_objects::of_run(args, subject, &checkpoint);
        }
        refuse_objects(args)?;
        of_run(args, &checkpoint)?
    };
    print_shape(&report.shape);
    print_views(&report.views);
    if report.shape == (ShapeEvaluation { surface: None, floor: None, volume_iou: None }) && report.views.is_empty() {
        bail!(
            "scene {:?} has neither ground truth nor views that were held out: there is nothing to compare",
            report.scene
        );
    }
    if let Some(path) = &args.json {
        dvr_core::files::write_bytes_atomically(path, serde_json::to_string_pretty(&report)?.as_bytes())?;
        println!("wrote {}", path.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// Refuses what has a meaning for datasets of objects only.
fn refuse_objects(args: &EvalArgs) -> Result<()> {
    let objects = &args.objects;
    if objects.split.is_some() || objects.shard.is_some() || objects.out.is_some() || objects.object_views > 0 {
        bail!(
            "--split, --out, --shard and --object-views are for models of many objects, and this is a single scene's; its \
             figures go to --json FILE"
        );
    }
    Ok(())
}

fn of_mesh(args: &EvalArgs, mesh: &Path) -> Result<Report> {
    let data = args.data.as_ref().context("a mesh is measured against a scene: give it with --data")?;
    let scene = read_scene(data, &args.reading.read_options())?;
    let mesh = read_mesh(mesh)?.mesh.transformed(&scene.object_to_world.inverse());
    let shape = evaluate_shape(&mesh, &scene.ground_truth, args.seed)?;
    let hold_out_every = GridConfig::new(Supervision::default()).hold_out_every;
    let held_out = unseen_views(&scene, &ViewSplit::new(&scene, hold_out_every)?);
    let views = if args.no_views { Vec::new() } else { rendered(&MeshShader::new(&mesh), &held_out)? };
    Ok(Report { scene: scene.name, shape, views })
}

fn of_run(args: &EvalArgs, checkpoint: &Checkpoint) -> Result<Report> {
    let scene: Scene = scene_of_run(checkpoint, args.data.as_ref(), args.reading.memory)?;
    let device = args.backend.backend.device_for(method_of(&checkpoint.header.method)?.as_ref())?;
    memory::limit(&device, args.reading.memory);
    let model = load_model(checkpoint, None, &device)?;
    let split = ViewSplit::new(&scene, checkpoint.header.common.hold_out_every)?;
    let seeds = surface_points(model.thorough_shader().as_ref(), &split.train, 2_000);
    // Photographs tell which small pieces stay; colours are not looked at.
    let options = MeshOptions { colors: ColorSource::Field, ..mesh_options(&args.meshing, SCENE_RESOLUTION) };
    let mesh = match object_mesh(model.as_ref(), &options, &seeds, &split.train) {
        Ok(extracted) => extracted.mesh,
        Err(Error::NoMesh(reason)) => {
            eprintln!("note: {reason}");
            Mesh::default()
        }
        Err(other) => return Err(other.into()),
    };
    let shape = evaluate_shape(&mesh, &scene.ground_truth, args.seed)?;
    let mut views = Vec::new();
    if !args.no_views {
        let held_out = unseen_views(&scene, &split);
        views = rendered(model.shader(args.samples as usize).as_ref(), &held_out)?;
    }
    Ok(Report { scene: scene.name, shape, views })
}

fn rendered(shader: &dyn Shader, views: &[&View]) -> Result<Vec<ViewEvaluation>> {
    let mut progress = Progress::new();
    progress.phase("rendering held-out views", views.len());
    Ok(evaluate_views(shader, views, |done| progress.progress(done, ""))?)
}

/// Prints the views' figures and their means.
fn print_views(views: &[ViewEvaluation]) {
    if views.is_empty() {
        return;
    }
    println!("held-out views (both pictures on white)");
    println!("  {:<22}{:>9}{:>9}{:>9}", "view", "PSNR dB", "SSIM", "mask IoU");
    for view in views {
        println!("  {:<22}{:>9.2}{:>9.4}{:>9.4}", view.view, view.psnr, view.ssim, view.mask_iou);
    }
    let mean = |part: fn(&ViewEvaluation) -> f64| views.iter().map(part).sum::<f64>() / views.len() as f64;
    println!("  {:<22}{:>9.2}{:>9.4}{:>9.4}", "mean", mean(|v| v.psnr), mean(|v| v.ssim), mean(|v| v.mask_iou));
}
