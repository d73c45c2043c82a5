//! `dvr train`: the whole job.

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, bail};
use cpu_time::ProcessTime;
use dvr_core::dataset::read_scene;
use dvr_core::{Scene, Split};
use dvr_train::{Agreement, Checkpoint, RunFolder, RunMetrics, RunOptions, Stop, TrainConfig, finish, train};

use super::{mesh_options, print_notes, scene_of_run};
use crate::EXIT_INTERRUPTED;
use crate::args::{Preset, TrainArgs};
use crate::commands::eval::print_shape;
use crate::progress::Progress;

/// Set by Ctrl-C.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Trains, then writes mesh, preview and figures.
pub fn run(args: &TrainArgs) -> Result<ExitCode> {
    if args.print_config {
        println!("{}", serde_json::to_string_pretty(&configuration(args)?)?);
        return Ok(ExitCode::SUCCESS);
    }
    let Some(out) = &args.out else { bail!("no output folder was given: add --out DIR") };
    let folder = RunFolder::new(out);
    let resumed = args.resume.then(|| Checkpoint::load(&folder.last())).transpose()?;
    let (scene, config, reading) = match &resumed {
        Some(checkpoint) => {
            let scene = scene_of_run(checkpoint, args.scene.as_ref())?;
            (scene, checkpoint.header.config.clone(), checkpoint.header.reading.clone())
        }
        None => {
            let Some(path) = &args.scene else { bail!("no scene was given") };
            let config = configuration(args)?;
            let options = args.reading.read_options();
            (read_scene(path, &options)?, config, serde_json::to_value(options)?)
        }
    };
    check_supervision(&scene, &config)?;
    prepare(&folder, args, &config)?;
    describe(&scene, &config);
    interrupt_on_ctrl_c()?;

    let device = args.backend.backend.device();
    let options = RunOptions {
        folder: folder.clone(),
        device: device.clone(),
        reading,
        time_limit: args.time,
        interrupted: &INTERRUPTED,
    };
    let mut progress = Progress::new();
    let cpu = ProcessTime::now();
    let trained = train(&scene, config, resumed.as_ref(), &options, &mut progress)?;
    let cpu_seconds = cpu.elapsed().as_secs_f64();
    if trained.stop == Stop::Interrupted {
        eprintln!(
            "stopped after step {}; everything is saved. Continue with: dvr train --resume --out {}",
            trained.steps,
            out.display()
        );
        return Ok(ExitCode::from(EXIT_INTERRUPTED));
    }
    let metrics = finish(&scene, &trained.checkpoint, &folder, &mesh_options(&args.meshing), &device, &mut progress)?;
    report(&metrics, &folder, trained.seconds, cpu_seconds);
    if metrics.mesh.is_none() {
        bail!("there is no mesh: the field has no surface. Check masks and cameras with `dvr info`");
    }
    Ok(ExitCode::SUCCESS)
}

/// The configuration that the arguments ask for.
fn configuration(args: &TrainArgs) -> Result<TrainConfig> {
    let supervision = args.supervision.unwrap_or_default();
    let mut config = match args.preset {
        Preset::Default => TrainConfig::new(supervision),
        Preset::Classic => TrainConfig::classic(supervision),
    };
    if let Some(path) = &args.config {
        let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
        let json = serde_json::from_str(&text).with_context(|| format!("{} is no JSON", path.display()))?;
        config = config.overridden(&json).with_context(|| path.display().to_string())?;
    }
    for assignment in &args.set {
        let Some((key, value)) = assignment.split_once('=') else {
            bail!("--set {assignment}: write KEY=VALUE, e.g. --set losses.normal=0.1");
        };
        // What is no JSON is taken as a string, so that `--set occupancy_point=random` needs no quotes.
        let value = serde_json::from_str(value).unwrap_or_else(|_| serde_json::Value::String(value.to_owned()));
        let json = key.rsplit('.').fold(value, |inner, part| serde_json::json!({ part: inner }));
        config = config.overridden(&json).with_context(|| format!("--set {assignment}"))?;
    }
    config.steps = args.steps.unwrap_or(config.steps);
    config.seed = args.seed.unwrap_or(config.seed);
    config.check()?;
    Ok(config)
}

/// Refuses depth supervision where nothing was measured.
fn check_supervision(scene: &Scene, config: &TrainConfig) -> Result<()> {
    let has_depth = scene.views_of(Split::Train).any(|view| view.depth.is_some());
    if config.losses.depth > 0.0 && !has_depth {
        bail!(
            "supervision {} needs depth maps, and scene {:?} has none. Use --supervision rgb",
            config.supervision,
            scene.name
        );
    }
    if config.losses.sparse_depth > 0.0 && scene.sparse_points.is_none() {
        bail!("losses.sparse_depth needs sparse points, and scene {:?} has none. Set it to 0", scene.name);
    }
    Ok(())
}

/// Makes the run's folder and writes the configuration into it.
fn prepare(folder: &RunFolder, args: &TrainArgs, config: &TrainConfig) -> Result<()> {
    if args.resume {
        return Ok(());
    }
    if args.overwrite {
        folder.clear()?;
    }
    folder.create()?;
    let json = serde_json::to_string_pretty(config)?;
    Ok(dvr_core::files::write_bytes_atomically(&folder.config(), json.as_bytes())?)
}

/// What is about to happen, in three lines.
fn describe(scene: &Scene, config: &TrainConfig) {
    let count = |split| scene.views_of(split).count();
    let size = scene.views.first().map_or((0, 0), |view| view.image.dimensions());
    eprintln!(
        "{} ({}): {} views of {}x{} ({} for validation, {} for testing), supervision {}",
        scene.name,
        scene.format,
        scene.views.len(),
        size.0,
        size.1,
        count(Split::Val),
        count(Split::Test),
        config.supervision,
    );
    print_notes(&scene.warnings);
}

/// The first Ctrl-C asks for a clean stop, the second ends the program.
fn interrupt_on_ctrl_c() -> Result<()> {
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
    for (what, agreement) in [("field", &metrics.held_out), ("mesh", &metrics.held_out_mesh)] {
        if let Some(Agreement { psnr, mask_iou, pixels }) = agreement {
            println!("held-out views, {what:<5}: PSNR {psnr:.2} dB, silhouette IoU {mask_iou:.3} ({pixels} pixels)");
        }
    }
    print_shape(&metrics.shape);
    if let Some([vertices, faces]) = metrics.mesh {
        println!("mesh: {vertices} vertices, {faces} faces");
    }
    let files = [folder.mesh_ply(), folder.mesh_glb(), folder.preview(), folder.metrics_json()];
    for path in files.iter().filter(|path| path.exists()) {
        println!("wrote {}", path.display());
    }
}
