//! Charts as SVG and CSV: curves with bands of seeds, dots with a Pareto front, and grids of cells.
//!
//! Written here because a chart of the report is part of its page: its colours are the page's (light and dark), its
//! text is text, its points answer to the pointer, and it weighs a few kilobytes. `plotters` draws with fixed colours
//! and `charming` needs a JavaScript library of a megabyte.
//!
//! ```
//! use dvr_report::chart::{Axis, Better, Chart, Series};
//!
//! let curve = Series::line("fast", vec![[0.5, 21.0], [1.0, 24.5], [2.0, 26.1]]);
//! let chart = Chart {
//!     title: "Quality against time".into(),
//!     x: Axis::log("training time, s"),
//!     y: Axis::linear("held-out PSNR, dB"),
//!     series: vec![curve],
//!     pareto: Some([Better::Less, Better::More]),
//! };
//! assert!(chart.to_svg().starts_with("<svg"));
//! assert_eq!(chart.to_csv().lines().nth(1), Some("fast,0.5,21,,"));
//! ```

mod draw;
mod grid;
mod legend;
mod scale;
mod series;

pub use grid::{Cell, HeatGrid};
pub use scale::{Axis, Scale};
pub use series::{Better, Series, median, pareto_front};

use crate::html::escape;

/// The style of all charts. A page that holds charts includes it once; [`Chart::to_svg`] brings it along.
pub const CHART_STYLE: &str = include_str!("../../assets/chart.css");

/// Colours of the palette, after which it begins again.
pub const PALETTE: usize = 8;

/// Curves or dots over two axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// What the chart shows.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// What is drawn, in the legend's order.
    pub series: Vec<Series>,
    /// Draws the front of the points that no other point of any series beats, by what is better on `[x, y]`.
    pub pareto: Option<[Better; 2]>,
}

impl Chart {
    /// Whether there is no point to draw.
    pub fn is_empty(&self) -> bool {
        !self.series.iter().flat_map(|series| &series.points).any(|[x, y]| self.x.holds(*x) && self.y.holds(*y))
    }

    /// A complete SVG file, light and dark as its viewer is.
    pub fn to_svg(&self) -> String {
        draw::svg(self, Some(CHART_STYLE))
    }

    /// The chart for a page that has [`CHART_STYLE`]: a `<figure>` with the SVG, its numbers as CSV, and buttons to
    /// save both.
    pub fn to_figure(&self) -> String {
        figure(&self.title, &draw::svg(self, None), &self.to_csv())
    }

    /// All points, one a line: series, x, y, and the low and high end of the band, where there is one at that x.
    pub fn to_csv(&self) -> String {
        let mut text = format!("series,{},{},low,high\n", csv_field(&self.x.title), csv_field(&self.y.title));
        for series in &self.series {
            let name = csv_field(&series.name);
            for [x, y] in &series.points {
                let band = series.band.iter().find(|band| band[0] == *x);
                let band = band.map_or(",".into(), |[_, low, high]| format!("{low},{high}"));
                text += &format!("{name},{x},{y},{band}\n");
            }
        }
        text
    }
}

/// A field of a CSV file, quoted where it must be (RFC 4180).
fn csv_field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

/// A drawing with its numbers, for a page.
fn figure(title: &str, svg: &str, csv: &str) -> String {
    format!(
        "<figure class=\"chart\" data-name=\"{}\">{svg}<figcaption><button type=\"button\" \
         data-save=\"svg\">SVG</button>\
         <button type=\"button\" data-save=\"csv\">CSV</button></figcaption><template>{}</template></figure>\n",
        escape(&file_name(title)),
        escape(csv),
    )
}

/// A title as a file's name: lower case, words joined by hyphens.
pub fn file_name(title: &str) -> String {
    let mut name = String::new();
    for character in title.chars().flat_map(char::to_lowercase) {
        if character.is_ascii_alphanumeric() {
            name.push(character);
        } else if !name.ends_with('-') && !name.is_empty() {
            name.push('-');
        }
    }
    let name = name.trim_end_matches('-');
    if name.is_empty() { "chart".into() } else { name.into() }
}

#[cfg(test)]
mod tests;
