//! Reports of reconstructions: one HTML file that needs no network, with the mesh in 3D, test views beside their
//! renders, charts, settings, and diagnostics that the reader should know before trusting the mesh.
//!
//! [`run_report`] makes the page of one run, or of several side by side, from their folders. Its parts are useful alone:
//! [`chart`] draws SVG and writes CSV, [`Curves`] reads `metrics.csv`, and a [`Page`] holds any sections.
//!
//! ```
//! use dvr_report::chart::{Axis, Chart, Series};
//! use dvr_report::{Page, Section};
//!
//! let curve = Series::line("bunny", vec![[1.0, 0.004], [10.0, 0.0029]]);
//! let chart = Chart {
//!     title: "Chamfer-L1 against time".into(),
//!     x: Axis::log("time, s"),
//!     y: Axis::log("Chamfer-L1, edges of the object cube"),
//!     series: vec![curve],
//!     pareto: None,
//! };
//! let page = Page {
//!     title: "How long is long enough?".into(),
//!     sections: vec![Section::new("Curves", chart.to_figure())],
//!     ..Page::default()
//! };
//! let html = page.to_html();
//! assert!(html.starts_with("<!doctype html>") && html.contains("Chamfer-L1 against time"));
//! ```

#![warn(missing_docs)]

pub mod chart;
mod coverage;
mod curves;
mod diagnostics;
mod error;
mod html;
mod mesh_data;
mod page;
mod pictures;
mod region_pictures;
mod report;
mod run_mesh;
mod run_section;
mod settings;
mod side_by_side;
mod summary;

pub use curves::Curves;
pub use diagnostics::Diagnostic;
pub use error::{Error, Result};
pub use page::{Page, Section, table};
pub use pictures::jpeg;
pub use report::{ReportWords, SourceRun, run_report};
pub use run_section::Remedy;
