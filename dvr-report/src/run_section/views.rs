//! Test views: the photograph beside the mesh, maps, and their figures.

use std::fmt::Write;

use dvr_core::metrics::picture::MAX_PSNR;

use crate::html::escape;
use crate::pictures::{LARGEST_ERROR, ViewPictures};
use crate::summary::RunSummary;

/// Test views: sliders, maps and their figures.
pub(super) fn views(summary: &RunSummary) -> String {
    if summary.views.is_empty() {
        return String::new();
    }
    let scale = summary.header.object_to_world.scale;
    let mut html = String::from("<div class=\"views\">");
    let _ = write!(
        html,
        "<p>{} Drag the line: photograph to its left, mesh to its right.</p>",
        if summary.views_are_for_testing {
            "Nothing was learned from these photographs, and nothing chosen by them."
        } else {
            "There are no test views; these photographs were trained on."
        }
    );
    if summary.views.len() > 1 {
        html += "<div class=\"thumbs\" role=\"group\" aria-label=\"Views\">";
        for (i, view) in summary.views.iter().enumerate() {
            let _ = write!(
                html,
                "<button type=\"button\" data-view=\"{i}\" aria-pressed=\"{}\"><img src=\"{}\" alt=\"\" \
                 decoding=\"async\"><span>{}</span></button>",
                i == 0,
                view.render,
                escape(&view.name)
            );
        }
        html += "</div>";
    }
    for (i, view) in summary.views.iter().enumerate() {
        html += &one_view(view, scale, i == 0);
    }
    html + "</div>"
}

/// One view: the slider, then the maps. `scale` is the length of an object unit in the units of the scene.
fn one_view(view: &ViewPictures, scale: f64, first: bool) -> String {
    let (width, height) = view.size;
    let name = escape(&view.name);
    let depth = view.depth_range.map_or(String::new(), |[near, far]| {
        let world = |z: f32| crate::html::number(f64::from(z) * scale, 4);
        format!("Depth {} to {}", world(near), world(far))
    });
    let map = |address: &str, text: &str, hint: &str| {
        format!(
            "<figure><img src=\"{address}\" width=\"{width}\" height=\"{height}\" alt=\"{text}\" \
             decoding=\"async\"><figcaption title=\"{hint}\">{text}</figcaption></figure>"
        )
    };
    let psnr = if view.psnr < MAX_PSNR { format!("{:.2} dB", view.psnr) } else { "no difference".into() };
    let iou = view.mask_iou.map_or("unknown".into(), |iou| format!("{iou:.4}"));
    format!(
        "<div class=\"view\" style=\"--aspect:{width}/{height}\"{}><div class=\"compare\" \
         style=\"aspect-ratio:{width}/{height}\">\
         <img src=\"{}\" alt=\"photograph of view {name}\" width=\"{width}\" height=\"{height}\">\
         <img class=\"over\" src=\"{}\" alt=\"render of the mesh in view {name}\" width=\"{width}\" \
         height=\"{height}\">\
         <span class=\"tag left\">photograph</span><span class=\"tag right\">mesh</span>\
         <input type=\"range\" min=\"0\" max=\"100\" value=\"50\" step=\"0.1\" aria-label=\"how much of the photograph \
         is shown\"></div>\
         <div class=\"maps\">{}{}{}</div>\
         <p class=\"figures\">view <b>{name}</b> at {width}\u{d7}{height}: PSNR <b>{psnr}</b>, SSIM <b>{:.3}</b>, \
         silhouette IoU <b>{iou}</b></p></div>",
        if first { "" } else { " hidden" },
        view.photo,
        view.render,
        map(
            &view.error,
            &format!("Difference to {:.0} %", 100.0 * LARGEST_ERROR),
            "Mean difference of the colour channels, from none to the darkest colour"
        ),
        map(&view.depth, &depth, "In units of the scene: near is yellow, far is violet"),
        map(&view.normal, "Normals", "In the camera's frame: red to the right, green up, blue towards it"),
        view.ssim,
    )
}
