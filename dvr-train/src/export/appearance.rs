//! What photographs make of a run's mesh, and what pictures show of the run.

use dvr_core::{Similarity, View, ViewSplit};
use dvr_render::{MeshShader, Shader, ViewMetrics, view_metrics};
use dvr_texture::Textured;
use image::RgbImage;

use crate::error::Result;
use crate::export::laps::Laps;
use crate::export::mesh::{MeshOptions, ObjectMesh};
use crate::export::pictures::{ChosenPictures, FIGURE_PIXELS};
use crate::export::preview::preview_sheet;
use crate::export::texture::photo_texture;
use crate::methods::method::Method;
use crate::run::options::Trained;

/// Samples across the cube where a network is rendered.
const SAMPLES: usize = 128;

/// Rows of the preview sheet, and the most pixels a picture is wide.
const PREVIEW: (usize, u32) = (4, 256);

/// What photographs make of a mesh, and what pictures show of the run.
pub(super) struct Appearance {
    /// The mesh with its texture, where one was asked for.
    pub textured: Option<Textured>,
    /// What pictures of the run show; its field where nothing was chosen.
    pub pictures: Option<ChosenPictures>,
    /// Input, render, depth and normals side by side.
    pub preview: RgbImage,
    /// The field against test views.
    pub test: Option<ViewMetrics>,
    /// The field against validation views.
    pub validation: Option<ViewMetrics>,
    /// The mesh against test views.
    pub test_mesh: Option<ViewMetrics>,
    /// What pictures show against test views.
    pub test_pictures: Option<ViewMetrics>,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl Appearance {
    /// Makes the texture, where one is asked for, and looks at the run through all views but those that it learned from.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] where somebody wants it to end.
    pub fn new(
        trained: &Trained,
        method: &dyn Method,
        extracted: Option<&ObjectMesh>,
        views: &ViewSplit,
        to_export: &Similarity,
        options: &MeshOptions,
        laps: &mut Laps,
    ) -> Result<Self> {
        let cancellation = &options.extraction.cancellation;
        let mut notes = Vec::new();
        let textured = match extracted {
            Some(extracted) => photo_texture(extracted, &views.train, options, &mut notes)?,
            None => None,
        };
        laps.done("texture")?;
        let shown = spread(if views.test.is_empty() { &views.train } else { &views.test }, PREVIEW.0);
        // The sheet shows the mesh, which is what the user keeps, where there is one.
        let shader = trained.model.shader(SAMPLES);
        // It is shown as its file has it, in the coordinates of the scene's files: far from their origin these are coarse.
        let written = textured.as_ref().map(|textured| textured.mesh.clone().transformed(to_export));
        let written = written.map(|written| written.transformed(&to_export.inverse()));
        let mesh_shader = match &written {
            Some(written) => Some(MeshShader::textured(written)),
            None => extracted.map(|extracted| MeshShader::new(&extracted.mesh)),
        };
        let kept = mesh_shader.as_ref().map_or(shader.as_ref(), |shader| shader as &dyn Shader);
        let preview = preview_sheet(kept, &shown, PREVIEW.1);
        laps.done("preview")?;

        let of_field = |views: &[&View]| view_metrics(shader.as_ref(), views, FIGURE_PIXELS);
        let (test, validation) = (of_field(&views.test), of_field(&views.validation));
        // Vertices have about as many colours as the field.
        let with_texture = written.is_some().then_some(kept);
        let pictures = match method.is_compact() {
            true => ChosenPictures::new(shader.as_ref(), validation, with_texture, views, cancellation)?,
            false => None,
        };
        laps.done("view-dependent colour")?;
        let figure = |chosen: &ChosenPictures| chosen.figure(shader.as_ref(), with_texture, &views.test);
        let test_pictures = pictures.as_ref().and_then(figure);
        let test_mesh = mesh_shader.as_ref().and_then(|shader| view_metrics(shader, &views.test, FIGURE_PIXELS));
        laps.done("test and validation views")?;
        Ok(Self { textured, pictures, preview, test, validation, test_mesh, test_pictures, notes })
    }
}

/// At most `count` items, evenly spread.
fn spread<'a>(views: &[&'a View], count: usize) -> Vec<&'a View> {
    let count = count.min(views.len());
    (0..count).map(|i| views[i * views.len() / count]).collect()
}
