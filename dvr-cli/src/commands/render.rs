//! `dvr render`: pictures of a run, or of a mesh.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use dvr_core::dataset::{ReadOptions, read_scene, write_transforms};
use dvr_core::files::{Claim, FolderKind, OutputFolder, write_depth_exr, write_rgb_exr, write_rgb_png};
use dvr_core::mesh::read_mesh_with_warnings;
use dvr_core::{Camera, Cancellation, Scene, Similarity};
use dvr_render::{MeshShader, Rendering, Shader, render_view};
use dvr_train::preview::{normal_picture, orbit_camera, to_rgb8};
use dvr_train::{Checkpoint, Observer};
use glam::DVec3;
use image::RgbImage;

use super::real_size::refuse_metres;
use super::stored_run::{is_mesh, pictures_of};
use super::turntable::Turntable;
use super::{load_model, load_run, print_notes, scene_of_run};
use crate::args::{Cameras, RenderArgs, UpAxis, ViewColorChoice};
use crate::backend::Backend;
use crate::memory;
use crate::progress::Progress;

/// The cameras of the pictures.
const CAMERAS: &str = "transforms.json";

/// Names of an orbit's frames, as `printf` has them.
const ORBIT_PATTERN: &str = "orbit_%04d.png";

/// Longest edge in the object cube of a mesh whose scene is not given, as in datasets of rendered meshes.
const MESH_EDGE: f64 = 0.9;

/// Renders and writes.
pub fn run(args: &RenderArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let claim = if args.overwrite { Claim::Replace } else { Claim::New };
    OutputFolder::check::<&str>(&args.out, FolderKind::Renders, claim, &[])?;
    let turntable = Turntable::of(args, cancellation)?;
    if is_mesh(&args.subject) {
        of_mesh(args, claim, &turntable, cancellation)?;
    } else {
        of_run(args, claim, &turntable, cancellation)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn of_run(args: &RenderArgs, claim: Claim, turntable: &Turntable, cancellation: &Cancellation) -> Result<()> {
    let checkpoint = load_run(&args.subject)?;
    let pictures = if args.object.is_none() { pictures_of(&args.subject)? } else { None };
    let pictures = pictures.map(|pictures| match args.view_color {
        ViewColorChoice::On => pictures,
        ViewColorChoice::Off => pictures.without_view_color(),
    });
    if args.backend.backend != Backend::Cpu && pictures.as_ref().is_some_and(|pictures| pictures.of().is_mesh()) {
        eprintln!("note: pictures are of the run's mesh, which rays meet on the CPU");
    }
    let device = args.backend.backend.device()?;
    memory::limit(&device, args.memory.memory);
    let model = load_model(&checkpoint, args.object, &device)?;
    let needs_scene = args.cameras == Cameras::Dataset || (args.up.is_none() && args.cameras == Cameras::Orbit);
    let scene = if needs_scene {
        Some(scene_of_run(&checkpoint, args.data.as_ref(), args.memory.memory, cancellation))
    } else {
        None
    };
    let cameras = match args.cameras {
        Cameras::Dataset => {
            let scene = scene.context("the dataset's views need its scene")??;
            print_notes(&scene.warnings);
            print_parts(&checkpoint);
            cameras_of(scene)
        }
        Cameras::Orbit => orbit(args, scene.and_then(Result::ok).as_ref()),
    };
    cancellation.check()?;
    memory::check_rendering(cameras.iter().map(|(_, camera)| camera), &device, args.memory.memory)?;
    let shots = Shots { cameras, object_to_world: checkpoint.header.object_to_world };
    let shader = model.shader(args.samples as usize);
    match &pictures {
        Some(found) => found.show(shader.as_ref(), |shader| shots.write(shader, args, claim, turntable, cancellation)),
        None => shots.write(shader.as_ref(), args, claim, turntable, cancellation),
    }
}

/// A mesh of the world of a scene's files, with its textures or the colours of its vertices. Without the scene, its own
/// extent is the object space, and +y is up, as in glTF.
fn of_mesh(args: &RenderArgs, claim: Claim, turntable: &Turntable, cancellation: &Cancellation) -> Result<()> {
    if args.object.is_some() {
        bail!("--object chooses an object of a run, and this is a mesh");
    }
    if args.data.is_some() {
        refuse_metres(&args.subject)?;
    }
    let mut warnings = Vec::new();
    let textured = read_mesh_with_warnings(&args.subject, &mut warnings)?;
    let scene = match &args.data {
        Some(data) => {
            let max_memory = args.memory.memory;
            let options = ReadOptions { max_memory, cancellation: cancellation.clone(), ..ReadOptions::default() };
            let scene = read_scene(data, &options)?;
            warnings.extend(scene.warnings.iter().cloned());
            Some(scene)
        }
        None => None,
    };
    print_notes(&warnings);
    let (textured, object_to_world) = match &scene {
        Some(scene) => (textured.transformed(&scene.object_to_world.inverse()), scene.object_to_world),
        None => textured.normalized(MESH_EDGE).with_context(|| args.subject.display().to_string())?,
    };
    let cameras = match args.cameras {
        Cameras::Dataset => cameras_of(scene.context("a mesh does not know its scene: give it with --data")?),
        Cameras::Orbit => orbit(args, scene.as_ref()),
    };
    cancellation.check()?;
    if args.backend.backend != Backend::Cpu {
        eprintln!("note: rays meet a mesh on the CPU; --backend {} has no effect", args.backend.backend);
    }
    let device = Backend::Cpu.device()?;
    memory::check_rendering(cameras.iter().map(|(_, camera)| camera), &device, args.memory.memory)?;
    let shots = Shots { cameras, object_to_world };
    shots.write(&MeshShader::textured(&textured), args, claim, turntable, cancellation)
}

/// What is rendered: cameras in object space with the names of their pictures.
struct Shots {
    cameras: Vec<(String, Camera)>,
    object_to_world: Similarity,
}

impl Shots {
    fn write(
        &self,
        shader: &dyn Shader,
        args: &RenderArgs,
        claim: Claim,
        turntable: &Turntable,
        cancellation: &Cancellation,
    ) -> Result<()> {
        let _writing = OutputFolder::claim(&args.out, FolderKind::Renders, claim, &self.files(args, turntable))?;
        let in_world =
            |(name, camera): &(String, Camera)| (format!("{name}.png"), camera.into_world(&self.object_to_world));
        let in_world: Vec<(String, Camera)> = self.cameras.iter().map(in_world).collect();
        write_transforms(&args.out.join(CAMERAS), in_world.iter().map(|(file, camera)| (file.as_str(), camera)), None)?;
        let mut progress = Progress::new();
        progress.phase("rendering", self.cameras.len());
        turntable.write(&args.out, ORBIT_PATTERN, |film| {
            for (i, (name, camera)) in self.cameras.iter().enumerate() {
                cancellation.check()?;
                let rendering = render_view(shader, camera);
                let picture = to_rgb8(&rendering.color);
                write_frame(&args.out, name, args, camera, &rendering, &picture, &self.object_to_world)?;
                film(picture)?;
                progress.progress(i + 1, name);
            }
            Ok(())
        })?;
        if let Some(file) = turntable.file() {
            println!("wrote {}", args.out.join(file).display());
        }
        println!("wrote {} images to {}", self.cameras.len(), args.out.display());
        Ok(())
    }

    /// The files that will be written, within the folder.
    fn files(&self, args: &RenderArgs, turntable: &Turntable) -> Vec<String> {
        let exr = args.exr.then_some([".exr", "_depth.exr"]);
        let endings =
            [".png"].into_iter().chain(args.normals.then_some("_normal.png")).chain(exr.into_iter().flatten());
        let endings: Vec<&str> = endings.collect();
        let frames =
            self.cameras.iter().flat_map(|(name, _)| endings.iter().map(move |ending| format!("{name}{ending}")));
        frames.chain([CAMERAS.to_owned()]).chain(turntable.file().map(str::to_owned)).collect()
    }
}

/// The cameras of a scene's views.
fn cameras_of(scene: Scene) -> Vec<(String, Camera)> {
    scene.views.into_iter().map(|view| (view.name, view.camera)).collect()
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

/// Cameras on a circle around the object, which is completely in the frame. Up is what the arguments say, else what it is
/// in the scene.
fn orbit(args: &RenderArgs, scene: Option<&Scene>) -> Vec<(String, Camera)> {
    let up = args.up.map_or_else(|| scene.map_or(DVec3::Y, Scene::up), axis_vector);
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
