//! `dvr train`: the whole job.

use std::borrow::Cow;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, bail};
use cpu_time::ProcessTime;
use dvr_core::dataset::{Format, is_object_dataset};
use dvr_core::files::OutputFolder;
use dvr_core::{Advice, Cancellation, Scene, ViewNames};
use dvr_report::SourceRun;
use dvr_train::{
    Checkpoint, Error, KnownLength, Method, Observer, PicturesOf, RunFolder, RunMetrics, RunOptions, Stop, Support,
    ViewMetrics, finish, train,
};

use super::cameras::{photographs_without_cameras, scene_of_photographs};
use super::depth_table::in_short;
use super::masks::{are_missing, check_program, find, wanted, write};
use super::mesh_line::mesh_line;
use super::method_of_args::method_of_args;
use super::points_table::print_points;
use super::pose_sets::PoseSets;
use super::real_size::{KeptSize, known_lengths};
use super::resumed::resumed_method;
use super::run_start::{RunStart, interrupted, run_options};
use super::shape_table::print_shape;
use super::simplified::simplified_to;
use super::texture::sentence;
use super::{SceneReading, print_notes, refinement_notes, run_mesh_options, scene_of_run, train_objects};
use crate::args::{MasksFrom, SceneArgs, SegmentArg, TrainArgs};
use crate::commands::report::write_report;
use crate::memory::{limit_training, make_room, of_process};
use crate::progress::Progress;

/// Reconstructs a scene, or learns from a dataset, as the path and the arguments say.
pub fn run(args: &TrainArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let is_dataset = match &args.scene {
        Some(path) if args.reading.format.is_none_or(|format| format == Format::DVR) => is_object_dataset(path)?,
        _ => false,
    };
    if let (true, Some(length), Some(path)) = (is_dataset, args.scale.first(), &args.scene) {
        bail!("{}: --scale {} is for one scene, and this is a dataset of objects", path.display(), length.text);
    }
    if args.print_config {
        println!("{}", method_of_args(args, is_dataset)?.record()?.pretty());
        return Ok(ExitCode::SUCCESS);
    }
    let Some(out) = &args.out else { bail!("no output folder was given: add --out DIR") };
    if let (true, false, Some(path)) = (is_dataset, args.more.is_empty(), &args.scene) {
        bail!("{}: this is a dataset of objects, and several sets are photographs of one object", path.display());
    }
    check_program(args.segment.segment.as_ref(), args.reading.masks.as_ref())?;
    if args.drop_support && (is_dataset || args.segment.segment.is_some()) {
        bail!("--drop-support {NEEDS_PLANE}");
    }
    if let (true, Some(_), Some(path)) = (is_dataset, &args.segment.segment, &args.scene) {
        bail!("{}: --segment makes masks of the views of one scene, and this is a dataset of objects", path.display());
    }
    let start = RunStart::new(args, out)?;
    let args = &with_cameras(args, cancellation)?;
    let method = match &start.resumed {
        Some(checkpoint) => resumed_method(args, checkpoint)?,
        None => method_of_args(args, is_dataset)?,
    };
    match method.objects() {
        Some(config) => train_objects::run(args, start, method.as_ref(), config, cancellation),
        None => train_scene(args, start, method.as_ref(), cancellation),
    }
}

/// The arguments with the scene that was made of photographs without cameras, where these are given.
fn with_cameras<'a>(args: &'a TrainArgs, cancellation: &Cancellation) -> Result<Cow<'a, TrainArgs>> {
    if !args.more.is_empty() {
        return Ok(Cow::Owned(joined(args, cancellation)?));
    }
    let Some(path) = args.scene.as_ref().filter(|_| args.reading.format.is_none()) else {
        return Ok(Cow::Borrowed(args));
    };
    let Some(source) = photographs_without_cameras(path)? else { return Ok(Cow::Borrowed(args)) };
    if let Some(length) = args.scale.first() {
        bail!(
            "--scale {}: the cameras of these photographs are not known yet, and known lengths are measured in the pictures that \
             come with them. Run `dvr cameras {}` first and measure there, or give the length to `dvr mesh RUN` afterwards",
            length.text,
            path.display()
        );
    }
    let is_by_program = args.segment.segment.is_some();
    if is_by_program && source.has_mask_folder() {
        // Before their cameras are found, which takes a while.
        bail!("{}: these photographs have a folder of masks: {MASKS_ARE_THERE}", path.display());
    }
    if !is_by_program && !source.has_mask_folder() && args.reading.background.is_none() {
        eprintln!(
            "note: no folder of masks is beside these photographs. Where no picture has an alpha channel, masks are found from \
             all of them, after their cameras"
        );
    }
    let scene =
        scene_of_photographs(&source, path, args.cameras.as_ref(), &args.finding, args.overwrite, cancellation)?;
    Ok(Cow::Owned(TrainArgs { scene: Some(scene), ..args.clone() }))
}

/// The arguments with the scene that several sets of photographs become.
fn joined(args: &TrainArgs, cancellation: &Cancellation) -> Result<TrainArgs> {
    let paths: Vec<PathBuf> = args.scene.iter().chain(&args.more).cloned().collect();
    if let Some(length) = args.scale.first() {
        bail!(
            "--scale {}: known lengths are measured in the pictures of the scene that these sets become. Run `dvr cameras` with \
             them first and train on its folder, or give the length to `dvr mesh RUN` afterwards",
            length.text
        );
    }
    if args.drop_support {
        bail!("--drop-support cuts away an underside that nobody sees, and several poses show it. Leave it out");
    }
    let sets = PoseSets {
        paths: &paths,
        folder: args.cameras.as_ref(),
        finding: &args.finding,
        reading: &args.reading,
        segment: args.segment.segment.as_ref(),
        may_replace: args.overwrite,
    };
    let (folder, found) = sets.join(cancellation)?;
    // Its masks are those of the sets.
    let reading = SceneArgs {
        format: None,
        masks: None,
        background: None,
        background_threshold: None,
        visual_hull_depth: false,
        ..args.reading.clone()
    };
    let segment = SegmentArg { segment: None };
    Ok(TrainArgs { scene: Some(found.scene(&folder)), more: Vec::new(), reading, segment, ..args.clone() })
}

/// Trains, then writes mesh, preview and figures.
fn train_scene(
    args: &TrainArgs,
    mut start: RunStart,
    method: &dyn Method,
    cancellation: &Cancellation,
) -> Result<ExitCode> {
    let device = args.backend().training_device(method)?;
    limit_training(&device, args.reading.memory, method)?;
    let (mut scene, mut reading, mut views) = read(args, start.resumed.as_ref(), method, cancellation)?;
    let lengths = match (&start.resumed, &args.scene) {
        (None, Some(path)) => known_lengths(&args.scale, path, &args.reading.read_options())?,
        (Some(checkpoint), _) => {
            let reading: SceneReading = serde_json::from_value(checkpoint.header.reading.clone())?;
            KeptSize::of(&start.folder, &checkpoint.header)?.lengths(&checkpoint.header.scene, &reading.options)?
        }
        (None, None) => Vec::new(),
    };
    let (mut writing, mut support) = (None, start.resumed.as_ref().and_then(|checkpoint| checkpoint.header.support));
    if start.resumed.is_none() && are_missing(&scene, args.reading.masks.as_ref()) {
        let memory = of_process(&device, args.reading.memory);
        let (taken, masks, plane) = found_masks(&mut scene, args, &lengths, &mut start, method, memory, cancellation)?;
        writing = Some(taken);
        support = plane;
        (scene, reading, views) = read_with(args, Some(masks), method, cancellation)?;
    } else if start.resumed.is_none()
        && let Some(word) = args.reading.masks.as_ref().and_then(MasksFrom::asks_for)
    {
        bail!(
            "{}: --masks {word} makes masks where no view has one, and some have. Leave it out to use these",
            scene.name
        );
    } else if start.resumed.is_none() && args.segment.segment.is_some() {
        let have = scene.views.iter().filter(|view| view.mask.is_some()).count();
        bail!("{}: {have} of {} views have masks: {MASKS_ARE_THERE}", scene.name, scene.views.len());
    }
    scene.require_masks()?;
    if args.drop_support && support.is_none() {
        bail!("{}: --drop-support {NEEDS_PLANE}", scene.name);
    }
    let masks = || scene.views.iter().filter_map(|view| Some((view.name.as_str(), view.training_mask()?)));
    lengths.iter().try_for_each(|length| length.check_masks(masks()))?;
    method.check_scene(&scene)?;
    let has_lengths = !lengths.is_empty();
    let advice = scene.advice(cancellation)?;
    scene.warnings.extend(advice.iter().map(Advice::to_string));
    describe(&scene, &views, method);
    let meshing = run_mesh_options(&args.meshing, args.texture, args.preset, cancellation);
    let (needed, shares) = make_room(&mut scene, method, &meshing, &device, args.reading.memory)?;
    let meshing = meshing.with_texture_within(shares.texture);
    eprintln!(
        "memory: about {} MB, photographs {} MB of it",
        needed.total() / 1_000_000,
        needed.photographs / 1_000_000
    );
    let _writing = match writing {
        Some(taken) => taken,
        None => start.prepare(method)?,
    };
    let (folder, resumed) = (&start.folder, start.resumed.as_ref());
    let options = RunOptions {
        refine_cameras: args.refine_cameras.unwrap_or(0),
        follow_shape: args.follow_shape,
        lengths: Some(lengths),
        support,
        views: Some(views),
        ..run_options(args, folder, reading, device, cancellation)?
    };
    if args.follow_shape && scene.ground_truth.surface.is_none() {
        eprintln!("note: the scene's true surface is not known, and --follow-shape has nothing to compare with");
    }
    let mut progress = Progress::new();
    let cpu = ProcessTime::now();
    let trained = train(&mut scene, method, resumed, &options, &mut progress)?;
    let cpu_seconds = cpu.elapsed().as_secs_f64();
    if trained.outcome.stop == Stop::Interrupted {
        return Ok(interrupted(&trained.outcome, folder));
    }
    let metrics = match finish(&scene, method, &trained, folder, &meshing, &mut progress) {
        Err(Error::Cancelled(_)) => return Ok(interrupted(&trained.outcome, folder)),
        results => results?.metrics,
    };
    if !args.no_report {
        progress.phase("report", 1);
        let run = SourceRun { folder: folder.clone(), header: trained.outcome.header, scene: Some(&scene) };
        write_report(&[run], &folder.report())?;
        progress.progress(1, "");
    }
    report(&metrics, folder, cpu_seconds, args.meshing.surface.remesh);
    if metrics.mesh.is_none() {
        bail!("there is no mesh: the field has no surface. Check masks and cameras with `dvr info`");
    }
    if has_lengths && metrics.real_size.is_none() {
        bail!(
            "{0}: the known lengths could not be measured, and the mesh is in the units of the scene's files. `dvr mesh {0} \
             --scale` takes other pixels",
            folder.root().display()
        );
    }
    Ok(ExitCode::SUCCESS)
}

/// The scene, how it was read, and which views are for what.
fn read(
    args: &TrainArgs,
    resumed: Option<&Checkpoint>,
    method: &dyn Method,
    cancellation: &Cancellation,
) -> Result<(Scene, serde_json::Value, ViewNames)> {
    if let Some(checkpoint) = resumed {
        let scene = scene_of_run(checkpoint, args.scene.as_ref(), args.reading.memory, cancellation)?;
        let views = checkpoint.header.views.clone().unwrap_or_else(|| ViewNames::of(&scene, String::new()));
        return Ok((scene, checkpoint.header.reading.clone(), views));
    }
    read_with(args, None, method, cancellation)
}

/// Why a program for masks is refused.
const MASKS_ARE_THERE: &str =
    "--segment makes masks where no view has one. Leave it out to use these, or move them away";

/// Why a support cannot be dropped.
const NEEDS_PLANE: &str =
    "cuts by the plane that is found together with masks from all views, where no view has one. Leave it out";

/// Finds the masks of a scene that has none, and takes the run's folder to write them into it.
fn found_masks(
    scene: &mut Scene,
    args: &TrainArgs,
    lengths: &[KnownLength],
    start: &mut RunStart,
    method: &dyn Method,
    memory: Option<u64>,
    cancellation: &Cancellation,
) -> Result<(OutputFolder, PathBuf, Option<Support>)> {
    let by = args.segment.segment.as_ref();
    match by {
        Some(command) => eprintln!("{}: no view has a mask; `{command}` makes them", scene.name),
        None if args.reading.masks == Some(MasksFrom::Cube) => {
            eprintln!("{}: what lies in a cube is found from all views together", scene.name);
        }
        None if args.reading.masks == Some(MasksFrom::Off) => {
            eprintln!("{}: object and background are learned together first", scene.name);
        }
        None => eprintln!("{}: no view has a mask; the object is found from all views together", scene.name),
    }
    // Before the folder is taken: a run that is to be replaced stays where nothing is found.
    let found = find(scene, by, wanted(args.reading.masks.as_ref()), memory, cancellation)?;
    if args.drop_support && found.support.is_none() {
        bail!("{}: no plane that the object stands on was found; leave --drop-support out", scene.name);
    }
    let masks = || scene.views.iter().map(|view| view.name.as_str()).zip(&found.masks);
    lengths.iter().try_for_each(|length| length.check_masks(masks()))?;
    let mut writing = start.prepare(method)?;
    let masks = start.folder.masks();
    let part = masks.strip_prefix(start.folder.root())?;
    let place = write(&found.masks, scene, &mut writing, start.folder.root(), part)?;
    print_notes(&[format!(
        "{}. They are in {}: look at them. Edited or not, `--masks` takes that folder (or a copy) in another run. Figures of \
         silhouettes are against them",
        found.summary,
        place.display()
    )]);
    let support = found.support.map(|plane| Support { plane, is_dropped: args.drop_support });
    Ok((writing, place.canonicalize().unwrap_or(place), support))
}

/// The scene that the arguments name, with the masks of a folder where they were found.
fn read_with(
    args: &TrainArgs,
    masks: Option<PathBuf>,
    method: &dyn Method,
    cancellation: &Cancellation,
) -> Result<(Scene, serde_json::Value, ViewNames)> {
    let Some(path) = &args.scene else { bail!("no scene was given") };
    let mut reading = SceneReading::of_arguments(&args.reading);
    reading.segment = args.segment.segment.as_ref().map(ToString::to_string);
    reading.options.masks = masks.or(reading.options.masks);
    reading.options.hold_out_every = method.common().hold_out_every;
    let divide = |scene: &mut Scene| Ok(scene.hold_out(method.common().hold_out_every));
    let (scene, views, refined) = reading.read(path, divide, cancellation)?;
    print_notes(&refinement_notes(&refined));
    Ok((scene, serde_json::to_value(reading)?, views))
}

/// What is about to happen, in three lines.
fn describe(scene: &Scene, views: &ViewNames, method: &dyn Method) {
    let size = scene.views.first().map_or((0, 0), |view| view.image.dimensions());
    eprintln!(
        "{} ({}): {} views of {}x{}, supervision {}",
        scene.name,
        scene.format,
        scene.views.len(),
        size.0,
        size.1,
        method.common().supervision,
    );
    eprintln!("views: {views}");
    print_notes(&scene.warnings);
}

/// The results, for people; `is_remeshed` says whether the mesh has other triangles than the field.
fn report(metrics: &RunMetrics, folder: &RunFolder, cpu_seconds: f64, is_remeshed: bool) {
    print_notes(&metrics.warnings);
    let RunMetrics { steps, training_seconds, seed, .. } = metrics;
    println!("trained {steps} steps in {training_seconds:.1} s ({cpu_seconds:.1} CPU s), seed {seed}");
    if metrics.model_step != metrics.steps {
        println!("the model of step {} stands for the run: its validation is the best", metrics.model_step);
    }
    let chosen = metrics.pictures_of.unwrap_or(PicturesOf::Field);
    let pictures = format!("test views, as `dvr render` shows them ({chosen})");
    let figures = [
        ("test views, field", &metrics.test),
        ("test views, mesh ", &metrics.test_mesh),
        (pictures.as_str(), &metrics.test_pictures),
        ("validation views, field (they guided the run)", &metrics.validation),
    ];
    for (what, view_metrics) in figures {
        if let Some(ViewMetrics { psnr, mask_iou, pixels }) = view_metrics {
            println!("{what}: PSNR {psnr:.2} dB, silhouette IoU {mask_iou:.3} ({pixels} pixels)");
        }
    }
    if let Some([low, high]) = metrics.exposure_stops {
        println!(
            "exposure: {low:+.2} to {high:+.2} stops, corrected; half of each test and validation view tells its own, \
             PSNR is that of the other half"
        );
    }
    print_shape(&metrics.shape);
    if let Some(points) = &metrics.points {
        print_points(points);
    }
    if let Some(depth_maps) = &metrics.depth_maps {
        println!("{}", in_short(depth_maps));
    }
    if let Some([vertices, faces]) = metrics.mesh {
        println!("{}", mesh_line(vertices, faces, metrics.self_intersections.unwrap_or(0)));
        if let Some(simplification) = &metrics.simplification {
            println!("{}", simplified_to(faces, simplification, is_remeshed));
        }
    }
    if let Some(support) = &metrics.support {
        println!("support plane: {support}");
    }
    if let Some(size) = &metrics.real_size {
        println!("real size: {size}");
    }
    if let Some(texture) = &metrics.texture {
        let seconds = metrics.finishing_seconds.iter().find(|(part, _)| part == "texture").map_or(0.0, |(_, s)| *s);
        println!("{}; made in {seconds:.1} s", sentence(texture));
    }
    let files = [
        folder.mesh_ply(),
        folder.mesh_glb(),
        folder.scene_file(),
        folder.view_color(),
        folder.cameras(),
        folder.preview(),
        folder.metrics_json(),
        folder.report(),
    ];
    for path in files.iter().filter(|path| path.exists()) {
        println!("wrote {}", path.display());
    }
}
