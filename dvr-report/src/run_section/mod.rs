//! One run as HTML.

mod configuration;
mod evaluations;
mod figures;
mod overview;
mod parts;
mod region;
mod viewer;
mod views;

pub(crate) use figures::main_figures;
pub use overview::Remedy;
pub(crate) use overview::overview;
pub(crate) use parts::{curves_of, sections_of};
