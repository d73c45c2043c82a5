//! Colour that depends on the viewing direction, for pictures of a run's field.

use dvr_core::{Cancellation, ViewSplit};
use dvr_render::{Shader, ViewColor, ViewMetrics, view_metrics};

use crate::error::{Error, Result};
use crate::export::run_results::FIGURE_PIXELS;
use crate::run::folder::RunFolder;

/// How much nearer to validation photographs it must bring pictures, dB: it may take as many bytes as the field.
const MIN_GAIN_DB: f64 = 0.25;

/// Fits it to the photographs that were trained on. There is none where validation views, which scored `without` it, look
/// hardly better with it, and where there are no such views: few photographs, or a wrong surface, fit anything.
///
/// # Errors
/// [`Error::Cancelled`] where somebody wants it to end.
pub(crate) fn fit_view_color(
    shader: &dyn Shader,
    views: &ViewSplit,
    without: Option<ViewMetrics>,
    cancellation: &Cancellation,
) -> Result<Option<ViewColor>> {
    let Some(without) = without else { return Ok(None) };
    let Some(fitted) = ViewColor::fit(shader, &views.train, cancellation)? else { return Ok(None) };
    let with = view_metrics(&fitted.on(shader), &views.validation, FIGURE_PIXELS);
    Ok(with.filter(|with| with.psnr - without.psnr >= MIN_GAIN_DB).map(|_| fitted))
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
