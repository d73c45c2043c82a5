//! What a run gives its user: mesh, preview sheet, figures.

use std::path::PathBuf;

use dvr_core::mesh::{Mesh, MeshStyle, TexturedMesh};
use dvr_core::{Exposure, Scene, Similarity, ViewSplit};
use image::RgbImage;

use crate::error::{Error, Result};
use crate::export::appearance::Appearance;
use crate::export::laps::Laps;
use crate::export::measured::{Measured, Measuring};
use crate::export::mesh::{MeshOptions, ObjectMesh, object_mesh, world_mesh, write_run_mesh};
use crate::export::pictures::{ChosenPictures, store_pictures};
use crate::export::real_size::RealSize;
use crate::export::run_metrics::RunMetrics;
use crate::export::views::surface_points;
use crate::methods::method::Method;
use crate::observer::Observer;
use crate::resources::Resources;
use crate::run::folder::RunFolder;
use crate::run::options::Trained;

/// Rays that look for parts of the surface which the extraction's coarse grid may miss.
const SEED_RAYS: usize = 2_000;

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
        let real_size =
            extracted.as_ref().and_then(|extracted| real_size(trained, &extracted.mesh, scene, &mut warnings));
        laps.done("mesh")?;
        let to_export = RealSize::to_export(real_size.as_ref(), &outcome.header.object_to_world);
        let measuring = Measuring {
            scene,
            object_to_world: &outcome.header.object_to_world,
            trained_on_points: method.needs().sparse_points,
            stereo_depths: &outcome.stereo_depths,
            seed: common.seed,
            cancellation: &options.extraction.cancellation,
        };
        // What is measured of the shape, and what photographs make of it, do not wait for each other.
        let shape = extracted.as_ref().map(|extracted| &extracted.mesh);
        let (appearance, measured) = std::thread::scope(|scope| {
            let measured = scope.spawn(|| measuring.of(shape));
            let appearance =
                Appearance::new(trained, method, extracted.as_ref(), &views, &to_export, options, &mut laps);
            (appearance, measured.join())
        });
        let measured = measured.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        let Appearance { textured, pictures, preview, test, validation, test_mesh, test_pictures, mut notes } =
            appearance?;
        warnings.append(&mut notes);
        let Measured { self_intersections, shape, points, depth_maps, in_world, seconds } = measured?;
        laps.meanwhile("figures of the shape, meanwhile", seconds)?;
        let mesh = extracted.map(|extracted| extracted.mesh);
        let exported =
            if real_size.is_some() { mesh.as_ref().map(|mesh| world_mesh(mesh, &to_export)) } else { in_world };
        let metrics = RunMetrics {
            scene: scene.name.clone(),
            supervision: common.supervision.to_string(),
            seed: common.seed,
            steps: outcome.steps,
            model_step: outcome.header.step,
            parameters: model.parameters(),
            cells: model.cells(),
            bytes: outcome.model.len(),
            training_seconds: outcome.seconds,
            model_seconds: outcome.header.seconds,
            mesh: mesh.as_ref().map(|mesh| [mesh.vertices.len(), mesh.faces.len()]),
            self_intersections,
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
