//! One model for many objects: a picture in, a shape out (DVR, section 4.2; Mescheder et al. 2019, Occupancy Networks).

mod color_jitter;
pub(crate) mod config;
mod draw;
mod evaluate;
mod fields_task;
mod hulls;
mod kept;
mod loader;
mod mean_shape;
pub(crate) mod mirror;
#[cfg(test)]
mod mirror_tests;
pub(crate) mod model;
mod nearest_picture;
mod object_drawer;
pub(crate) mod object_model;
pub(crate) mod predict;
mod predictor;
mod results;
mod run;
pub(crate) mod shape;
mod summary;
pub(crate) mod systems;
mod task;
#[cfg(test)]
mod tests;
mod trainer;
mod validate;
mod voxel_values;

pub use config::ObjectsConfig;
pub use evaluate::{Evaluation, Shard};
pub use mean_shape::MeanShapes;
pub use mirror::{Mirror, Symmetry};
pub use model::FieldsModel;
pub use nearest_picture::NearestPicture;
pub use object_model::ObjectModel;
pub use predictor::{Predictor, evaluated_input};
pub use results::{Measurement, ObjectScore, Results, StoredResults, Unmeasured, read_results};
pub use run::{ObjectsMetrics, TrainedObjects, finish_objects, resolved_for_dataset, train_objects};
pub use shape::Shape;
pub use summary::{MeanScore, Summary, merge_results, to_markdown, write_summaries};
pub use systems::config::{System, SystemConfig};
pub use systems::model::SystemModel;
pub use systems::task::SystemTrainer;
pub use trainer::ObjectsTrainer;
