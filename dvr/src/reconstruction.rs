//! From a scene to its mesh.

use std::path::{Path, PathBuf};

use dvr_core::mesh::{Mesh, MeshStyle, TexturedMesh, shapes};
use dvr_core::synth::{SynthConfig, render_dataset};
use dvr_core::{Cancellation, Scene, refine_masks};
use dvr_train::{
    Observer, RunFolder, RunMetrics, RunOptions, RunResults, Trained, TrainedModel, finish, train, write_run_mesh,
};

use crate::error::{Error, Result};
use crate::options::Options;

/// A reconstructed scene.
pub struct Reconstruction {
    /// The trained field, in object space: to be rendered, or extracted in another resolution.
    pub field: Box<dyn TrainedModel>,
    /// The coloured surface in the coordinates and units of the scene's files; empty where the field has none.
    pub mesh: Mesh,
    /// The same with a texture from the photographs; `None` where [`Options::mesh`] asks for none.
    pub textured: Option<TexturedMesh>,
    /// How it is written, as [`Options::mesh`] says.
    pub style: MeshStyle,
    /// Figures, notes and warnings.
    pub report: RunMetrics,
}

impl Reconstruction {
    /// Writes the mesh; the ending says how: `.ply` with colours per vertex, `.glb`, `.usdz` or `.obj` with the texture
    /// where there is one.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn save_mesh(&self, path: &Path) -> Result<()> {
        write_run_mesh(path, &self.mesh, self.textured.as_ref(), self.style)
    }
}

/// Reconstructs a scene.
///
/// # Errors
/// When the scene has too few views or lacks masks or what the method learns from; when the loss diverges; when a file
/// of [`Options::folder`] cannot be written. A field without a surface is no error: see [`Reconstruction::mesh`].
pub fn reconstruct(scene: &Scene, options: &Options) -> Result<Reconstruction> {
    reconstruct_observed(scene, options, &mut (), &Cancellation::default())
}

/// The same; `observer` hears how it goes on, and `cancellation` ends training after the step that is
/// under way: what was learned until then is the result.
///
/// # Errors
/// As [`reconstruct`]; [`Error::Cancelled`] where there was no step yet.
pub fn reconstruct_observed(
    scene: &Scene,
    options: &Options,
    observer: &mut dyn Observer,
    cancellation: &Cancellation,
) -> Result<Reconstruction> {
    let temporary = tempfile::tempdir().map_err(|e| dvr_core::Error::io(std::env::temp_dir(), e))?;
    let folder = RunFolder::new(options.folder.clone().unwrap_or_else(|| temporary.path().join("run")));
    let _writing = folder.create()?;
    let mut scene = scene.clone();
    scene.require_masks()?;
    // First, for masks of test views stay as they are.
    let method = options.method.as_ref();
    let views = scene.hold_out(method.common().hold_out_every);
    if options.refine_masks {
        let notes = refine_masks(&mut scene, cancellation)?.notes();
        scene.warnings.extend(notes);
    }
    let advice = scene.advice(cancellation).map_err(dvr_core::Error::from)?;
    scene.warnings.extend(advice.iter().map(ToString::to_string));
    let run = RunOptions {
        views: Some(views),
        refine_cameras: options.refine_cameras,
        time_limit: options.time_limit,
        cancellation: cancellation.clone(),
        ..RunOptions::new(folder.clone(), options.device.clone())
    };
    let trained = train(&mut scene, method, None, &run, observer)?;
    let RunResults { mesh, textured, style, metrics, .. } =
        finish(&scene, method, &trained, &folder, &options.mesh, observer)?;
    let Trained { model, .. } = trained;
    Ok(Reconstruction { field: model, mesh: mesh.unwrap_or_default(), textured, style, report: metrics })
}

/// Renders a small scene, a ball seen from eight sides, into `folder`: something to try [`reconstruct`] on.
///
/// # Errors
/// When a file cannot be written.
pub fn demo_scene(folder: &Path) -> Result<PathBuf> {
    let ball = TexturedMesh { mesh: shapes::icosphere(3, 1.0), ..TexturedMesh::default() };
    let few = SynthConfig { views: 8, width: 32, height: 32, ..SynthConfig::default() };
    render_dataset(&ball, "ball", "balls", folder, &few, &|_, _| ()).map_err(Error::from)?;
    Ok(folder.join("balls/ball"))
}
