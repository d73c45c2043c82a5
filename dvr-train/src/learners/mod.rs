//! What trains: a field on rays, with its losses, batches and devices.

pub(crate) mod adam;
pub(crate) mod batch;
pub(crate) mod data_parallel;
pub(crate) mod learner;
pub mod losses;
pub(crate) mod objective;
pub(crate) mod sparse;
pub(crate) mod trainer;
pub(crate) mod warm_start;
