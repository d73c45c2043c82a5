//! dvr-train
