//! `dvr render`: renders of a run.

use std::io;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use dvr_core::Cancellation;
use dvr_core::files::{
    Claim, FolderKind, OutputFolder, write_atomically, write_depth_exr, write_rgb_exr, write_rgb_png,
};
use dvr_core::{Camera, Similarity};
use dvr_render::{Rendering, render_view};
use dvr_train::preview::{normal_picture, orbit_camera, to_rgb8};
use dvr_train::{Checkpoint, Observer};
use glam::DVec3;
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbImage};

use super::{load_model, load_run, print_notes, scene_of_run};
use crate::args::{Animation, Cameras, RenderArgs, UpAxis};
use crate::memory;
use crate::progress::Progress;

/// The animation of an orbit.
const TURNTABLE: &str = "turntable.gif";

/// Frames per second of the turntable.
const FRAMES_PER_SECOND: u32 = 18;

/// Renders and writes.
pub fn run(args: &RenderArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let claim = if args.overwrite { Claim::Replace } else { Claim::New };
    OutputFolder::check::<&str>(&args.out, FolderKind::Renders, claim, &[])?;
    let checkpoint = load_run(&args.run)?;
    let device = args.backend.backend.device_for(dvr_train::method_of(&checkpoint.header.method)?.as_ref())?;
    memory::limit(&device, args.memory.memory);
    let model = load_model(&checkpoint, args.object, &device)?;
    let object_to_world = checkpoint.header.object_to_world;
    let needs_scene = args.cameras == Cameras::Dataset || (args.up.is_none() && args.cameras == Cameras::Orbit);
    let scene = if needs_scene {
        Some(scene_of_run(&checkpoint, args.data.as_ref(), args.memory.memory, cancellation))
    } else {
        None
    };
    let cameras: Vec<(String, Camera)> = match args.cameras {
        Cameras::Dataset => {
            let scene = scene.context("the dataset's views need its scene")??;
            print_notes(&scene.warnings);
            print_parts(&checkpoint);
            scene.views.into_iter().map(|view| (view.name, view.camera)).collect()
        }
        Cameras::Orbit => {
            let up = match args.up {
                Some(axis) => axis_vector(axis),
                None => scene.and_then(Result::ok).map_or(DVec3::Y, |scene| scene.up()),
            };
            orbit(args, up)
        }
    };
    cancellation.check()?;
    memory::check_rendering(cameras.iter().map(|(_, camera)| camera), &device, args.memory.memory)?;
    let _writing = OutputFolder::claim(&args.out, FolderKind::Renders, claim, &file_names(args, &cameras))?;
    let shader = model.shader(args.samples as usize);
    let mut progress = Progress::new();
    progress.phase("rendering", cameras.len());
    let mut render = |film: &mut dyn FnMut(RgbImage) -> Result<()>| -> Result<()> {
        for (i, (name, camera)) in cameras.iter().enumerate() {
            cancellation.check()?;
            let rendering = render_view(shader.as_ref(), camera);
            let picture = to_rgb8(&rendering.color);
            write_frame(&args.out, name, args, camera, &rendering, &picture, &object_to_world)?;
            film(picture)?;
            progress.progress(i + 1, name);
        }
        Ok(())
    };
    if has_turntable(args) {
        let path = args.out.join(TURNTABLE);
        write_turntable(&path, render)?;
        println!("wrote {}", path.display());
    } else {
        render(&mut |_| Ok(()))?;
    }
    println!("wrote {} images to {}", cameras.len(), args.out.display());
    Ok(ExitCode::SUCCESS)
}

/// The files that will be written, within the folder.
fn file_names(args: &RenderArgs, cameras: &[(String, Camera)]) -> Vec<String> {
    let exr = args.exr.then_some([".exr", "_depth.exr"]);
    let endings = [".png"].into_iter().chain(args.normals.then_some("_normal.png")).chain(exr.into_iter().flatten());
    let endings: Vec<&str> = endings.collect();
    let turntable = has_turntable(args).then(|| TURNTABLE.to_owned());
    let frames = cameras.iter().flat_map(|(name, _)| endings.iter().map(move |ending| format!("{name}{ending}")));
    frames.chain(turntable).collect()
}

fn has_turntable(args: &RenderArgs) -> bool {
    args.cameras == Cameras::Orbit && args.animation == Animation::Gif
}

/// Which of the run's views were trained on.
fn print_parts(checkpoint: &Checkpoint) {
    if let Some(views) = &checkpoint.header.views {
        eprintln!("the run's views: {views}");
    }
}

/// Writes the files of one frame.
fn write_frame(
    folder: &Path,
    name: &str,
    args: &RenderArgs,
    camera: &Camera,
    rendering: &Rendering,
    picture: &RgbImage,
    object_to_world: &Similarity,
) -> Result<()> {
    write_rgb_png(&folder.join(format!("{name}.png")), picture)?;
    if args.normals {
        write_rgb_png(&folder.join(format!("{name}_normal.png")), &normal_picture(rendering, camera))?;
    }
    if args.exr {
        write_rgb_exr(&folder.join(format!("{name}.exr")), &rendering.color)?;
        let depth = rendering.depth.clone().scaled(object_to_world.scale as f32);
        write_depth_exr(&folder.join(format!("{name}_depth.exr")), &depth)?;
    }
    Ok(())
}

/// Cameras on a circle around the object, which is completely in the frame.
fn orbit(args: &RenderArgs, up: DVec3) -> Vec<(String, Camera)> {
    let camera = |i| orbit_camera(args.size, 360.0 * f64::from(i) / f64::from(args.frames), args.elevation, up);
    (0..args.frames).map(|i| (format!("orbit_{i:04}"), camera(i))).collect()
}

fn axis_vector(axis: UpAxis) -> DVec3 {
    match axis {
        UpAxis::X => DVec3::X,
        UpAxis::Y => DVec3::Y,
        UpAxis::Z => DVec3::Z,
        UpAxis::MinusX => DVec3::NEG_X,
        UpAxis::MinusY => DVec3::NEG_Y,
        UpAxis::MinusZ => DVec3::NEG_Z,
    }
}

/// Writes a GIF that repeats without end; `render` hands its frames on one by one, and none is kept.
fn write_turntable(
    path: &Path,
    mut render: impl FnMut(&mut dyn FnMut(RgbImage) -> Result<()>) -> Result<()>,
) -> Result<()> {
    // What fails in a frame is no failure of this file.
    let mut failure = None;
    let written = write_atomically(path, |file| {
        let mut encoder = GifEncoder::new_with_speed(file, 10);
        encoder.set_repeat(Repeat::Infinite).map_err(io::Error::other)?;
        let rendered = render(&mut |frame| {
            let rgba = image::DynamicImage::ImageRgb8(frame).into_rgba8();
            let delay = Delay::from_numer_denom_ms(1000, FRAMES_PER_SECOND);
            Ok(encoder.encode_frame(Frame::from_parts(rgba, 0, 0, delay))?)
        });
        rendered.map_err(|error| {
            failure = Some(error);
            io::Error::other("a frame failed")
        })
    });
    match failure {
        Some(error) => Err(error),
        None => Ok(written?),
    }
}
