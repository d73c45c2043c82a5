//! `dvr eval`: figures of a run or a mesh.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Result, bail};
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::files::check_file;
use dvr_core::mesh::{Mesh, read_mesh};
use dvr_core::metrics::self_intersections;
use dvr_core::{Camera, Cancellation, HOLD_OUT_EVERY, Scene, View};
use dvr_render::{MeshShader, Shader};
use dvr_train::{
    Checkpoint, ColorSource, DepthMapsEvaluation, Error, MeshOptions, Observer, PicturesOf, PointsEvaluation,
    RunPictures, ShapeEvaluation, ViewEvaluation, ViewSplit, evaluate_shape, evaluate_views, method_of, object_mesh,
    surface_points, world_mesh,
};
use serde::Serialize;

use super::depth_table::print_depth_maps;
use super::eval_dtu::{DtuEvaluation, print_dtu, score_by_dtu};
use super::mesh_line::mesh_line;
use super::points_table::{print_points, score_by_points, settings, verified_points};
use super::real_size::refuse_metres;
use super::resumed::refuse_other_reading;
use super::shape_table::print_shape;
use super::stored_run::{is_mesh, pictures_of};
use super::{SCENE_RESOLUTION, eval_objects, load_model, load_run, mesh_options, print_notes, scene_of_run};
use crate::args::EvalArgs;
use crate::memory;
use crate::progress::Progress;

/// What is written with `--json`.
#[derive(Serialize)]
struct Report {
    /// Name of the scene, where one was read.
    scene: Option<String>,
    mesh: MeshFacts,
    shape: ShapeEvaluation,
    views: Vec<ViewEvaluation>,
    /// What of a run they show; `None` where they show the mesh that was given, or nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pictures_of: Option<PicturesOf>,
    /// Against verified points, where these were given or come with the scene; in the units of the files.
    points: Option<PointsEvaluation>,
    /// The depth maps that the run started from, where they were asked for.
    depth_maps: Option<DepthMapsEvaluation>,
    /// By the protocol of DTU, where that was asked for; in millimetres.
    dtu: Option<DtuEvaluation>,
}

/// The mesh by itself, as it was read or made.
#[derive(Serialize)]
struct MeshFacts {
    vertices: usize,
    faces: usize,
    /// Pairs of faces that intersect though they have no corner in common.
    self_intersections: usize,
}

impl MeshFacts {
    fn of(mesh: &Mesh, cancellation: &Cancellation) -> Result<Self> {
        let self_intersections = self_intersections(mesh, cancellation)?;
        Ok(Self { vertices: mesh.vertices.len(), faces: mesh.faces.len(), self_intersections })
    }
}

/// Measures and prints.
pub fn run(args: &EvalArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let Some(subject) = &args.subject else {
        refuse_single(args)?;
        return eval_objects::without_run(args, cancellation);
    };
    if let Some(path) = &args.json {
        check_file(path, args.overwrite)?;
    }
    let report = if is_mesh(subject) {
        refuse_objects(args)?;
        of_mesh(args, subject, cancellation)?
    } else {
        let checkpoint = load_run(subject)?;
        if method_of(&checkpoint.header.method)?.objects().is_some() {
            refuse_single(args)?;
            return eval_objects::of_run(args, subject, &checkpoint, cancellation);
        }
        refuse_objects(args)?;
        of_run(args, subject, &checkpoint, cancellation)?
    };
    let MeshFacts { vertices, faces, self_intersections } = report.mesh;
    println!("{}", mesh_line(vertices, faces, self_intersections));
    print_shape(&report.shape);
    if let Some(points) = &report.points {
        print_points(points);
    }
    if let Some(depth_maps) = &report.depth_maps {
        print_depth_maps(depth_maps);
    }
    if let Some(dtu) = &report.dtu {
        print_dtu(dtu);
    }
    print_views(&report.views, report.pictures_of);
    let is_measured = report.points.is_some() || report.dtu.is_some() || !report.views.is_empty();
    if report.shape == ShapeEvaluation::default() && !is_measured {
        bail!(
            "scene {:?} has neither ground truth nor test views: there is nothing to compare. Points that are known to lie on \
             the surface are given with --points FILE",
            report.scene.unwrap_or_default()
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
    let has_folder = objects.split.is_some() || objects.shard.is_some() || objects.out.is_some();
    if has_folder || objects.object_views > 0 || objects.threshold.is_some() || objects.symmetry.is_some() {
        bail!(
            "--split, --out, --shard, --object-views, --threshold and --symmetry are for models of many objects, and \
             this is a single scene's; its figures go to --json FILE"
        );
    }
    Ok(())
}

/// Refuses what has a meaning for single scenes only.
fn refuse_single(args: &EvalArgs) -> Result<()> {
    if args.protocol.protocol.is_some() {
        bail!("--protocol measures a single scene's mesh, and this is a dataset of objects");
    }
    if args.points.points.is_some() {
        bail!("--points measures a single scene's mesh, and this is a dataset of objects");
    }
    if args.depth_maps {
        bail!("--depth-maps measures what a single scene's run started from, and this is a dataset of objects");
    }
    Ok(())
}

fn of_mesh(args: &EvalArgs, mesh: &Path, cancellation: &Cancellation) -> Result<Report> {
    if args.depth_maps {
        bail!("--depth-maps measures what a run started from, and this is a mesh");
    }
    refuse_metres(mesh)?;
    let textured = read_mesh(mesh)?;
    let Some(data) = &args.data else {
        let points = score_by_points(&args.points, &textured.mesh, None, false)?;
        let dtu = score_by_dtu(args, &textured.mesh, None)?;
        if points.is_none() && dtu.is_none() {
            bail!(
                "a mesh is measured against a scene, points or a scan: give them with --data, --points, or --protocol and \
                 --reference"
            );
        }
        let (mesh, shape) = (MeshFacts::of(&textured.mesh, cancellation)?, ShapeEvaluation::default());
        return Ok(Report {
            scene: None,
            mesh,
            shape,
            views: Vec::new(),
            pictures_of: None,
            points,
            depth_maps: None,
            dtu,
        });
    };
    let options = ReadOptions { cancellation: cancellation.clone(), ..args.reading.read_options() };
    let mut scene = read_scene(data, &options)?;
    let points = score_by_points(&args.points, &textured.mesh, Some(&scene), false)?;
    let dtu = score_by_dtu(args, &textured.mesh, Some(&scene))?;
    let textured = textured.transformed(&scene.object_to_world.inverse());
    let shape = evaluate_shape(&textured.mesh, &scene.ground_truth, &cameras_of(&scene), args.seed)?;
    let parts = scene.hold_out(HOLD_OUT_EVERY);
    let views = if args.no_views {
        Vec::new()
    } else {
        eprintln!("views as a run with the default settings divides them: {parts}");
        rendered(&MeshShader::textured(&textured), &with_masks(&ViewSplit::of(&scene)?.test)?, cancellation)?
    };
    let mesh = MeshFacts::of(&textured.mesh, cancellation)?;
    Ok(Report { scene: Some(scene.name), mesh, shape, views, pictures_of: None, points, depth_maps: None, dtu })
}

/// The views, all of which have masks: figures over some of them would pass for those of all.
fn with_masks<'a>(views: &[&'a View]) -> Result<Vec<&'a View>> {
    let without = views.iter().filter(|view| view.mask.is_none());
    let without: Vec<String> = without.map(|view| view.name.clone()).collect();
    if !without.is_empty() {
        let missing = anyhow::Error::from(dvr_core::Error::MasksMissing { views: without });
        return Err(missing.context("views that are measured (--no-views measures the shape alone)"));
    }
    Ok(views.to_vec())
}

fn of_run(args: &EvalArgs, subject: &Path, checkpoint: &Checkpoint, cancellation: &Cancellation) -> Result<Report> {
    refuse_other_reading(&args.reading, checkpoint)?;
    let scene: Scene = scene_of_run(checkpoint, args.data.as_ref(), args.reading.memory, cancellation)?;
    let device = args.backend.backend.device()?;
    memory::limit(&device, args.reading.memory);
    let model = load_model(checkpoint, None, &device)?;
    let options = mesh_options(&args.meshing, SCENE_RESOLUTION, cancellation).following(model.cells());
    memory::check_extraction(&options.extraction, &device, args.reading.memory)?;
    print_notes(&scene.warnings);
    let split = ViewSplit::of(&scene)?;
    let seeds = surface_points(model.thorough_shader().as_ref(), &split.train, 2_000);
    // Photographs tell which small pieces stay; colours are not looked at.
    let options = MeshOptions { colors: ColorSource::Field, ..options }.of_run(&checkpoint.header);
    let mesh = match object_mesh(model.as_ref(), &options, &seeds, &split.train) {
        Ok(extracted) => extracted.mesh,
        Err(Error::NoMesh(reason)) => {
            eprintln!("note: {reason}");
            Mesh::default()
        }
        Err(other) => return Err(other.into()),
    };
    let shape = evaluate_shape(&mesh, &scene.ground_truth, &cameras_of(&scene), args.seed)?;
    let (mut views, mut views_of) = (Vec::new(), None);
    if !args.no_views {
        let pictures = pictures_of(subject)?;
        views_of = Some(pictures.as_ref().map_or(PicturesOf::Field, RunPictures::of));
        let shader = model.shader(args.samples as usize);
        views = match &pictures {
            Some(found) => found.show(shader.as_ref(), |shader| rendered(shader, &split.test, cancellation))?,
            None => rendered(shader.as_ref(), &split.test, cancellation)?,
        };
    }
    let trained_on_points = method_of(&checkpoint.header.method)?.needs().sparse_points;
    let in_world = world_mesh(&mesh, &scene.object_to_world);
    let points = score_by_points(&args.points, &in_world, Some(&scene), trained_on_points)?;
    let dtu = score_by_dtu(args, &in_world, Some(&scene))?;
    let mut depth_maps = None;
    if args.depth_maps {
        let maps = method_of(&checkpoint.header.method)?.stereo_depths(&split.train, cancellation)?;
        let verified = verified_points(&args.points, &scene)?;
        depth_maps = DepthMapsEvaluation::new(&maps, &scene, verified.as_ref(), &in_world, &settings(&args.points));
        if depth_maps.is_none() {
            bail!("this run started from no depth maps: --depth-maps has nothing to measure");
        }
    }
    let mesh = MeshFacts::of(&mesh, cancellation)?;
    Ok(Report { scene: Some(scene.name), mesh, shape, views, pictures_of: views_of, points, depth_maps, dtu })
}

fn cameras_of(scene: &Scene) -> Vec<&Camera> {
    scene.views.iter().map(|view| &view.camera).collect()
}

fn rendered(shader: &dyn Shader, views: &[&View], cancellation: &Cancellation) -> Result<Vec<ViewEvaluation>> {
    let mut progress = Progress::new();
    progress.phase("rendering test views", views.len());
    Ok(evaluate_views(shader, views, cancellation, |done| progress.progress(done, ""))?)
}

/// Prints the views' figures and their means.
fn print_views(views: &[ViewEvaluation], of: Option<PicturesOf>) {
    if views.is_empty() {
        return;
    }
    let of = of.map_or(String::new(), |of| format!(" of the {of}"));
    println!("test views{of} (both pictures on white)");
    println!("  {:<22}{:>9}{:>9}{:>9}", "view", "PSNR dB", "SSIM", "mask IoU");
    for view in views {
        println!("  {:<22}{:>9.2}{:>9.4}{:>9.4}", view.view, view.psnr, view.ssim, view.mask_iou);
    }
    let mean = |part: fn(&ViewEvaluation) -> f64| views.iter().map(part).sum::<f64>() / views.len() as f64;
    println!("  {:<22}{:>9.2}{:>9.4}{:>9.4}", "mean", mean(|v| v.psnr), mean(|v| v.ssim), mean(|v| v.mask_iou));
}
