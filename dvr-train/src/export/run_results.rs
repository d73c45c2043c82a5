//! What a run gives its user: mesh, preview sheet, figures.

use std::path::PathBuf;
use std::time::Instant;

use dvr_core::mesh::{Mesh, MeshStyle, TexturedMesh};
use dvr_core::metrics::points::PointsSettings;
use dvr_core::metrics::self_intersections;
use dvr_core::{Camera, Cancellation, Exposure, Scene, Similarity, VerifiedPoints, View, ViewSplit};
use dvr_render::{MeshShader, Shader, view_metrics};
use image::RgbImage;

use crate::error::{Error, Result};
use crate::evaluate::{DepthMapsEvaluation, PointsEvaluation, evaluate_shape};
use crate::export::mesh::{MeshOptions, ObjectMesh, object_mesh, world_mesh, write_run_mesh};
use crate::export::pictures::{ChosenPictures, store_pictures};
use crate::export::preview::preview_sheet;
use crate::export::real_size::RealSize;
use crate::export::run_metrics::RunMetrics;
use crate::export::texture::photo_texture;
use crate::export::views::surface_points;
use crate::methods::method::Method;
use crate::observer::Observer;
use crate::resources::Resources;
use crate::run::folder::RunFolder;
use crate::run::options::Trained;

/// Samples across the cube where a network is rendered.
const SAMPLES: usize = 128;

/// Pixels of test views, and of validation views, that the final figures look at. (Evaluation looks at all.)
pub(super) const FIGURE_PIXELS: usize = 40_000;

/// Rays that look for parts of the surface which the extraction's coarse grid may miss.
const SEED_RAYS: usize = 2_000;

/// Rows of the preview sheet, and the most pixels a picture is wide.
const PREVIEW: (usize, u32) = (4, 256);

/// What a run gives its user, in memory.
#[derive(Clone, Debug)]
pub struct RunResults {
    /// The mesh in the coordinates and units of the scene's files, or in metres about the same origin where the real size is
    /// known; `None` where the field has no surface.
    pub mesh: Option<Mesh>,
    /// The same with a texture from the photographs, where one was asked for.
    pub textured: Option<TexturedMesh>,
    /// How it is written.
    pub style: MeshStyle,
    /// What pictures of the run show; its field where nothing was chosen.
    pub pictures: Option<ChosenPictures>,
    /// What takes object space to the coordinates of the mesh.
    object_to_mesh: Similarity,
    /// Input, render, depth and normals side by side.
    pub preview: RgbImage,
    /// The figures.
    pub metrics: RunMetrics,
}

impl RunResults {
    /// Extracts, renders and measures what the method has trained, on the scene as [`train`](crate::train()) left it.
    ///
    /// A field without a surface is no error: the figures say so.
    ///
    /// # Errors
    /// When a picture or the scene's ground truth is broken; [`Error::Cancelled`] where the token of the extraction's
    /// settings says so.
    pub fn new(
        scene: &Scene,
        method: &dyn Method,
        trained: &Trained,
        options: &MeshOptions,
        observer: &mut dyn Observer,
    ) -> Result<Self> {
        let Trained { model, outcome } = trained;
        let common = outcome.header.common;
        let views = ViewSplit::of(scene)?;
        let mut laps = Laps::new(observer, &options.extraction.cancellation);
        let mut warnings = scene.warnings.clone();
        let options = &options.clone().of_run(&outcome.header);
        let extracted = extract(trained, options, &views, &mut warnings)?;
        let simplification = extracted.as_ref().and_then(|extracted| extracted.simplification);
        laps.done("mesh")?;
        let textured = match &extracted {
            Some(extracted) => photo_texture(extracted, &views.train, options, &mut warnings)?,
            None => None,
        };
        let mesh = extracted.map(|extracted| extracted.mesh);
        laps.done("texture")?;
        let real_size = mesh.as_ref().and_then(|mesh| real_size(trained, mesh, scene, &mut warnings));
        let to_export = RealSize::to_export(real_size.as_ref(), &outcome.header.object_to_world);

        let shown = spread(if views.test.is_empty() { &views.train } else { &views.test }, PREVIEW.0);
        // The sheet shows the mesh, which is what the user keeps, where there is one.
        let shader = model.shader(SAMPLES);
        // It is shown as its file has it, in the coordinates of the scene's files: far from their origin these are coarse.
        let written = textured.as_ref().map(|textured| textured.mesh.clone().transformed(&to_export));
        let written = written.map(|written| written.transformed(&to_export.inverse()));
        let mesh_shader = match &written {
            Some(written) => Some(MeshShader::textured(written)),
            None => mesh.as_ref().map(MeshShader::new),
        };
        let kept = mesh_shader.as_ref().map_or(shader.as_ref(), |shader| shader as &dyn Shader);
        let preview = preview_sheet(kept, &shown, PREVIEW.1);
        laps.done("preview")?;

        let of_field = |views: &[&View]| view_metrics(shader.as_ref(), views, FIGURE_PIXELS);
        let (test, validation) = (of_field(&views.test), of_field(&views.validation));
        let cancellation = &options.extraction.cancellation;
        // Vertices have about as many colours as the field.
        let with_texture = written.is_some().then_some(kept);
        let pictures = match method.is_compact() {
            true => ChosenPictures::new(shader.as_ref(), validation, with_texture, &views, cancellation)?,
            false => None,
        };
        laps.done("view-dependent colour")?;
        let figure = |chosen: &ChosenPictures| chosen.figure(shader.as_ref(), with_texture, &views.test);
        let test_pictures = pictures.as_ref().and_then(figure);
        let test_mesh = mesh_shader.as_ref().and_then(|shader| view_metrics(shader, &views.test, FIGURE_PIXELS));
        laps.done("test and validation views")?;
        let empty = Mesh::default();
        let cameras: Vec<&Camera> = scene.views.iter().map(|view| &view.camera).collect();
        let shape = evaluate_shape(mesh.as_ref().unwrap_or(&empty), &scene.ground_truth, &cameras, common.seed)?;
        let in_world = mesh.as_ref().map(|mesh| world_mesh(mesh, &outcome.header.object_to_world));
        let trained_on_points = method.needs().sparse_points;
        let crossing = mesh.as_ref().map(|mesh| self_intersections(mesh, cancellation)).transpose()?;
        let points = match &in_world {
            Some(mesh) => PointsEvaluation::of_scene(mesh, scene, trained_on_points, &PointsSettings::default())?,
            None => None,
        };
        let depth_maps = DepthMapsEvaluation::new(
            &outcome.stereo_depths,
            scene,
            VerifiedPoints::of_scene(scene).as_ref(),
            in_world.as_ref().unwrap_or(&empty),
            &PointsSettings::default(),
        );
        laps.done("shape against the truth")?;
        let exported =
            if real_size.is_some() { mesh.as_ref().map(|mesh| world_mesh(mesh, &to_export)) } else { in_world };
        let metrics = RunMetrics {
            scene: scene.name.clone(),
            supervision: common.supervision.to_string(),
            seed: common.seed,
            steps: outcome.steps,
            model_step: outcome.header.step,
            parameters: model.parameters(),
            bytes: outcome.model.len(),
            training_seconds: outcome.seconds,
            model_seconds: outcome.header.seconds,
            mesh: mesh.as_ref().map(|mesh| [mesh.vertices.len(), mesh.faces.len()]),
            self_intersections: crossing,
            simplification: simplification.map(|moved| moved.scaled(outcome.header.object_to_world.scale)),
            real_size,
            support: outcome.header.support,
            texture: textured.as_ref().map(|textured| textured.report),
            shape,
            points,
            depth_maps,
            views: outcome.header.views.clone().unwrap_or_default(),
            test,
            test_pictures,
            pictures_of: pictures.as_ref().map(|chosen| chosen.of),
            test_mesh,
            validation,
            exposure_stops: Exposure::range(outcome.header.exposures.values()),
            resources: Resources::now(),
            warnings,
            notes: outcome.header.notes.clone(),
            finishing_seconds: laps.seconds,
            measuring_seconds: outcome.measuring_seconds,
        };
        let textured = textured.map(|textured| textured.mesh.transformed(&to_export));
        Ok(Self {
            mesh: exported,
            textured,
            style: options.style,
            pictures,
            object_to_mesh: to_export,
            preview,
            metrics,
        })
    }

    /// Writes mesh (PLY with colours per vertex, GLB with the texture where there is one), preview sheet and figures into a run's folder.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn save(&self, folder: &RunFolder) -> Result<()> {
        let written = |path: PathBuf| {
            let mesh = self.mesh.as_ref();
            mesh.map_or(Ok(()), |mesh| write_run_mesh(&path, mesh, self.textured.as_ref(), self.style))
        };
        // Pictures name the GLB by its digest.
        let (plain, textured) = rayon::join(
            || written(folder.mesh_ply()),
            || {
                written(folder.mesh_glb())?;
                store_pictures(self.pictures.as_ref(), &self.object_to_mesh, folder)
            },
        );
        plain.and(textured)?;
        dvr_core::files::write_rgb_png(&folder.preview(), &self.preview)?;
        let json = serde_json::to_string_pretty(&self.metrics);
        let json = json.map_err(|e| Error::NotStored { problem: e.to_string() })?;
        Ok(dvr_core::files::write_bytes_atomically(&folder.metrics_json(), json.as_bytes())?)
    }
}

/// Makes the results of a run and writes them into its folder, with the compact field where the method has one.
///
/// # Errors
/// As [`RunResults::new`] and [`RunResults::save`].
pub fn finish(
    scene: &Scene,
    method: &dyn Method,
    trained: &Trained,
    folder: &RunFolder,
    options: &MeshOptions,
    observer: &mut dyn Observer,
) -> Result<RunResults> {
    let results = RunResults::new(scene, method, trained, options, observer)?;
    results.save(folder)?;
    if method.is_compact() {
        trained.outcome.final_model().save(&folder.scene_file())?;
    }
    Ok(results)
}

/// The mesh in object space, or a warning.
fn extract(
    trained: &Trained,
    options: &MeshOptions,
    views: &ViewSplit,
    warnings: &mut Vec<String>,
) -> Result<Option<ObjectMesh>> {
    let model = trained.model.as_ref();
    let seeds = surface_points(model.thorough_shader().as_ref(), &views.train, SEED_RAYS);
    match object_mesh(model, options, &seeds, &views.train) {
        Ok(mut extracted) => {
            warnings.append(&mut extracted.warnings);
            Ok(Some(extracted))
        }
        Err(Error::NoMesh(reason)) => {
            warnings.push(reason);
            Ok(None)
        }
        Err(other) => Err(other),
    }
}

/// The real size of a mesh in object space, where lengths are known; or a warning.
fn real_size(trained: &Trained, mesh: &Mesh, scene: &Scene, warnings: &mut Vec<String>) -> Option<RealSize> {
    let lengths = &trained.outcome.header.lengths;
    if lengths.is_empty() {
        return None;
    }
    match RealSize::measure(lengths, mesh, scene) {
        Ok(size) => {
            warnings.extend(size.warning());
            Some(size)
        }
        // The run is trained, and another length can be given for its mesh.
        Err(error) => {
            warnings.push(format!("{error}; the mesh is in the units of the scene's files"));
            None
        }
    }
}

/// The time of each part of the work.
struct Laps<'o> {
    clock: Instant,
    seconds: Vec<(String, f64)>,
    observer: &'o mut dyn Observer,
    cancellation: &'o Cancellation,
}

impl<'o> Laps<'o> {
    fn new(observer: &'o mut dyn Observer, cancellation: &'o Cancellation) -> Self {
        observer.phase("mesh, texture, preview and figures", 6);
        Self { clock: Instant::now(), seconds: Vec::new(), observer, cancellation }
    }

    fn done(&mut self, part: &str) -> Result<()> {
        self.seconds.push((part.to_owned(), self.clock.elapsed().as_secs_f64()));
        self.clock = Instant::now();
        self.observer.progress(self.seconds.len(), part);
        Ok(self.cancellation.check()?)
    }
}

/// At most `count` items, evenly spread.
fn spread<'a>(views: &[&'a View], count: usize) -> Vec<&'a View> {
    let count = count.min(views.len());
    (0..count).map(|i| views[i * views.len() / count]).collect()
}
