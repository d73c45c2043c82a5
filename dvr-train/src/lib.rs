//! Training.
#![warn(missing_docs)]

mod batch;
mod config;
mod error;
pub mod losses;
mod objective;

pub use batch::{PixelBatch, PixelSampling};
pub use config::{LossWeights, MarchStage, OccupancyPoint, Supervision, TrainConfig, WarmStart};
pub use error::{Error, Result};
pub use objective::{StepLoss, StepNoise, step_loss};
