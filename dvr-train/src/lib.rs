//! Losses, schedules, the trainer, run folders and evaluation.
//!
//! The whole job on a scene that this example renders itself: a ball, seen from eight sides, trained for a few steps.
//!
//! ```
//! use std::sync::atomic::AtomicBool;
//!
//! use burn::tensor::Device;
//! use dvr_core::dataset::{ReadOptions, read_scene};
//! use dvr_core::mesh::{TexturedMesh, shapes};
//! use dvr_core::synth::{SynthConfig, render_dataset};
//! use dvr_train::{Supervision, TrainConfig, Trainer, ViewSplit, carve_hull, hull_bound, warm_start};
//!
//! // A ball in the layout of the DVR datasets, and back.
//! let folder = tempfile::tempdir()?;
//! let ball = TexturedMesh { mesh: shapes::icosphere(2, 1.0), ..TexturedMesh::default() };
//! let few = SynthConfig { views: 8, width: 16, height: 16, surface_points: 100, occupancy_points: 100, ..SynthConfig::default() };
//! render_dataset(&ball, "ball", "balls", folder.path(), &few, &|_, _| ())?;
//! let scene = read_scene(&folder.path().join("balls/ball"), &ReadOptions::default())?;
//!
//! // A small network takes the masks' hull as its first shape; then rays train it.
//! let device = Device::flex();
//! let mut config = TrainConfig { rays: 64, steps: 3, ..TrainConfig::new(Supervision::Rgb) };
//! config.model.hidden = 16;
//! config.hull.warm_start_steps = 10;
//! let views = ViewSplit::new(&scene, config.hold_out_every)?;
//! let hull = carve_hull(&views.train, 32)?;
//! let field = config.model.init(&device.clone().autodiff());
//! let field = warm_start(field, &hull, &config, &device, &AtomicBool::new(false), |_| ());
//! let mut trainer = Trainer::new(field, views, config, device).with_bound(hull_bound(&hull));
//! for _ in 0..3 {
//!     let report = trainer.step()?;
//!     println!("step {}: loss {:.3}", report.step, report.loss);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(missing_docs)]

mod cameras;
mod config;
mod error;
mod evaluate;
mod export;
mod import;
mod learners;
mod methods;
mod objects;
mod observer;
mod resources;
mod run;

pub use cameras::{RefinedCameras, refine_cameras};
pub use config::{HullConfig, LossWeights, MarchStage, OccupancyPoint, TrainConfig};
pub use dvr_core::{Supervision, ViewSplit};
pub use dvr_grid::{Capacity, DisagreeingViews, GridConfig, GridLosses, GridTrainer, Part, PartTimes};
pub use dvr_render::{ViewMetrics, view_metrics};
pub use error::{CodesError, Error, Result};
pub use evaluate::{ShapeEvaluation, ViewEvaluation, evaluate_shape, evaluate_views};
pub use export::bake::bake_colors;
pub use export::mesh::{ColorSource, MeshOptions, object_mesh, world_mesh};
pub use export::preview;
pub use export::run_metrics::RunMetrics;
pub use export::run_results::{RunResults, extraction_warnings, finish};
pub use export::views::{surface_points, unseen_views};
pub use import::convert::{ImportOptions, ImportedScene, import};
pub use import::reference_config::ReferenceConfig;
pub use learners::batch::{PixelBatch, PixelSampling, Pixels};
pub use learners::learner::{Learner, LearnerState};
pub use learners::losses;
pub use learners::objective::{StepLoss, StepNoise, sparse_depth_loss, step_loss};
pub use learners::sparse::SparseTargets;
pub use learners::step_report::StepReport;
pub use learners::trainer::Trainer;
pub use learners::warm_start::{carve_hull, hull_bound, warm_start};
pub use methods::classic::classic;
pub use methods::field_method::FieldMethod;
pub use methods::grid::{GridMethod, grid};
pub use methods::hull::hull;
pub use methods::memory_estimate::check_memory;
pub use methods::method::{Hardware, Method, Needs, Schedule, Start};
pub use methods::network::network;
pub use methods::object_model::load_object;
pub use methods::objects::{ObjectsMethod, objects, objects_classic};
pub use methods::record::{CommonSettings, MethodRecord};
pub use methods::trained_model::TrainedModel;
pub use methods::{METHODS, MethodEntry, load_model, method_by_name, method_of};
pub use objects::predict::{Prediction, predict};
pub use objects::{
    Evaluation, MeanScore, MeanShapes, Measurement, NearestPicture, ObjectModel, ObjectScore, ObjectsConfig,
    ObjectsMetrics, ObjectsTrainer, Predictor, Results, Shape, Shard, Summary, TrainedObjects, evaluated_input,
    finish_objects, merge_results, read_results, to_markdown, train_objects, write_summaries,
};
pub use observer::Observer;
pub use resources::Resources;
pub use run::best::Best;
pub use run::checkpoint::{CHECKPOINT_VERSION, Checkpoint, CheckpointHeader};
pub use run::folder::RunFolder;
pub use run::metrics_log::is_loss_term;
pub use run::options::{RunOptions, RunOutcome, Stop, Trained};
pub use run::train::train;
