//! dvr-model
