//! Losses.

pub(crate) mod patch;
