//! dvr-render
