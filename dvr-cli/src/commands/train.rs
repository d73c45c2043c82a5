//! `dvr train`: the whole job.

use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, bail};
use burn::tensor::Device;
use cpu_time::ProcessTime;
use dvr_core::dataset::{Format, is_object_dataset, write_transforms};
use dvr_core::{Camera, Scene, Split, View};
use dvr_report::SourceRun;
use dvr_train::{
    Capacity, Checkpoint, GridConfig, Method, ObjectsConfig, Observer, OriginalConfig, RefinedCameras, RunFolder,
    RunMetrics, RunOptions, Stop, Supervision, TrainConfig, Trained, ViewMetrics, ViewSplit, finish, refine_cameras,
    train,
};

use super::{SCENE_RESOLUTION, SceneReading, mesh_options, print_notes, refinement_notes, scene_of_run, train_objects};
use crate::EXIT_INTERRUPTED;
use crate::args::{CapacityArg, MethodName, TrainArgs};
use crate::commands::eval::print_shape;
use crate::commands::report::write_report;
use crate::memory::limit_training;
use crate::progress::Progress;

/// Set by Ctrl-C.
pub(super) static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Reconstructs a scene, or learns from a dataset, as the path and the arguments say.
pub fn run(args: &TrainArgs) -> Result<ExitCode> {
    let dataset = match &args.scene {
        Some(path) if args.reading.format.is_none_or(|format| format == Format::Dvr) => is_object_dataset(path)?,
        _ => false,
    };
    if args.print_config {
        println!("{}", configuration(args, dataset)?.to_json()?);
        return Ok(ExitCode::SUCCESS);
    }
    let Some(out) = &args.out else { bail!("no output folder was given: add --out DIR") };
    let folder = RunFolder::new(out);
    let resumed = args.resume.then(|| Checkpoint::load(&folder.last())).transpose()?;
    let method = match &resumed {
        Some(checkpoint) => checkpoint.header.method.clone(),
        None => configuration(args, dataset)?,
    };
    match method {
        Method::Objects(config) => train_objects::run(args, &folder, config, resumed.as_ref()),
        method => train_scene(args, &folder, method, resumed.as_ref()),
    }
}

/// Trains, then writes mesh, preview and figures.
fn train_scene(args: &TrainArgs, folder: &RunFolder, config: Method, resumed: Option<&Checkpoint>) -> Result<ExitCode> {
    if matches!(config, Method::Grid(_)) && !args.more_devices().is_empty() {
        bail!("several --devices train networks: --method network or classic, and datasets of objects");
    }
    let device = args.backend().training_device(&config)?;
    limit_training(&device, args.reading.memory, &config)?;
    let (mut scene, reading) = match resumed {
        Some(checkpoint) => {
            (scene_of_run(checkpoint, args.scene.as_ref(), args.reading.memory)?, checkpoint.header.reading.clone())
        }
        None => {
            let Some(path) = &args.scene else { bail!("no scene was given") };
            let reading = SceneReading::of_arguments(&args.reading);
            let (scene, refined) = reading.read(path)?;
            print_notes(&refinement_notes(&refined));
            (scene, serde_json::to_value(reading)?)
        }
    };
    scene.require_masks()?;
    check_supervision(&scene, &config)?;
    describe(&scene, &config)?;
    prepare(folder, args, &config)?;
    let mut options: RunOptions = run_options(args, folder, reading, device.clone())?;
    let mut progress = Progress::new();
    let cpu = ProcessTime::now();
    if resumed.is_none() && config.refine_cameras() > 0 {
        let Some(refined) = refine(&mut scene, &config, folder, &mut progress)? else {
            eprintln!("stopped before training began: there is nothing to continue");
            return Ok(ExitCode::from(EXIT_INTERRUPTED));
        };
        options.refined = Some(refined);
    }
    if args.follow_shape {
        options.truth = scene.ground_truth.surface.as_ref();
        if options.truth.is_none() {
            eprintln!("note: the scene's true surface is not known, and --follow-shape has nothing to compare with");
        }
    }
    let trained = train(&scene, config, resumed, &options, &mut progress)?;
    let cpu_seconds = cpu.elapsed().as_secs_f64();
    if trained.stop == Stop::Interrupted {
        return Ok(interrupted(&trained, folder));
    }
    let metrics =
        finish(&scene, &trained, folder, &mesh_options(&args.meshing, SCENE_RESOLUTION), &device, &mut progress)?;
    if !args.no_report {
        progress.phase("report", 1);
        let run = SourceRun { folder: folder.clone(), header: trained.checkpoint.header, scene: Some(&scene) };
        write_report(&[run], &folder.report())?;
        progress.progress(1, "");
    }
    report(&metrics, folder, trained.seconds, cpu_seconds);
    if metrics.mesh.is_none() {
        bail!("there is no mesh: the field has no surface. Check masks and cameras with `dvr info`");
    }
    Ok(ExitCode::SUCCESS)
}

/// Moves the cameras to where they fit together, and writes them down; `None` after Ctrl-C.
fn refine(
    scene: &mut Scene,
    method: &Method,
    folder: &RunFolder,
    progress: &mut Progress,
) -> Result<Option<RefinedCameras>> {
    let config = match method {
        Method::Grid(config) => config.clone(),
        other => GridConfig {
            seed: other.seed(),
            hold_out_every: other.hold_out_every(),
            ..GridConfig::new(other.supervision())
        },
    };
    let refined = refine_cameras(scene, &config, method.refine_cameras(), &INTERRUPTED, progress)?;
    if refined.as_ref().is_some_and(|refined| !refined.cameras.is_empty()) {
        let in_world = |view: &View| (view.name.clone(), view.camera.into_world(&scene.object_to_world));
        let cameras: Vec<(String, Camera)> = scene.views.iter().map(in_world).collect();
        write_transforms(&folder.cameras(), cameras.iter().map(|(name, camera)| (name.as_str(), camera)))?;
    }
    Ok(refined)
}

/// How a run is carried out; from here on, Ctrl-C saves.
pub(super) fn run_options(
    args: &TrainArgs,
    folder: &RunFolder,
    reading: serde_json::Value,
    device: Device,
) -> Result<RunOptions<'static>> {
    interrupt_on_ctrl_c()?;
    Ok(RunOptions {
        folder: folder.clone(),
        device,
        helpers: args.more_devices().iter().map(|backend| backend.device()).collect::<Result<_>>()?,
        reading,
        time_limit: args.time,
        refined: None,
        truth: None,
        interrupted: &INTERRUPTED,
    })
}

/// What to say, and to exit with, after Ctrl-C.
pub(super) fn interrupted(trained: &Trained, folder: &RunFolder) -> ExitCode {
    eprintln!(
        "stopped after step {}; everything is saved. Continue with: dvr train --resume --out {}",
        trained.steps,
        folder.root().display()
    );
    ExitCode::from(EXIT_INTERRUPTED)
}

/// The method and configuration that the arguments ask for.
fn configuration(args: &TrainArgs, dataset: bool) -> Result<Method> {
    let supervision = args.supervision.unwrap_or_default();
    let mut config = match (dataset, args.method) {
        (false, None | Some(MethodName::Grid)) => Method::Grid(grid_configuration(args, supervision)),
        (false, Some(MethodName::Hull)) => Method::Grid(GridConfig::hull()),
        (false, Some(MethodName::Network)) => Method::Network(TrainConfig::new(supervision)),
        (false, Some(MethodName::Classic)) => Method::Network(TrainConfig::classic(supervision)),
        (true, None | Some(MethodName::Network)) => Method::Objects(ObjectsConfig::new(supervision)),
        (true, Some(MethodName::Classic)) => Method::Objects(ObjectsConfig::classic(supervision)),
        (true, Some(MethodName::Grid | MethodName::Hull)) => {
            bail!(
                "a dataset of many objects takes --method network or classic; grid and hull reconstruct one scene each"
            )
        }
    };
    let objects = &args.objects;
    if !dataset && (!objects.categories.is_empty() || objects.inputs.is_some() || objects.pretrained.is_some()) {
        bail!("--categories, --inputs and --pretrained are for datasets of many objects, and this is a single scene");
    }
    let is_grid = !dataset && args.method.is_none_or(|method| method == MethodName::Grid);
    if !is_grid && (args.capacity.is_some() || args.max_bytes.is_some()) {
        bail!("--capacity and --max-bytes belong to --method grid");
    }
    if let Some(path) = &args.config {
        config = if path.extension().is_some_and(|ending| ending == "yaml" || ending == "yml") {
            of_the_original(path, args, dataset)?
        } else {
            let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
            let json = serde_json::from_str(&text).with_context(|| format!("{} is no JSON", path.display()))?;
            config.overridden(&json).with_context(|| path.display().to_string())?
        };
    }
    match (&mut config, args.refine_cameras) {
        (_, None) => {}
        (Method::Grid(config), Some(rounds)) => config.refine_cameras = rounds,
        (Method::Network(config), Some(rounds)) => config.refine_cameras = rounds,
        (Method::Objects(_), Some(_)) => bail!("--refine-cameras is for a single scene, and this is a dataset of many"),
    }
    if let (Method::Objects(config), Some(path)) = (&mut config, &objects.pretrained) {
        config.pretrained = Some(path.clone());
    }
    // One after the other they might make no sense, though together they do.
    let mut overrides = serde_json::json!({});
    for assignment in &args.set {
        let Some((key, value)) = assignment.split_once('=') else {
            bail!("--set {assignment}: write KEY=VALUE, e.g. --set rays=512");
        };
        // What is no JSON is taken as a string, so that `--set occupancy_point=random` needs no quotes.
        let value = serde_json::from_str(value).unwrap_or_else(|_| serde_json::Value::String(value.to_owned()));
        let parts: Vec<&str> = key.split('.').collect();
        let mut place = &mut overrides;
        for part in parts {
            if !place.is_object() {
                *place = serde_json::json!({});
            }
            place = &mut place[part];
        }
        *place = value;
    }
    let config = config.overridden(&overrides).with_context(|| format!("--set {}", args.set.join(" --set ")))?;
    let config = config.with(args.seed, args.steps);
    config.check()?;
    Ok(config)
}

/// The method that a YAML configuration of the original describes.
fn of_the_original(path: &Path, args: &TrainArgs, dataset: bool) -> Result<Method> {
    if args.method.is_some() || args.supervision.is_some() {
        bail!("{} says method and supervision: leave --method and --supervision away", path.display());
    }
    let original = OriginalConfig::read(path)?;
    print_notes(&original.notes);
    if !original.reading.ignored_views.is_empty() {
        let views = original.reading.ignored_views.join(",");
        print_notes(&[format!("data.ignore_image_idx is left to you: --ignore {views}")]);
    }
    if original.reading.visual_hull_depth {
        print_notes(&["data.depth_from_visual_hull is left to you: --visual-hull-depth".into()]);
    }
    match (original.method(), dataset) {
        (Method::Objects(_), false) => {
            bail!("{} is for a dataset of many objects, and this is a single scene", path.display())
        }
        (Method::Network(_), true) => {
            bail!("{} is for a single scene, and this is a dataset of many objects", path.display())
        }
        (method, _) => Ok(method),
    }
}

/// The grid method with the capacity that was asked for.
fn grid_configuration(args: &TrainArgs, supervision: Supervision) -> GridConfig {
    let mut config = GridConfig::new(supervision);
    if let Some(CapacityArg::Cells(cells)) = args.capacity {
        config.capacity = Capacity::Cells(cells);
        config.first_cells = config.first_cells.min(cells);
    }
    config.max_bytes = args.max_bytes.unwrap_or(0);
    config
}

/// Refuses depth supervision where nothing was measured.
fn check_supervision(scene: &Scene, method: &Method) -> Result<()> {
    let has_depth = scene.views_of(Split::Train).any(|view| view.depth.is_some());
    if method.depth_weight() > 0.0 && !has_depth {
        bail!(
            "supervision {} needs depth maps, and scene {:?} has none. Use --supervision rgb",
            method.supervision(),
            scene.name
        );
    }
    if let Method::Network(config) = method
        && config.losses.sparse_depth > 0.0
        && scene.sparse_points.is_none()
    {
        bail!("losses.sparse_depth needs sparse points, and scene {:?} has none. Set it to 0", scene.name);
    }
    Ok(())
}

/// Makes the run's folder and writes the configuration into it.
pub(super) fn prepare(folder: &RunFolder, args: &TrainArgs, method: &Method) -> Result<()> {
    if args.resume {
        return Ok(());
    }
    if args.overwrite {
        folder.clear()?;
    }
    folder.create()?;
    let json = method.to_json()?;
    Ok(dvr_core::files::write_bytes_atomically(&folder.config(), json.as_bytes())?)
}

/// What is about to happen, in three lines.
fn describe(scene: &Scene, method: &Method) -> Result<()> {
    let split = ViewSplit::new(scene, method.hold_out_every())?;
    let size = scene.views.first().map_or((0, 0), |view| view.image.dimensions());
    eprintln!(
        "{} ({}): {} views of {}x{} ({} to train on, {} held out, {} for testing), supervision {}",
        scene.name,
        scene.format,
        scene.views.len(),
        size.0,
        size.1,
        split.train.len(),
        split.held_out.len(),
        scene.views_of(Split::Test).count(),
        method.supervision(),
    );
    print_notes(&scene.warnings);
    Ok(())
}

/// The first Ctrl-C asks for a clean stop, the second ends the program.
pub(super) fn interrupt_on_ctrl_c() -> Result<()> {
    ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::Relaxed) {
            std::process::exit(i32::from(EXIT_INTERRUPTED));
        }
        eprintln!("\nstopping after this step (Ctrl-C again to stop at once)");
    })
    .context("Ctrl-C cannot be caught")
}

/// The results, for people.
fn report(metrics: &RunMetrics, folder: &RunFolder, seconds: f64, cpu_seconds: f64) {
    print_notes(&metrics.warnings);
    println!("trained {} steps in {seconds:.1} s ({cpu_seconds:.1} CPU s), seed {}", metrics.steps, metrics.seed);
    for (what, view_metrics) in [("field", &metrics.held_out), ("mesh", &metrics.held_out_mesh)] {
        if let Some(ViewMetrics { psnr, mask_iou, pixels }) = view_metrics {
            println!("held-out views, {what:<5}: PSNR {psnr:.2} dB, silhouette IoU {mask_iou:.3} ({pixels} pixels)");
        }
    }
    print_shape(&metrics.shape);
    if let Some([vertices, faces]) = metrics.mesh {
        println!("mesh: {vertices} vertices, {faces} faces");
    }
    let files = [
        folder.mesh_ply(),
        folder.mesh_glb(),
        folder.scene_file(),
        folder.cameras(),
        folder.preview(),
        folder.metrics_json(),
        folder.report(),
    ];
    for path in files.iter().filter(|path| path.exists()) {
        println!("wrote {}", path.display());
    }
}
