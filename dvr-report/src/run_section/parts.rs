//! The parts of a page that a run has besides its overview.

use super::configuration::configuration;
use super::evaluations::evaluations;
use super::region::region;
use super::views::views;
use crate::curves::{Curves, charts};
use crate::page::Section;
use crate::summary::RunSummary;

/// Views, region, evaluations and settings of a run; those that are empty are left out.
pub(crate) fn sections_of(summary: &RunSummary) -> Vec<Section> {
    let parts = [
        ("Views", views(summary)),
        ("Region of interest", region(summary)),
        ("Unseen objects", evaluations(summary)),
        ("Settings and time", configuration(summary)),
    ];
    parts.into_iter().filter(|(_, html)| !html.is_empty()).map(|(title, html)| Section::new(title, html)).collect()
}

/// The curves of some runs as charts in a grid; empty where there are none.
pub(crate) fn curves_of(runs: &[(&str, &Curves)]) -> String {
    let figures: String = charts(runs).iter().map(|chart| chart.to_figure()).collect();
    if figures.is_empty() { figures } else { format!("<div class=\"charts\">{figures}</div>") }
}
