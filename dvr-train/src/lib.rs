//! Training.
#![warn(missing_docs)]

mod batch;
mod checkpoint;
mod config;
mod error;
mod evaluate;
mod export;
mod finish;
pub mod losses;
mod metrics_log;
mod objective;
pub mod preview;
mod run;
mod trainer;
mod validate;
mod warm_start;

pub use batch::{PixelBatch, PixelSampling};
pub use checkpoint::{Best, CHECKPOINT_VERSION, Checkpoint, CheckpointHeader};
pub use config::{HullUse, LossWeights, MarchStage, OccupancyPoint, Supervision, TrainConfig};
pub use error::{Error, Result};
pub use evaluate::{ShapeEvaluation, ViewEvaluation, evaluate_shape, evaluate_views};
pub use export::{object_mesh, world_mesh};
pub use finish::{RunMetrics, SKIP_CELLS, extraction_warnings, finish, judging_views, surface_points};
pub use objective::{StepLoss, StepNoise, step_loss};
pub use run::{Observer, RunFolder, RunOptions, Stop, Trained, decoder_of, train};
pub use trainer::{StepReport, Trainer, ViewSplit};
pub use validate::{Agreement, agreement};
pub use warm_start::{carve_hull, hull_bound, warm_start};
