//! Several runs side by side: figures in one table, curves in the same charts, then each run behind a tab.

use std::fmt::Write;

use crate::curves::Curves;
use crate::html::escape;
use crate::page::{Page, Section, table};
use crate::run_section::{Remedy, curves_of, main_figures, overview, sections_of};
use crate::summary::RunSummary;

/// The page of several runs.
pub(crate) fn side_by_side(summaries: &[RunSummary], remedy: &Remedy, footer: String) -> Page {
    let names = unique_names(summaries);
    let mut sections = vec![Section::new("Side by side", figures(summaries, &names))];
    let curves: Vec<(&str, &Curves)> =
        names.iter().map(String::as_str).zip(summaries.iter().map(|summary| &summary.curves)).collect();
    let charts = curves_of(&curves);
    if !charts.is_empty() {
        sections.push(Section::new("Training", charts));
    }
    sections.push(Section::new("Each run", tabs(summaries, &names, remedy)));
    let mut titles: Vec<&str> = summaries.iter().map(|summary| summary.title.as_str()).collect();
    titles.dedup();
    Page { title: titles.join(", "), subtitle: format!("{} runs side by side", summaries.len()), sections, footer }
}

/// One row per run; figures that no run has get no column.
fn figures(summaries: &[RunSummary], names: &[String]) -> String {
    let mut heads: Vec<String> = Vec::new();
    for [name, ..] in summaries.iter().flat_map(main_figures) {
        if !heads.contains(&name) {
            heads.push(name);
        }
    }
    let row = |(summary, name): (&RunSummary, &String)| {
        let figures = main_figures(summary);
        let figure = |head: &String| {
            figures.iter().find(|[name, ..]| name == head).map_or(String::new(), |[_, value, _]| value.clone())
        };
        let start = [
            name.clone(),
            summary.title.clone(),
            summary.settings.preset.clone(),
            summary.header.common.supervision.to_string(),
        ];
        start.into_iter().chain(heads.iter().map(figure)).collect()
    };
    let rows: Vec<Vec<String>> = summaries.iter().zip(names).map(row).collect();
    let all: Vec<&str> =
        ["run", "scene", "method", "supervision"].into_iter().chain(heads.iter().map(String::as_str)).collect();
    format!("<div class=\"wide\">{}</div>", table(&all, &rows))
}

/// Each run behind a tab.
fn tabs(summaries: &[RunSummary], names: &[String], remedy: &Remedy) -> String {
    let mut tabs = String::from("<div class=\"tabs\" role=\"tablist\" aria-label=\"Runs\">");
    let mut panels = String::new();
    for (i, (summary, name)) in summaries.iter().zip(names).enumerate() {
        let _ = write!(
            tabs,
            "<button type=\"button\" role=\"tab\" data-tab=\"{i}\" aria-selected=\"{}\">{}</button>",
            i == 0,
            escape(name)
        );
        let parts = sections_of(summary);
        let parts: String = parts.iter().map(|part| format!("<h3>{}</h3>{}", escape(&part.title), part.html)).collect();
        let hidden = if i == 0 { "" } else { " hidden" };
        let top = overview(summary, i, remedy);
        let _ = write!(panels, "<div role=\"tabpanel\" data-panel=\"{i}\"{hidden}>{top}{parts}</div>");
    }
    format!("{tabs}</div>{panels}")
}

/// Names that distinguish the runs.
fn unique_names(summaries: &[RunSummary]) -> Vec<String> {
    let count = |name: &str| summaries.iter().filter(|summary| summary.name == name).count();
    let name = |(i, summary): (usize, &RunSummary)| {
        if count(&summary.name) > 1 { format!("{} ({})", summary.name, i + 1) } else { summary.name.clone() }
    };
    summaries.iter().enumerate().map(name).collect()
}
