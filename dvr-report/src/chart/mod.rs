//! Charts as SVG and CSV: curves with bands over seeds, points with a Pareto front, and grids of cells.
//!
//! They are drawn here because a chart of the report is part of its page: its colours are the page's (light and dark), its
//! text is text, its points answer to the pointer, and it weighs a few kilobytes. `plotters` draws with fixed colours
//! and `charming` needs a JavaScript library of a megabyte.
//!
//! ```
//! use dvr_report::chart::{Axis, Better, Chart, Series};
//!
//! let curve = Series::line("grid", vec![[0.5, 21.0], [1.0, 24.5], [2.0, 26.1]]);
//! let chart = Chart {
//!     title: "Quality against time".into(),
//!     x: Axis::log("training time, s"),
//!     y: Axis::linear("test PSNR, dB"),
//!     series: vec![curve],
//!     pareto: Some([Better::Less, Better::More]),
//! };
//! assert!(chart.to_svg().starts_with("<svg"));
//! assert_eq!(chart.to_csv().lines().nth(1), Some("grid,0.5,21,,"));
//! ```

mod figure;
mod heat_grid;
mod legend;
mod plot;
mod scale;
mod series;
mod svg;

pub use figure::{CHART_STYLE, file_name};
pub use heat_grid::{Cell, HeatGrid};
pub use plot::Chart;
pub use scale::{Axis, Scale};
pub use series::{Better, Series, median};

#[cfg(test)]
mod tests;
