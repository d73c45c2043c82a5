//! The commands: each reads its arguments, calls the library and prints.

pub mod bench;
mod benchmark_page;
mod child;
mod dataset_of_run;
pub mod devices;
pub mod eval;
mod eval_objects;
pub mod export;
pub mod import;
pub mod info;
mod job;
mod kept_row;
pub mod mesh;
mod meshing;
mod method_of_args;
mod notes;
mod points_table;
pub mod predict;
mod provenance;
pub mod render;
pub mod report;
mod resumed;
mod run_start;
mod scene_reading;
mod shape_table;
mod simplified;
mod stored_run;
pub mod stress;
pub mod synth;
pub mod texture;
pub mod train;
mod train_objects;

use meshing::{OBJECT_RESOLUTION, SCENE_RESOLUTION, mesh_options, run_mesh_options, surface_options};
use notes::print_notes;
use scene_reading::{SceneReading, refinement_notes};
use stored_run::{load_model, load_run, place_for, scene_of_run};
