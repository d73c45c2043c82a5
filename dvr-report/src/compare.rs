//! The report of one run, or of several side by side.

use std::fmt::Write;

use dvr_core::Scene;
use dvr_train::{CheckpointHeader, RunFolder};

use crate::curves::{Curves, charts};
use crate::error::Result;
use crate::html::escape;
use crate::page::{Page, Section, table};
use crate::run_section::{evaluations, main_figures, overview, settings, views};
use crate::story::{Budget, RunStory};

/// No report is larger, in bytes, unless there is nothing left to leave out.
pub const MAX_BYTES: usize = 10_000_000;

/// How often a page that came out too large is made again with less in it.
const ATTEMPTS: usize = 8;

/// A run to be told of.
pub struct SourceRun<'a> {
    /// Its folder.
    pub folder: RunFolder,
    /// What its checkpoint says about itself.
    pub header: CheckpointHeader,
    /// Its scene in the object space of training, where it is at hand.
    pub scene: Option<&'a Scene>,
}

/// The page of one run, or of several side by side. `program` is what the footer names.
///
/// # Errors
/// When a folder holds no finished run, or its files are damaged.
pub fn run_report(runs: &[SourceRun], program: &str) -> Result<String> {
    let mut budget = Budget::of_runs(runs.len());
    let mut html = String::new();
    for _ in 0..ATTEMPTS {
        let story = |run: &SourceRun| RunStory::gather(&run.folder, &run.header, run.scene, budget);
        let stories = runs.iter().map(story).collect::<Result<Vec<_>>>()?;
        html = page(&stories, program).to_html();
        if html.len() < MAX_BYTES {
            break;
        }
        budget = budget.tighter();
    }
    Ok(html)
}

/// The page of some runs.
fn page(stories: &[RunStory], program: &str) -> Page {
    let footer = format!("{program}. This file holds everything that it shows and asks nothing of the network.");
    match stories {
        [story] => {
            let mut sections = vec![Section::new("", overview(story, 0))];
            sections.extend(sections_of(story));
            let curves = curves_of(&[(story.name.as_str(), &story.curves)]);
            if !curves.is_empty() {
                sections.insert(sections.len() - 1, Section::new("Training", curves));
            }
            let method = format!(
                "{}, taught by {}, seed {}",
                story.settings.preset,
                story.header.method.supervision(),
                story.header.method.seed()
            );
            Page { title: story.title.clone(), subtitle: format!("{method}: run {}", story.name), sections, footer }
        }
        _ => several(stories, footer),
    }
}

/// Views, evaluations and settings of a run.
fn sections_of(story: &RunStory) -> Vec<Section> {
    let parts =
        [("Views", views(story)), ("Unseen objects", evaluations(story)), ("Settings and time", settings(story))];
    parts.into_iter().filter(|(_, html)| !html.is_empty()).map(|(title, html)| Section::new(title, html)).collect()
}

/// Charts in a grid.
fn curves_of(runs: &[(&str, &Curves)]) -> String {
    let figures: String = charts(runs).iter().map(|chart| chart.to_figure()).collect();
    if figures.is_empty() { figures } else { format!("<div class=\"charts\">{figures}</div>") }
}

/// The figures side by side, the curves over each other, then each run by itself behind a tab.
fn several(stories: &[RunStory], footer: String) -> Page {
    let names = unique_names(stories);
    let mut heads: Vec<String> = Vec::new();
    for [name, ..] in stories.iter().flat_map(main_figures) {
        if !heads.contains(&name) {
            heads.push(name);
        }
    }
    let row = |(story, name): (&RunStory, &String)| {
        let figures = main_figures(story);
        let figure = |head: &String| {
            figures.iter().find(|[name, ..]| name == head).map_or(String::new(), |[_, value, _]| value.clone())
        };
        let start = [
            name.clone(),
            story.title.clone(),
            story.settings.preset.into(),
            story.header.method.supervision().to_string(),
        ];
        start.into_iter().chain(heads.iter().map(figure)).collect()
    };
    let rows: Vec<Vec<String>> = stories.iter().zip(&names).map(row).collect();
    let all: Vec<&str> =
        ["run", "scene", "method", "taught by"].into_iter().chain(heads.iter().map(String::as_str)).collect();
    let curves: Vec<(&str, &Curves)> =
        names.iter().map(String::as_str).zip(stories.iter().map(|story| &story.curves)).collect();
    let mut sections = vec![Section::new("Side by side", format!("<div class=\"wide\">{}</div>", table(&all, &rows)))];
    let figures = curves_of(&curves);
    if !figures.is_empty() {
        sections.push(Section::new("Training", figures));
    }
    let mut tabs = String::from("<div class=\"tabs\" role=\"tablist\" aria-label=\"Runs\">");
    let mut panels = String::new();
    for (i, (story, name)) in stories.iter().zip(&names).enumerate() {
        let _ = write!(
            tabs,
            "<button type=\"button\" role=\"tab\" data-tab=\"{i}\" aria-selected=\"{}\">{}</button>",
            i == 0,
            escape(name)
        );
        let parts = sections_of(story);
        let parts: String = parts.iter().map(|part| format!("<h3>{}</h3>{}", escape(&part.title), part.html)).collect();
        let hidden = if i == 0 { "" } else { " hidden" };
        let _ = write!(panels, "<div role=\"tabpanel\" data-panel=\"{i}\"{hidden}>{}{parts}</div>", overview(story, i));
    }
    sections.push(Section::new("Each run", format!("{tabs}</div>{panels}")));
    let mut titles: Vec<&str> = stories.iter().map(|story| story.title.as_str()).collect();
    titles.dedup();
    Page { title: titles.join(", "), subtitle: format!("{} runs side by side", stories.len()), sections, footer }
}

/// Names that tell the runs apart.
fn unique_names(stories: &[RunStory]) -> Vec<String> {
    let count = |name: &str| stories.iter().filter(|story| story.name == name).count();
    let name = |(i, story): (usize, &RunStory)| {
        if count(&story.name) > 1 { format!("{} ({})", story.name, i + 1) } else { story.name.clone() }
    };
    stories.iter().enumerate().map(name).collect()
}
