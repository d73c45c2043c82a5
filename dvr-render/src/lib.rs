//! dvr-render

#![warn(missing_docs)]

pub mod extract;
