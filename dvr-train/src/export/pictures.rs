//! What pictures of a run show: its field or its mesh with the texture, and whether colours depend on the viewing direction.
//!
//! Validation photographs choose, once the run is trained: a texture is finer than the colours of the field, but shows
//! what single photographs say; and few photographs, or a wrong surface, fit colours for any direction.

use dvr_core::mesh::{TexturedMesh, read_mesh_with_warnings};
use dvr_core::record::Digest;
use dvr_core::{Cancellation, Similarity, View, ViewSplit};
use dvr_render::{MeshShader, Shader, ViewColor, ViewMetrics, view_metrics};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::run::folder::RunFolder;

/// Pixels of test views, and of validation views, that the final figures look at. (Evaluation looks at all.)
pub(super) const FIGURE_PIXELS: usize = 40_000;

/// How much nearer to validation photographs pictures must be for what takes more bytes or more time, dB.
const MIN_GAIN_DB: f64 = 0.25;

/// What pictures of a run show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PicturesOf {
    /// The field, in the same colour from everywhere.
    Field,
    /// The field, in colours that depend on the viewing direction.
    FieldWithViewColor,
    /// The mesh with its texture, in the same colour from everywhere.
    Mesh,
    /// The mesh with its texture, in colours that depend on the viewing direction.
    MeshWithViewColor,
}

impl PicturesOf {
    /// Whether rays meet the mesh, on the CPU, and not the field.
    pub fn is_mesh(self) -> bool {
        matches!(self, Self::Mesh | Self::MeshWithViewColor)
    }

    fn with_view_color(self) -> Self {
        if self.is_mesh() { Self::MeshWithViewColor } else { Self::FieldWithViewColor }
    }
}

impl std::fmt::Display for PicturesOf {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Field => "field",
            Self::FieldWithViewColor => "field with view-dependent colour",
            Self::Mesh => "mesh",
            Self::MeshWithViewColor => "mesh with view-dependent colour",
        })
    }
}

/// What pictures of a run show, as validation views chose it.
#[derive(Clone, Debug, PartialEq)]
pub struct ChosenPictures {
    /// What they show.
    pub of: PicturesOf,
    /// What its colour changes by with the viewing direction: by nothing where it does not.
    pub view_color: ViewColor,
    /// They against validation views.
    validation: ViewMetrics,
}

impl ChosenPictures {
    /// Chooses between field, which scored `field_validation`, and mesh; `None` where there are no validation views.
    ///
    /// # Errors
    /// [`Error::Cancelled`] where somebody wants it to end.
    pub(crate) fn new(
        field: &dyn Shader,
        field_validation: Option<ViewMetrics>,
        mesh: Option<&dyn Shader>,
        views: &ViewSplit,
        cancellation: &Cancellation,
    ) -> Result<Option<Self>> {
        let Some(validation) = field_validation else { return Ok(None) };
        let plain = |of, validation| Self { of, view_color: ViewColor::none(), validation };
        let of_field = plain(PicturesOf::Field, validation).with_harmonics(field, views, cancellation)?;
        let of_mesh = match mesh.and_then(|mesh| view_metrics(mesh, &views.validation, FIGURE_PIXELS).zip(Some(mesh))) {
            Some((validation, mesh)) => {
                let of_mesh = plain(PicturesOf::Mesh, validation).with_harmonics(mesh, views, cancellation)?;
                (of_mesh.validation.psnr - of_field.validation.psnr >= MIN_GAIN_DB).then_some((of_mesh, mesh))
            }
            None => None,
        };
        let (chosen, surface) = of_mesh.unwrap_or((of_field, field));
        Ok(Some(chosen.with_photographs(surface, views, cancellation)?))
    }

    /// In colours that change slowly with the direction, where these bring enough; `shader` shows it without.
    fn with_harmonics(self, shader: &dyn Shader, views: &ViewSplit, cancellation: &Cancellation) -> Result<Self> {
        let view_color = ViewColor::fit(shader, &views.train, cancellation)?;
        Ok(self.or_better(view_color, shader, views))
    }

    /// With photographs from nearby directions, where they bring enough.
    fn with_photographs(self, shader: &dyn Shader, views: &ViewSplit, cancellation: &Cancellation) -> Result<Self> {
        let view_color = self.view_color.with_photographs(shader, &views.train, cancellation)?;
        Ok(self.or_better(view_color, shader, views))
    }

    /// With other colours, where validation views are nearer to these by enough.
    fn or_better(self, view_color: Option<ViewColor>, shader: &dyn Shader, views: &ViewSplit) -> Self {
        let Some(view_color) = view_color else { return self };
        let with = view_metrics(&view_color.on(shader), &views.validation, FIGURE_PIXELS);
        match with.filter(|with| with.psnr - self.validation.psnr >= MIN_GAIN_DB) {
            Some(validation) => Self { of: self.of.with_view_color(), view_color, validation },
            None => self,
        }
    }

    /// They against these views.
    pub(crate) fn figure(&self, field: &dyn Shader, mesh: Option<&dyn Shader>, views: &[&View]) -> Option<ViewMetrics> {
        let surface = mesh.filter(|_| self.of.is_mesh()).unwrap_or(field);
        view_metrics(&self.view_color.on(surface), views, FIGURE_PIXELS)
    }
}

/// What has the colours, as their file says.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum StoredSurface {
    Field,
    /// The mesh of the run's folder while it is the same to the byte, and where that is.
    Mesh {
        digest: Digest,
        object_to_mesh: Similarity,
    },
}

/// Writes them into a run's folder, where the mesh lies already, or takes away what an earlier session left there: there is
/// no file where pictures are of the field alone.
///
/// # Errors
/// When the file cannot be written, or that of the mesh cannot be read.
pub(crate) fn store_pictures(
    chosen: Option<&ChosenPictures>,
    object_to_mesh: &Similarity,
    folder: &RunFolder,
) -> Result<()> {
    let Some(chosen) = chosen.filter(|chosen| chosen.of != PicturesOf::Field) else {
        return folder.forget_view_color();
    };
    let fail = |problem: String| Error::NotStored { problem };
    let surface = if chosen.of.is_mesh() {
        StoredSurface::Mesh { digest: Digest::of_file(&folder.mesh_glb())?, object_to_mesh: *object_to_mesh }
    } else {
        StoredSurface::Field
    };
    let surface = serde_json::to_string(&surface).map_err(|error| fail(error.to_string()))?;
    let bytes = chosen.view_color.to_bytes(&surface).map_err(|error| fail(error.to_string()))?;
    Ok(dvr_core::files::write_bytes_atomically(&folder.view_color(), &bytes)?)
}

/// What pictures of a run show where that is not its field alone.
#[derive(Clone, Debug, PartialEq)]
pub struct RunPictures {
    view_color: ViewColor,
    /// In object space; the field where there is none.
    mesh: Option<TexturedMesh>,
}

impl RunPictures {
    /// Those of a run's folder; `None` where they are of the field alone, as they are where the mesh that they were of is gone
    /// or cannot be shown: a warning says so.
    ///
    /// # Errors
    /// When the file cannot be read, or is something else.
    pub fn load(folder: &RunFolder, warnings: &mut Vec<String>) -> Result<Option<Self>> {
        let path = folder.view_color();
        if !path.exists() {
            return Ok(None);
        }
        let broken = |problem: String| Error::NotViewColor { path: path.clone(), problem };
        let bytes = dvr_core::files::read_bytes(&path)?;
        let view_color = ViewColor::from_bytes(&bytes).map_err(|error| broken(error.problem))?;
        let surface = ViewColor::surface_of(&bytes).map_err(|error| broken(error.problem))?;
        // Runs of older versions say nothing: theirs is that of the field.
        let surface = surface.map_or(Ok(StoredSurface::Field), |surface| serde_json::from_str(&surface));
        match surface.map_err(|error| broken(error.to_string()))? {
            StoredSurface::Field => Ok(Some(Self { view_color, mesh: None })),
            StoredSurface::Mesh { digest, object_to_mesh } => {
                let mesh_to_object = object_to_mesh.inverse();
                if !is_sound(&object_to_mesh) || !is_sound(&mesh_to_object) {
                    return Err(broken(format!("its mesh cannot lie at {object_to_mesh:?}")));
                }
                let mesh = run_mesh(folder, &digest, warnings)?;
                Ok(mesh.map(|mesh| Self { view_color, mesh: Some(mesh.transformed(&mesh_to_object)) }))
            }
        }
    }

    /// The same surface in one colour from everywhere.
    pub fn without_view_color(self) -> Self {
        Self { view_color: ViewColor::none(), ..self }
    }

    /// What they show.
    pub fn of(&self) -> PicturesOf {
        let of = if self.mesh.is_some() { PicturesOf::Mesh } else { PicturesOf::Field };
        if self.view_color.is_none() { of } else { of.with_view_color() }
    }

    /// Hands on what shows them, where `field` shows the field of the run.
    pub fn show<R>(&self, field: &dyn Shader, to: impl FnOnce(&dyn Shader) -> R) -> R {
        match &self.mesh {
            Some(mesh) => to(&self.view_color.on(&MeshShader::textured(mesh))),
            None => to(&self.view_color.on(field)),
        }
    }
}

/// Whether numbers of a file can be a similarity.
fn is_sound(similarity: &Similarity) -> bool {
    let Similarity { scale, rotation, translation } = similarity;
    scale.is_finite() && *scale > 0.0 && rotation.is_finite() && rotation.is_normalized() && translation.is_finite()
}

/// The mesh that a run made; `None`, with a warning, where it is gone, was written anew, or has no texture that can be read.
fn run_mesh(folder: &RunFolder, digest: &Digest, warnings: &mut Vec<String>) -> Result<Option<TexturedMesh>> {
    let (path, run) = (folder.mesh_glb(), folder.root().display());
    let mut problem = format!(
        "this is not the mesh that the run made; `dvr train --resume --out {run}` makes that and all results of the run again"
    );
    if path.is_file() && Digest::of_file(&path)? == *digest {
        let mut left_out = Vec::new();
        let mesh = read_mesh_with_warnings(&path, &mut left_out)?;
        if mesh.materials.iter().any(|material| material.texture.is_some()) {
            return Ok(Some(mesh));
        }
        problem = left_out.join("; ");
    }
    warnings.push(format!("{}: {problem}. Pictures are of the field", path.display()));
    Ok(None)
}
