//! Training: methods, run folders, learners, export and evaluation, for one scene or for datasets of many objects.
//!
//! A [`Method`] says what is trained and how; [`METHODS`] lists those that are known by name, and [`FieldMethod`] makes
//! one of any field. [`train`] carries a method through a run with checkpoints and validation, and [`finish`] makes its
//! mesh, preview and figures. Here the whole job on a scene that this example renders itself, a ball seen from eight
//! sides:
//!
//! ```
//! use burn::tensor::Device;
//! use dvr_core::Scene;
//! use dvr_core::mesh::{TexturedMesh, shapes};
//! use dvr_core::synth::{SynthConfig, render_dataset};
//! use dvr_train::{MeshOptions, RunFolder, RunOptions, Supervision, finish, method_by_name, train};
//!
//! // A ball in the layout of the DVR datasets, and back.
//! let folder = tempfile::tempdir()?;
//! let ball = TexturedMesh { mesh: shapes::icosphere(2, 1.0), ..TexturedMesh::default() };
//! let few = SynthConfig { views: 8, width: 16, height: 16, surface_points: 100, occupancy_points: 100, ..SynthConfig::default() };
//! render_dataset(&ball, "ball", "balls", folder.path(), &few, &|_, _| ())?;
//! let mut scene = Scene::read(folder.path().join("balls/ball"))?;
//!
//! // A small network takes the masks' hull as its first shape; then rays train it.
//! let small = serde_json::json!({
//!     "steps": 3, "rays": 64, "model": { "hidden": 16 }, "hull": { "resolution": 32, "warm_start_steps": 10 },
//! });
//! let method = method_by_name("network", Supervision::Rgb)?.overridden(&small)?;
//! let run = RunFolder::new(folder.path().join("run"));
//! let _writing = run.create()?;
//! let options = RunOptions::new(run.clone(), Device::flex());
//! let trained = train(&mut scene, method.as_ref(), None, &options, &mut ())?;
//! let results = finish(&scene, method.as_ref(), &trained, &run, &MeshOptions::with_resolution(32), &mut ())?;
//! println!("{} steps, {:?}", results.metrics.steps, results.metrics.test);
//! assert!(run.last().is_file() && run.metrics_json().is_file());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(missing_docs)]

mod cameras;
mod config;
mod config_ranges;
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
pub use dvr_core::{Supervision, ViewNames, ViewSplit};
pub use dvr_grid::{Capacity, DisagreeingViews, GridConfig, GridLosses, GridTrainer, Part, PartTimes};
pub use dvr_render::{ViewMetrics, view_metrics};
pub use error::{CodesError, Error, Result};
pub use evaluate::{
    DepthMapsEvaluation, PointsEvaluation, ShapeEvaluation, ViewEvaluation, evaluate_shape, evaluate_views,
};
pub use export::bake::bake_colors;
pub use export::mesh::{ColorSource, MeshOptions, ObjectMesh, object_mesh, with_faces, world_mesh, write_run_mesh};
pub use export::pictures::{ChosenPictures, PicturesOf, RunPictures};
pub use export::preview;
pub use export::real_size::{KnownLength, MeasuredLength, RealSize};
pub use export::run_metrics::RunMetrics;
pub use export::run_results::{RunResults, finish};
pub use export::support::Support;
pub use export::texture::photo_texture;
pub use export::views::surface_points;
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
pub use methods::host_memory::{HostMemory, MemoryShares, check_host_memory};
pub use methods::hull::hull;
pub use methods::memory_estimate::check_memory;
pub use methods::method::{Method, Needs, ObjectsTraining, Schedule, Start};
pub use methods::network::network;
pub use methods::object_model::load_object;
pub use methods::objects::{ObjectsMethod, objects, objects_classic, onet};
pub use methods::record::{CommonSettings, MethodRecord};
pub use methods::systems::SystemMethod;
pub use methods::trained_model::TrainedModel;
pub use methods::{METHODS, MethodEntry, load_model, method_by_name, method_of};
pub use objects::predict::{Prediction, predict};
pub use objects::{
    Evaluation, FieldsModel, MeanScore, MeanShapes, Measurement, Mirror, NearestPicture, ObjectModel, ObjectScore,
    ObjectsConfig, ObjectsMetrics, ObjectsTrainer, Predictor, Results, Shape, Shard, StoredResults, Summary, Symmetry,
    System, SystemConfig, SystemModel, SystemTrainer, TrainedObjects, Unmeasured, evaluated_input, finish_objects,
    merge_results, read_results, resolved_for_dataset, to_markdown, train_objects, write_summaries,
};
pub use observer::Observer;
pub use resources::Resources;
pub use run::best::Best;
pub use run::checkpoint::{CHECKPOINT_VERSION, Checkpoint, CheckpointHeader};
pub use run::folder::RunFolder;
pub use run::metrics_log::is_loss_term;
pub use run::options::{RunOptions, RunOutcome, Stop, Trained};
pub use run::train::train;
