//! What joins several crates. One binary holds all suites: each that stood alone would link everything anew.
//!
//! Apart are those that change what holds for a whole process: the precision of a device, a limit of memory.

mod camera_refinement;
mod data_parallel;
mod faults;
mod fields;
mod fixtures;
mod fuzz_readers;
mod gather;
mod grid_on_gpu;
mod network_on_gpu;
mod pytorch_checkpoints;
mod ranges;
mod training_step;
mod view_parts;
