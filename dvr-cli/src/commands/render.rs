//! `dvr render`: renders of a run.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use dvr_core::files::{write_bytes_atomically, write_depth_exr, write_rgb_exr, write_rgb_png};
use dvr_core::{Camera, Similarity};
use dvr_render::{Rendering, render_view};
use dvr_train::Observer;
use dvr_train::preview::{normal_picture, orbit_camera, to_rgb8};
use glam::DVec3;
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbImage};

use super::{load_model, load_run, scene_of_run};
use crate::args::{Animation, Cameras, RenderArgs, UpAxis};
use crate::memory;
use crate::progress::Progress;

/// Frames per second of the turntable.
const FRAMES_PER_SECOND: u32 = 18;

/// Renders and writes.
pub fn run(args: &RenderArgs) -> Result<ExitCode> {
    let checkpoint = load_run(&args.run)?;
    let device = args.backend.backend.device_for(dvr_train::method_of(&checkpoint.header.method)?.as_ref())?;
    memory::limit(&device, args.memory.memory);
    let model = load_model(&checkpoint, args.object, &device)?;
    let object_to_world = checkpoint.header.object_to_world;
    let needs_scene = args.cameras == Cameras::Dataset || (args.up.is_none() && args.cameras == Cameras::Orbit);
    let scene =
        if needs_scene { Some(scene_of_run(&checkpoint, args.data.as_ref(), args.memory.memory)) } else { None };
    let cameras: Vec<(String, Camera)> = match args.cameras {
        Cameras::Dataset => {
            let scene = scene.context("the dataset's views need its scene")??;
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
    std::fs::create_dir_all(&args.out).with_context(|| args.out.display().to_string())?;
    let shader = model.shader(args.samples as usize);
    let mut progress = Progress::new();
    progress.phase("rendering", cameras.len());
    let mut frames = Vec::new();
    for (i, (name, camera)) in cameras.iter().enumerate() {
        let rendering = render_view(shader.as_ref(), camera);
        let picture = to_rgb8(&rendering.color);
        write_frame(&args.out, name, args, camera, &rendering, &picture, &object_to_world)?;
        frames.push(picture);
        progress.progress(i + 1, name);
    }
    if args.cameras == Cameras::Orbit && args.animation == Animation::Gif {
        let path = args.out.join("turntable.gif");
        write_bytes_atomically(&path, &turntable(frames)?)?;
        println!("wrote {}", path.display());
    }
    println!("wrote {} images to {}", cameras.len(), args.out.display());
    Ok(ExitCode::SUCCESS)
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

/// A GIF that repeats without end.
fn turntable(frames: Vec<RgbImage>) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = GifEncoder::new_with_speed(&mut bytes, 10);
    encoder.set_repeat(Repeat::Infinite)?;
    for frame in frames {
        let rgba = image::DynamicImage::ImageRgb8(frame).into_rgba8();
        encoder.encode_frame(Frame::from_parts(rgba, 0, 0, Delay::from_numer_denom_ms(1000, FRAMES_PER_SECOND)))?;
    }
    drop(encoder);
    Ok(bytes)
}
