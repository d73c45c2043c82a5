//! What a run leaves for its user: mesh, preview sheet, figures.

use std::time::Instant;

use dvr_core::mesh::{Mesh, write_mesh};
use dvr_core::{Ray, Scene, Split, View};
use dvr_render::extract::Extraction;
use dvr_render::{MeshShader, Shaded, Shader};
use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::evaluate::{ShapeEvaluation, evaluate_shape};
use crate::export::mesh::{MeshOptions, object_mesh, world_mesh};
use crate::export::preview::preview_sheet;
use crate::methods::method::Method;
use crate::methods::record::CommonSettings;
use crate::observer::Observer;
use crate::resources::Resources;
use crate::run::folder::RunFolder;
use crate::run::options::Trained;
use dvr_core::ViewSplit;
use dvr_render::{ViewMetrics, view_metrics};

/// The figures of a finished run: `metrics.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunMetrics {
    /// Name of the scene.
    pub scene: String,
    /// What the shape was learned from.
    pub supervision: String,
    /// Seed.
    pub seed: u64,
    /// Optimiser steps of the run, all sessions.
    pub steps: usize,
    /// The step whose model the results were made from: the best where views were validated, else the last.
    pub model_step: usize,
    /// Numbers that the field consists of.
    pub parameters: usize,
    /// Bytes that they are stored in.
    pub bytes: usize,
    /// Wall seconds of training, warm start included, all sessions.
    pub training_seconds: f64,
    /// Of these, the seconds until `model_step`.
    pub model_seconds: f64,
    /// Vertices and faces of the mesh; `None` where there is no surface.
    pub mesh: Option<[usize; 2]>,
    /// The shape against the truth, where the scene has it.
    pub shape: ShapeEvaluation,
    /// Renders of the field against held-out views, on an even subset of their pixels.
    pub held_out: Option<ViewMetrics>,
    /// Renders of the coloured mesh, unlit, against the same pixels: what the user takes home.
    pub held_out_mesh: Option<ViewMetrics>,
    /// What the process has cost until here, reading and mesh included.
    pub resources: Resources,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// What training decided on the way and why: how fine the field became, say.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Wall seconds of each part of the work after training.
    #[serde(default)]
    pub finishing_seconds: Vec<(String, f64)>,
    /// Wall and CPU seconds that went into following the shape, beside the clock of training.
    #[serde(default)]
    pub measuring_seconds: [f64; 2],
}

/// Samples across the cube where a network is rendered.
const SAMPLES: usize = 128;

/// Pixels of held-out views that the final figures look at. (`dvr eval` looks at all.)
const HELD_OUT_PIXELS: usize = 40_000;

/// Rays that look for parts of the surface which the extraction's coarse grid may miss.
const SEED_RAYS: usize = 2_000;

/// Rows of the preview sheet, and the most pixels a picture is wide.
const PREVIEW: (usize, u32) = (4, 256);

/// Writes mesh (PLY and GLB, in the scene's coordinates), preview sheet and figures into the run's folder.
///
/// # Errors
/// When a file cannot be written. A field without a surface is no error here: the figures say so, and
/// [`RunMetrics::mesh`] is `None`.
pub fn finish(
    scene: &Scene,
    method: &dyn Method,
    trained: &Trained,
    folder: &RunFolder,
    options: &MeshOptions,
    observer: &mut dyn Observer,
) -> Result<RunMetrics> {
    let Trained { model, outcome } = trained;
    let header = &outcome.header;
    let CommonSettings { seed, supervision, hold_out_every, .. } = header.common;
    let views = ViewSplit::new(scene, hold_out_every)?;
    let mut warnings = scene.warnings.clone();
    let mut clock = Instant::now();
    let mut finishing_seconds = Vec::new();
    let mut lap = |part: &str| {
        finishing_seconds.push((part.to_owned(), clock.elapsed().as_secs_f64()));
        clock = Instant::now();
    };

    observer.phase("mesh, preview and figures", 4);
    let shader = model.shader(SAMPLES);
    let seeds = surface_points(model.thorough_shader().as_ref(), &views.train, SEED_RAYS);
    let mesh = match object_mesh(model.as_ref(), options, &seeds, &views.train) {
        Ok(extracted) => {
            warnings.extend(extraction_warnings(&extracted));
            let mesh = extracted.mesh;
            let world = world_mesh(&mesh, &header.object_to_world);
            write_mesh(folder.mesh_ply(), &world)?;
            write_mesh(folder.mesh_glb(), &world)?;
            Some(mesh)
        }
        Err(Error::NoMesh(reason)) => {
            warnings.push(reason);
            None
        }
        Err(other) => return Err(other),
    };
    if method.is_compact() {
        outcome.final_model().save(&folder.scene_file())?;
    }
    lap("mesh");
    observer.progress(1, "mesh");

    let held_out_views = unseen_views(scene, &views);
    let shown: Vec<&View> = spread(if held_out_views.is_empty() { &views.train } else { &held_out_views }, PREVIEW.0);
    // The sheet shows what the user takes home: the mesh, where there is one.
    let mesh_shader = mesh.as_ref().map(MeshShader::new);
    let taken_home = mesh_shader.as_ref().map_or(shader.as_ref(), |shader| shader as &dyn Shader);
    let sheet = preview_sheet(taken_home, &shown, PREVIEW.1);
    dvr_core::files::write_rgb_png(&folder.preview(), &sheet)?;
    lap("preview");
    observer.progress(2, "preview");

    let held_out = view_metrics(shader.as_ref(), &held_out_views, HELD_OUT_PIXELS);
    let held_out_mesh = mesh_shader.as_ref().and_then(|shader| view_metrics(shader, &held_out_views, HELD_OUT_PIXELS));
    lap("held-out views");
    observer.progress(3, "held-out views");
    let empty = Mesh::default();
    let shape = evaluate_shape(mesh.as_ref().unwrap_or(&empty), &scene.ground_truth, seed)?;
    lap("shape against the truth");
    let metrics = RunMetrics {
        scene: scene.name.clone(),
        supervision: supervision.to_string(),
        seed,
        steps: outcome.steps,
        model_step: header.step,
        parameters: model.parameters(),
        bytes: outcome.model.len(),
        training_seconds: outcome.seconds,
        model_seconds: header.seconds,
        mesh: mesh.map(|mesh| [mesh.vertices.len(), mesh.faces.len()]),
        shape,
        held_out,
        held_out_mesh,
        resources: Resources::now(),
        warnings,
        notes: header.notes.clone(),
        finishing_seconds,
        measuring_seconds: outcome.measuring_seconds,
    };
    let json = serde_json::to_string_pretty(&metrics).map_err(|e| Error::NotStored { problem: e.to_string() })?;
    dvr_core::files::write_bytes_atomically(&folder.metrics_json(), json.as_bytes())?;
    observer.progress(4, "figures");
    Ok(metrics)
}

/// What extraction has to say, in plain words.
pub fn extraction_warnings(extracted: &Extraction) -> Vec<String> {
    let mut warnings: Vec<String> = extracted.warnings.iter().map(ToString::to_string).collect();
    if extracted.dropped_components > 0 {
        warnings.push(format!(
            "{} small loose piece(s) were dropped from the mesh (--min-piece 0 keeps them)",
            extracted.dropped_components
        ));
    }
    warnings
}

/// The views that nobody trained on: the test split where there is one, else what was held out for validation.
pub fn unseen_views<'a>(scene: &'a Scene, views: &ViewSplit<'a>) -> Vec<&'a View> {
    let test: Vec<&View> = scene.views_of(Split::Test).collect();
    if test.is_empty() { views.held_out.clone() } else { test }
}

/// Points on the surface that object pixels of `views` see: seeds for the extraction.
pub fn surface_points(shader: &dyn Shader, views: &[&View], rays: usize) -> Vec<Vec3> {
    let masks = || views.iter().filter_map(|view| view.training_pair());
    let object = masks().flat_map(|(camera, mask)| {
        let (width, height) = mask.size();
        let pixels = (0..height).flat_map(move |v| (0..width).map(move |u| (camera, u, v)));
        pixels.filter(|(_, u, v)| mask.is_object(*u, *v))
    });
    let count: usize = masks().map(|(_, mask)| mask.object_pixels()).sum();
    let stride = count.div_ceil(rays.max(1)).max(1);
    let rays: Vec<Ray> = object.step_by(stride).map(|(camera, u, v)| camera.pixel_ray(u, v)).collect();
    let shaded = shader.shade(&rays);
    let point = |(ray, shaded): (&Ray, Option<Shaded>)| Some(ray.at(shaded?.depth.into()).as_vec3());
    rays.iter().zip(shaded).filter_map(point).collect()
}

/// At most `count` items, evenly spread.
fn spread<'a>(views: &[&'a View], count: usize) -> Vec<&'a View> {
    let count = count.min(views.len());
    (0..count).map(|i| views[i * views.len() / count]).collect()
}
