//! What trains: a field on rays, with its losses, batches and devices.

pub(crate) mod adam;
pub(crate) mod batch;
pub(crate) mod data_parallel;
mod field_learner;
mod grid_learner;
pub(crate) mod learner;
pub mod losses;
pub(crate) mod module_state;
pub(crate) mod objective;
pub(crate) mod sparse;
pub(crate) mod step_report;
pub(crate) mod trainer;
pub(crate) mod warm_start;
