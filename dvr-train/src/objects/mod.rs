//! One model for many objects: a picture in, a shape out (DVR, section 4.2; Mescheder et al. 2019, Occupancy Networks).

mod config;
mod draw;
mod loader;
mod model;
mod run;
mod trainer;
mod validate;

pub use config::ObjectsConfig;
pub use model::ObjectModel;
pub use run::{ObjectsMetrics, TrainedObjects, finish_objects, train_objects};
pub use trainer::ObjectsTrainer;
