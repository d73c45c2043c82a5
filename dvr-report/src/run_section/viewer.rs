//! The mesh in 3D: the canvas, its controls, the encoded mesh and its texture.

use std::fmt::Write;

use crate::html::{count, json_for_script};
use crate::summary::{Figures, RunSummary};

/// The canvas, its controls and the mesh; empty where there is no mesh.
pub(super) fn viewer(summary: &RunSummary, place: usize) -> String {
    let Some((mesh, facts)) = &summary.mesh else { return String::new() };
    let modes = [("color", "Colour"), ("shaded", "Shaded"), ("normals", "Normals"), ("confidence", "Confidence")];
    let mut buttons = String::new();
    for (i, (mode, name)) in modes.iter().enumerate() {
        let off = if *mode == "confidence" && summary.coverage.is_none() { " disabled" } else { "" };
        let _ = write!(
            buttons,
            "<button type=\"button\" data-mode=\"{mode}\" aria-pressed=\"{}\"{off}>{name}</button>",
            i == 0
        );
    }
    let shown = match &summary.figures {
        Figures::Scene(metrics) => metrics
            .mesh
            .filter(|[_, faces]| *faces > mesh.faces)
            .map(|[_, faces]| format!("Simplified from {} faces for this page; mesh.glb has all.", count(faces))),
        Figures::Objects(_) => None,
    };
    // A page cannot open files by itself, only those that its reader chooses.
    let whole = if summary.texture.is_some() {
        "<label class=\"file\" title=\"Choose the run's mesh.glb to see all its faces and texels\">Open \
         mesh.glb<input type=\"file\" accept=\".glb\" data-whole></label>"
    } else {
        ""
    };
    let texture = summary.texture.as_ref().map_or_else(String::new, |address| {
        format!("<script type=\"text/plain\" id=\"mesh-{place}-texture\">{address}</script>")
    });
    format!(
        "<div class=\"viewer\" data-mesh=\"mesh-{place}\">\
         <div class=\"controls\"><div class=\"modes\" role=\"group\" aria-label=\"What the surface \
         shows\">{buttons}</div>\
         <label class=\"toggle\"><input type=\"checkbox\" data-cameras> cameras</label>{whole}\
         <button type=\"button\" data-home title=\"Back to the first view\">Reset</button></div>\
         <div class=\"screen\"><canvas tabindex=\"0\" aria-label=\"The mesh in 3D: drag to turn, scroll or pinch to \
         zoom, drag with the right \
         button or two fingers to move\"></canvas><p class=\"message\" hidden></p>\
         <div class=\"legend\" hidden><span>confidence</span><i></i><span>0</span><b></b><span>1</span><i \
         class=\"unseen\"></i><span>never \
         observed</span></div></div>\
         <p class=\"hint about\" hidden>Confidence: cosine of the best viewing angle, times 1/2 for one view, 3/4 for \
         two and so on. It tells how well photographs see a place, not that the shape there is right.</p>\
         <p class=\"hint\">Drag to turn, scroll or pinch to zoom, right button or two fingers to move. \
         <span class=\"whole\">{} vertices, {} faces. {}</span></p>\
         <script type=\"application/json\" id=\"mesh-{place}-facts\">{}</script>\
         <script type=\"text/plain\" id=\"mesh-{place}\">{}</script>{texture}</div>",
        count(mesh.vertices),
        count(mesh.faces),
        shown.unwrap_or_default(),
        json_for_script(facts),
        mesh.text,
    )
}
