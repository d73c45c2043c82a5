//! Colour that depends on the viewing direction, for pictures of a run's field.

use dvr_core::{Cancellation, ViewSplit};
use dvr_render::{Shader, ViewColor, ViewMetrics, view_metrics};

use crate::error::{Error, Result};
use crate::export::run_results::FIGURE_PIXELS;
use crate::run::folder::RunFolder;

/// Fits it to the photographs that were trained on. Where validation views, which scored `without` it, look no better
/// with it, there is none: few photographs, or a wrong surface.
///
/// # Errors
/// [`Error::Cancelled`] where somebody wants it to end.
pub(crate) fn fit_view_color(
    shader: &dyn Shader,
    views: &ViewSplit,
    without: Option<ViewMetrics>,
    cancellation: &Cancellation,
) -> Result<Option<ViewColor>> {
    let Some(fitted) = ViewColor::fit(shader, &views.train, cancellation)? else { return Ok(None) };
    let with = view_metrics(&fitted.on(shader), &views.validation, FIGURE_PIXELS);
    let is_better = with.zip(without).is_none_or(|(with, without)| with.psnr > without.psnr);
    Ok(is_better.then_some(fitted))
}

/// Writes it into a run's folder, or takes away what an earlier session left there.
///
/// # Errors
/// When the file cannot be written.
pub(crate) fn store_view_color(found: Option<&ViewColor>, folder: &RunFolder) -> Result<()> {
    let Some(found) = found else { return folder.forget_view_color() };
    let bytes = found.to_bytes().map_err(|error| Error::NotStored { problem: error.to_string() })?;
    Ok(dvr_core::files::write_bytes_atomically(&folder.view_color(), &bytes)?)
}

/// That of a run's folder; `None` where the run has none.
///
/// # Errors
/// When the file cannot be read, or is something else.
pub fn load_view_color(folder: &RunFolder) -> Result<Option<ViewColor>> {
    let path = folder.view_color();
    if !path.exists() {
        return Ok(None);
    }
    let bytes = dvr_core::files::read_bytes(&path)?;
    let found = ViewColor::from_bytes(&bytes);
    found.map(Some).map_err(|error| Error::NotViewColor { path, problem: error.problem })
}
