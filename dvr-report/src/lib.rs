//! Reports of reconstructions: one HTML file that needs no network, with the mesh to turn around, held-out views beside
//! their renders, charts, settings, and what the reader should know before believing any of it.
//!
//! The pieces are useful alone: [`chart`] draws SVG and writes CSV, and a [`Page`] holds whatever sections it is given.
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
mod compare;
mod curves;
mod error;
mod findings;
pub mod html;
mod mesh_data;
mod page;
mod pictures;
mod run_section;
mod settings;
mod story;
mod surface;

pub use compare::{MAX_BYTES, SourceRun, run_report};
pub use curves::Curves;
pub use error::{Error, Result};
pub use findings::Findings;
pub use mesh_data::{EncodedMesh, encode};
pub use page::{Page, Section, table};
pub use pictures::{ViewPictures, view_pictures};
pub use settings::Settings;
pub use story::{Budget, Figures, RunStory, SceneFacts};
pub use surface::Coverage;
