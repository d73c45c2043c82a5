//! The top of a run: the viewer or a preview sheet, figures as tiles, diagnostics.

use std::fmt::Write;

use super::figures::main_figures;
use super::viewer::viewer;
use crate::diagnostics::{Diagnostic, Diagnostics};
use crate::html::escape;
use crate::summary::RunSummary;

/// What a user can do about a diagnostic, in words of the program that makes the report.
pub type Remedy<'a> = dyn Fn(&Diagnostic) -> Option<String> + 'a;

/// The top of a run: the viewer beside figures and diagnostics. `place` numbers the viewers of a page.
pub(crate) fn overview(summary: &RunSummary, place: usize, remedy: &Remedy) -> String {
    let tiles = tiles(&main_figures(summary));
    let diagnostics = diagnostics(&summary.diagnostics, remedy);
    let stage = match (&summary.mesh, &summary.preview) {
        (Some(_), _) => viewer(summary, place),
        (None, Some(preview)) => format!(
            "<figure class=\"preview\"><img src=\"{preview}\" alt=\"preview sheet\"><figcaption>Objects that were not \
             trained on: the input picture, another view of the object, and the model's render of that view: colour, \
             depth, normals.</figcaption></figure>"
        ),
        (None, None) => "<p class=\"empty\">There is no mesh to show.</p>".into(),
    };
    format!(
        "<div class=\"overview\"><div class=\"stage\">{stage}</div><div class=\"facts\">{tiles}{diagnostics}</div></div>"
    )
}

/// Figures as tiles: name, value, explanation.
fn tiles(figures: &[[String; 3]]) -> String {
    let mut html = String::from("<dl class=\"tiles\">");
    for [name, value, hint] in figures {
        let _ =
            write!(html, "<div title=\"{}\"><dt>{}</dt><dd>{}</dd></div>", escape(hint), escape(name), escape(value));
    }
    html + "</dl>"
}

/// What may be wrong, then what was checked and found right.
fn diagnostics(found: &Diagnostics, remedy: &Remedy) -> String {
    let mut html = String::from("<ul class=\"diagnostics\">");
    for warning in &found.warnings {
        let remedy = remedy(warning).map_or(String::new(), |remedy| format!(" {remedy}"));
        let _ = write!(html, "<li class=\"warn\">{}</li>", escape(&format!("{warning}{remedy}")));
    }
    for text in &found.passed {
        let _ = write!(html, "<li class=\"good\">{}</li>", escape(text));
    }
    html + "</ul>"
}
