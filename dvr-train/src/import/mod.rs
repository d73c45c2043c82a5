//! Checkpoints and configurations of DVR's reference code.

pub(crate) mod convert;
pub(crate) mod reference_config;
