//! The settings of a run, its times and its notes.

use dvr_train::{RunMetrics, ViewNames};

use crate::diagnostics::sentence;
use crate::html::{count, escape, seconds};
use crate::page::table;
use crate::summary::{Figures, RunSummary};

/// The run in facts, the settings that are not the defaults, times and notes, and the whole configuration.
pub(super) fn configuration(summary: &RunSummary) -> String {
    let settings = &summary.settings;
    let header = &summary.header;
    let mut facts = vec![
        vec!["method".into(), settings.preset.clone()],
        vec!["supervision".into(), header.common.supervision.to_string()],
        vec!["seed".into(), header.common.seed.to_string()],
        vec!["steps".into(), count(header.step)],
        vec!["data".into(), header.scene.display().to_string()],
    ];
    if let Some(scene) = &summary.scene {
        let [train, validation, test] = scene.views;
        let views = format!(
            "{train} to train on, {validation} for validation, {test} for testing; first of {}\u{d7}{}",
            scene.size.0, scene.size.1
        );
        facts.push(vec!["layout".into(), scene.format.clone()]);
        facts.push(vec!["photographs".into(), views]);
        facts.extend(header.views.iter().flat_map(parts));
        let edge = crate::html::number(header.object_to_world.scale, 4);
        facts.push(vec!["object cube".into(), format!("its edge is {edge} units of the scene")]);
    }
    let changed: Vec<Vec<String>> = settings.changed.iter().map(|row| row.to_vec()).collect();
    let text = match changed.len() {
        0 => format!("<p>All settings are the defaults of the method <code>{}</code>.</p>", settings.preset),
        n => format!(
            "<h3>{n} setting{} other than the defaults of the method <code>{}</code></h3>{}",
            if n == 1 { "" } else { "s" },
            settings.preset,
            table(&["setting", "value", "default"], &changed)
        ),
    };
    let aside = match &summary.figures {
        Figures::Scene(metrics) => format!("<div>{}{}</div>", timings(metrics), notes(metrics)),
        Figures::Objects(_) => String::new(),
    };
    format!(
        "<div class=\"pair\"><div><div class=\"plain\">{}</div>{text}</div>{aside}</div>\
         <details><summary>The whole configuration</summary><pre>{}</pre></details>",
        table(&["", ""], &facts),
        escape(&settings.whole)
    )
}

/// Which views are for what, by name, and why.
fn parts(views: &ViewNames) -> Vec<Vec<String>> {
    let named = [
        ("trained on", &views.train),
        ("for validation (they choose during the run)", &views.validation),
        ("for testing (nothing is chosen by them)", &views.test),
    ];
    let named = named.into_iter().filter(|(_, names)| !names.is_empty());
    let rows = named.map(|(part, names)| vec![part.to_owned(), names.join(", ")]);
    rows.chain([vec!["how they were divided".into(), sentence(&views.rule)]]).collect()
}

/// Notes of training: how fine the field became.
fn notes(metrics: &RunMetrics) -> String {
    if metrics.notes.is_empty() {
        return String::new();
    }
    let notes: String = metrics.notes.iter().map(|note| format!("<li>{}</li>", escape(&sentence(note)))).collect();
    format!(
        "<h3>Decisions of the run</h3><p>The number of cells per edge is doubled while that improves validation views, \
         and the last doubling is reverted when it does not.</p><ol class=\"notes\">{notes}</ol>"
    )
}

/// Time per part of the job.
fn timings(metrics: &RunMetrics) -> String {
    let mut rows = vec![vec!["training, preparation included".to_owned(), seconds(metrics.training_seconds)]];
    rows.extend(metrics.finishing_seconds.iter().map(|(part, time)| vec![part.clone(), seconds(*time)]));
    rows.push(vec!["CPU time of the whole job, all cores".into(), seconds(metrics.resources.cpu_seconds)]);
    format!("<h3>Time</h3>{}", table(&["part", "wall time"], &rows))
}
