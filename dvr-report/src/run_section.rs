//! One run as HTML: the mesh, the views, the figures, the settings.

use std::fmt::Write;

use dvr_train::RunMetrics;

use crate::html::{bytes, count, escape, json_for_script, seconds};
use crate::page::table;
use crate::pictures::{LARGEST_ERROR, ViewPictures};
use crate::story::{Figures, RunStory};

/// What stands at the top: the viewer beside figures and findings.
pub(crate) fn overview(story: &RunStory, place: usize) -> String {
    let tiles = tiles(&main_figures(story));
    let findings = findings(story);
    let stage = match (&story.mesh, &story.preview) {
        (Some(_), _) => viewer(story, place),
        (None, Some(preview)) => format!(
            "<figure class=\"preview\"><img src=\"{preview}\" alt=\"preview sheet\"><figcaption>Objects that were not \
             trained on: the \
             picture that the model sees, another view of the object, and that view as the model has it: colour, \
             depth, \
             normals.</figcaption></figure>"
        ),
        (None, None) => "<p class=\"empty\">There is no mesh to show.</p>".into(),
    };
    format!(
        "<div class=\"overview\"><div class=\"stage\">{stage}</div><div class=\"facts\">{tiles}{findings}</div></div>"
    )
}

/// The canvas, its controls and the mesh.
fn viewer(story: &RunStory, place: usize) -> String {
    let Some((mesh, facts)) = &story.mesh else { return String::new() };
    let modes = [("color", "Colour"), ("shaded", "Shaded"), ("normals", "Normals"), ("confidence", "Confidence")];
    let mut buttons = String::new();
    for (i, (mode, name)) in modes.iter().enumerate() {
        let off = if *mode == "confidence" && story.coverage.is_none() { " disabled" } else { "" };
        let _ = write!(
            buttons,
            "<button type=\"button\" data-mode=\"{mode}\" aria-pressed=\"{}\"{off}>{name}</button>",
            i == 0
        );
    }
    let shown = match &story.figures {
        Figures::Scene(metrics) => metrics
            .mesh
            .filter(|[_, faces]| *faces > mesh.faces)
            .map(|[_, faces]| format!(" Simplified from {} faces for this page; mesh.glb has them all.", count(faces))),
        Figures::Objects(_) => None,
    };
    format!(
        "<div class=\"viewer\" data-mesh=\"mesh-{place}\">\
         <div class=\"controls\"><div class=\"modes\" role=\"group\" aria-label=\"What the surface \
         shows\">{buttons}</div>\
         <label class=\"toggle\"><input type=\"checkbox\" data-cameras> cameras</label>\
         <button type=\"button\" data-home title=\"Back to the first view\">Reset</button></div>\
         <div class=\"screen\"><canvas tabindex=\"0\" aria-label=\"The mesh in 3D: drag to turn, scroll or pinch to \
         zoom, drag with the right \
         button or two fingers to move\"></canvas><p class=\"message\" hidden></p>\
         <div class=\"legend\" hidden><span>confidence</span><i></i><span>0</span><b></b><span>1</span><i \
         class=\"unseen\"></i><span>never \
         observed</span></div></div>\
         <p class=\"hint about\" hidden>Confidence: cosine of the best viewing angle, times 1/2 for one view, 3/4 for \
         two and so on. It tells \
         how well photographs saw a place, not that the shape there is right.</p>\
         <p class=\"hint\">Drag to turn, scroll or pinch to zoom, right button or two fingers to move. {} vertices, {} \
         faces.{}</p>\
         <script type=\"application/json\" id=\"mesh-{place}-facts\">{}</script>\
         <script type=\"text/plain\" id=\"mesh-{place}\">{}</script></div>",
        count(mesh.vertices),
        count(mesh.faces),
        shown.unwrap_or_default(),
        json_for_script(facts),
        mesh.text,
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

/// The figures that a run is judged by.
pub(crate) fn main_figures(story: &RunStory) -> Vec<[String; 3]> {
    let mut figures = Vec::new();
    let mut add = |name: &str, value: String, hint: &str| figures.push([name.into(), value, hint.into()]);
    match &story.figures {
        Figures::Scene(metrics) => {
            if let Some(held_out) = metrics.held_out_mesh {
                add(
                    "PSNR",
                    format!("{:.2} dB", held_out.psnr),
                    "of the coloured mesh in views that were not trained on, on white",
                );
                add(
                    "Silhouette IoU",
                    format!("{:.4}", held_out.mask_iou),
                    "of the mesh and the masks of views that were not trained on",
                );
            }
            if let (Some(surface), Some(_)) = (&metrics.shape.surface, metrics.mesh) {
                let hint = "against the true surface, in edges of the object cube; papers print ten times that";
                add("Chamfer-L1", format!("{:.4}", surface.chamfer_l1), hint);
                if let Some(floor) = &metrics.shape.floor {
                    add(
                        "its floor",
                        format!("{:.4}", floor.chamfer_l1),
                        "what the true surface, sampled twice, scores",
                    );
                }
                if let Some(normals) = surface.normal_consistency {
                    add("Normals", format!("{:.3}", normals.mean), "mean cosine with the true surface's normals");
                }
            }
            if let Some(iou) = metrics.shape.volume_iou {
                add("Volume IoU", format!("{iou:.3}"), "against the true occupancy");
            }
            if let Some(coverage) = story.coverage {
                add(
                    "Observed surface",
                    format!("{:.1} %", 100.0 * (1.0 - coverage.unseen)),
                    "share of the area that at least one training photograph sees",
                );
            }
            add("Training", seconds(metrics.training_seconds), "wall time, preparation included");
            add("Processor time", seconds(metrics.resources.cpu_seconds), "of all cores together, the whole job");
            if let Some(peak) = metrics.resources.peak_memory {
                add("Memory", bytes(peak as f64), "the most that the process held at a time");
            }
            add("Stored field", bytes(metrics.bytes as f64), "what the field takes on disk");
            if let Some([_, faces]) = metrics.mesh {
                add("Mesh", format!("{} faces", count(faces)), "as written to mesh.ply and mesh.glb");
            }
        }
        Figures::Objects(metrics) => {
            if let Some(best) = metrics.validation {
                add(
                    "Silhouette IoU",
                    format!("{:.3}", best.mask_iou),
                    "of validation objects, at the step that stands for the run",
                );
                add("PSNR", format!("{:.2} dB", best.psnr), "of validation objects, on white");
            }
            add("Objects", count(metrics.objects), "trained on");
            add("Steps", count(metrics.steps), "of the checkpoint that stands for the run");
            add("Training", seconds(metrics.training_seconds), "wall time, all sessions");
            add("Parameters", count(metrics.parameters), "of encoder and decoder");
        }
    }
    figures
}

/// What is right and what is not.
fn findings(story: &RunStory) -> String {
    let mut html = String::from("<ul class=\"findings\">");
    story
        .findings
        .warnings
        .iter()
        .for_each(|text| html += &format!("<li class=\"warn\">{}</li>", escape(&sentence(text))));
    story.findings.good.iter().for_each(|text| html += &format!("<li class=\"good\">{}</li>", escape(text)));
    html + "</ul>"
}

/// Notes of the program begin small and end without a full stop; on a page they are sentences.
fn sentence(text: &str) -> String {
    let mut characters = text.chars();
    let first = characters.next().map_or(String::new(), |first| first.to_uppercase().collect());
    let end = if text.ends_with(['.', '!', '?', ')']) { "" } else { "." };
    format!("{first}{}{end}", characters.as_str())
}

/// Held-out views: sliders, maps and their figures.
pub(crate) fn views(story: &RunStory) -> String {
    if story.views.is_empty() {
        return String::new();
    }
    let scale = story.header.object_to_world.scale;
    let mut html = String::from("<div class=\"views\">");
    let _ = write!(
        html,
        "<p>{} Drag the line: photograph to its left, mesh to its right.</p>",
        if story.views_are_held_out {
            "These photographs were not trained on."
        } else {
            "No view was held out; these photographs taught the shape."
        }
    );
    if story.views.len() > 1 {
        html += "<div class=\"thumbs\" role=\"group\" aria-label=\"Views\">";
        for (i, view) in story.views.iter().enumerate() {
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
    for (i, view) in story.views.iter().enumerate() {
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
    let psnr = if view.psnr.is_finite() { format!("{:.2} dB", view.psnr) } else { "no difference".into() };
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

/// What was trained, with which settings, and what came of it on the way.
pub(crate) fn settings(story: &RunStory) -> String {
    let settings = &story.settings;
    let header = &story.header;
    let mut facts = vec![
        vec!["method".into(), settings.preset.into()],
        vec!["supervision".into(), header.method.supervision().to_string()],
        vec!["seed".into(), header.method.seed().to_string()],
        vec!["steps".into(), count(header.step)],
        vec!["data".into(), header.scene.display().to_string()],
    ];
    if let Some(scene) = &story.scene {
        let [train, held_out, test] = scene.views;
        let views = format!(
            "{train} to train on, {held_out} held out, {test} for testing; first of {}\u{d7}{}",
            scene.size.0, scene.size.1
        );
        facts.push(vec!["layout".into(), scene.format.clone()]);
        facts.push(vec!["photographs".into(), views]);
        let edge = crate::html::number(header.object_to_world.scale, 4);
        facts.push(vec!["object cube".into(), format!("its edge is {edge} units of the scene")]);
    }
    let changed: Vec<Vec<String>> = settings.changed.iter().map(|row| row.to_vec()).collect();
    let told = match changed.len() {
        0 => format!("<p>All settings are those of <code>--method {}</code>.</p>", settings.preset),
        n => format!(
            "<h3>{n} setting{} other than <code>--method {}</code> has</h3>{}",
            if n == 1 { "" } else { "s" },
            settings.preset,
            table(&["setting", "here", "preset"], &changed)
        ),
    };
    let course = match &story.figures {
        Figures::Scene(metrics) => format!("<div>{}{}</div>", timings(metrics), chosen(metrics)),
        Figures::Objects(_) => String::new(),
    };
    format!(
        "<div class=\"pair\"><div><div class=\"plain\">{}</div>{told}</div>{course}</div>\
         <details><summary>The whole configuration</summary><pre>{}</pre></details>",
        table(&["", ""], &facts),
        escape(&settings.whole)
    )
}

/// How fine the field became, and why.
fn chosen(metrics: &RunMetrics) -> String {
    if metrics.notes.is_empty() {
        return String::new();
    }
    let notes: String = metrics.notes.iter().map(|note| format!("<li>{}</li>", escape(&sentence(note)))).collect();
    format!(
        "<h3>How fine the field became</h3><p>A stage with twice the cells begins while held-out views gain from it, \
         and is taken back \
         when they do not.</p><ol class=\"notes\">{notes}</ol>"
    )
}

/// Where the time went.
fn timings(metrics: &RunMetrics) -> String {
    let mut rows = vec![vec!["training, preparation included".to_owned(), seconds(metrics.training_seconds)]];
    rows.extend(metrics.finishing_seconds.iter().map(|(part, time)| vec![part.clone(), seconds(*time)]));
    rows.push(vec!["processor time of the whole job, all cores".into(), seconds(metrics.resources.cpu_seconds)]);
    format!("<h3>Time</h3>{}", table(&["part", "wall time"], &rows))
}

/// Evaluations on unseen objects, by category.
pub(crate) fn evaluations(story: &RunStory) -> String {
    let tables = story.evaluations.iter().map(|(split, summary)| {
        let names: Vec<&String> = summary.mean_of_objects.figures.keys().collect();
        let heads: Vec<&str> =
            ["category", "objects"].into_iter().chain(names.iter().map(|name| name.as_str())).collect();
        let means =
            [("mean of categories", &summary.mean_of_categories), ("mean of objects", &summary.mean_of_objects)];
        let categories = summary.categories.iter().map(|(name, score)| (name.as_str(), score));
        let rows: Vec<Vec<String>> = categories
            .chain(means)
            .map(|(name, score)| {
                let figure =
                    |key: &&String| score.figures.get(*key).map_or(String::new(), |value| format!("{value:.4}"));
                [name.to_owned(), count(score.objects)].into_iter().chain(names.iter().map(figure)).collect()
            })
            .collect();
        format!(
            "<h3>{} objects of the {} split</h3>{}",
            count(summary.mean_of_objects.objects),
            escape(split),
            table(&heads, &rows)
        )
    });
    tables.collect()
}
