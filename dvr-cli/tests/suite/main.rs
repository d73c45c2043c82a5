//! The binary from the command line. One binary holds all suites: each that stood alone would link the whole program anew.
//!
//! One of them: `cargo test -p dvr-cli --test suite kills::`.

mod advice;
mod bad_input;
mod bench;
mod cameras;
#[cfg(target_os = "linux")]
mod disks;
mod drop_support;
mod end_to_end;
mod eval;
mod eval_dtu;
mod eval_points;
mod faces;
#[cfg(feature = "gpu")]
mod gpu;
mod grid_method;
mod import;
mod kills;
mod layouts;
#[cfg(unix)]
mod masks_by_program;
mod memory;
mod object_datasets;
mod paper;
mod points2mesh;
mod pose_sets;
mod reading;
mod real_size;
mod render;
mod report;
#[cfg(unix)]
mod results_script;
#[cfg(unix)]
mod signals;
mod stress;
mod support;
mod texture;
mod user_files;
mod view_color;
mod view_parts;
