//! Reconstruction with a multi-resolution voxel grid: field, file, start, losses, optimiser, growth and trainer.

#![warn(missing_docs)]

mod active;
mod clock;
mod color;
mod config;
mod constants;
mod cubic;
mod error;
mod exact;
pub mod field;
#[cfg(feature = "gpu")]
mod gpu;
mod growth;
pub mod losses;
mod multires;
mod occupancy;
mod patch;
mod pixel_order;
mod refinement;
mod report;
mod start;
mod state;
mod step;
mod trainer;
mod views;
mod wrong_masks;

pub use active::ActiveNodes;
pub use clock::{Part, PartTimes};
pub use config::{Capacity, DisagreeingViews, GridConfig};
pub use error::{Error, Result};
#[cfg(feature = "gpu")]
pub use field::GpuGridField;
pub use field::{GridField, GridValues, file as grid_file};
pub use losses::GridLosses;
pub use occupancy::OccupancyBitmask;
pub use report::{StepReport, TrainerState};
pub use trainer::GridTrainer;
