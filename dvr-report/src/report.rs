//! The report of one run, or of several side by side.

use dvr_core::Scene;
use dvr_train::{CheckpointHeader, RunFolder};

use crate::error::Result;
use crate::page::{Page, Section};
use crate::run_section::{Remedy, curves_of, overview, sections_of};
use crate::side_by_side::side_by_side;
use crate::summary::{Budget, RunSummary};

/// Largest size of a report, in bytes, unless there is nothing left to leave out.
const MAX_BYTES: usize = 10_000_000;

/// How often a page that is too large is made again with less in it.
const ATTEMPTS: usize = 8;

/// A run to report on.
pub struct SourceRun<'a> {
    /// Its folder.
    pub folder: RunFolder,
    /// The header of its checkpoint.
    pub header: CheckpointHeader,
    /// Its scene in the object space of training, where it was found.
    pub scene: Option<&'a Scene>,
}

/// Words of the program that makes a report.
pub struct ReportWords<'a> {
    /// Name, version and commit, for the footer.
    pub program: &'a str,
    /// What a user of the program can do about a diagnostic.
    pub remedy: &'a Remedy<'a>,
}

/// The page of one run, or of several side by side, as HTML.
///
/// # Errors
/// [`Error::NotFinished`](crate::Error::NotFinished) when a folder holds no finished run, and others when its files are
/// damaged.
pub fn run_report(runs: &[SourceRun], words: &ReportWords) -> Result<String> {
    let mut budget = Budget::of_runs(runs.len());
    let mut html = String::new();
    for _ in 0..ATTEMPTS {
        let summary = |run: &SourceRun| RunSummary::gather(&run.folder, &run.header, run.scene, budget);
        let summaries = runs.iter().map(summary).collect::<Result<Vec<_>>>()?;
        html = page(&summaries, words).to_html();
        if html.len() < MAX_BYTES {
            break;
        }
        budget = budget.tighter();
    }
    Ok(html)
}

/// The page of some runs.
fn page(summaries: &[RunSummary], words: &ReportWords) -> Page {
    let footer = format!("{}. This file is complete: it loads nothing from the network.", words.program);
    match summaries {
        [summary] => one(summary, words.remedy, footer),
        _ => side_by_side(summaries, words.remedy, footer),
    }
}

/// The page of one run.
fn one(summary: &RunSummary, remedy: &Remedy, footer: String) -> Page {
    let mut sections = vec![Section::new("", overview(summary, 0, remedy))];
    sections.extend(sections_of(summary));
    let curves = curves_of(&[(summary.name.as_str(), &summary.curves)]);
    if !curves.is_empty() {
        sections.insert(sections.len() - 1, Section::new("Training", curves));
    }
    let (supervision, seed) = (summary.header.common.supervision, summary.header.common.seed);
    let method = format!("{}, supervision {supervision}, seed {seed}", summary.settings.preset);
    Page { title: summary.title.clone(), subtitle: format!("{method}: run {}", summary.name), sections, footer }
}
