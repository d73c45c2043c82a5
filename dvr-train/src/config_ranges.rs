//! The ranges of the numbers of a network's configuration, and of those for many objects.

use dvr_core::hull::VisualHull;
use dvr_core::number_range::{NumberRange, above, nested, real, whole};
use dvr_model::{DecoderConfig, EncoderConfig, ShapeDecoderConfig};

use crate::config::TrainConfig;
use crate::objects::config::ObjectsConfig;
use crate::objects::systems::config::SystemConfig;

/// Most steps, and most steps between two events.
const STEPS: u64 = 1_000_000_000;

/// Most rays, or points, of a step: the memory of a step is checked besides.
const RAYS: u64 = 1 << 22;

/// Largest weight of a loss.
const WEIGHT: f64 = 1e6;

/// All numbers but those of the network.
const RANGES: &[NumberRange] = &[
    whole("seed", 0, u64::MAX),
    whole("steps", 1, STEPS),
    whole("hull.resolution", 2, VisualHull::MAX_RESOLUTION as u64),
    whole("hull.warm_start_steps", 0, STEPS),
    whole("hull.warm_start_points", 1, RAYS),
    whole("rays", 1, RAYS),
    whole("patch_size", 1, 256),
    real("object_share", 0.0, 1.0),
    whole("march[].from_percent", 0, 100),
    whole("march[].samples", 2, 8192),
    whole("root_steps", 0, 100),
    real("slope.epsilon", 0.0, 1.0),
    real("losses.color", 0.0, WEIGHT),
    real("losses.detached_color", 0.0, WEIGHT),
    real("losses.image_gradient", 0.0, WEIGHT),
    real("losses.depth", 0.0, WEIGHT),
    real("losses.sparse_depth", 0.0, WEIGHT),
    whole("losses.sparse_points", 1, RAYS),
    real("losses.free_space", 0.0, WEIGHT),
    real("losses.occupancy", 0.0, WEIGHT),
    real("losses.normal", 0.0, WEIGHT),
    real("losses.normal_distance", 0.0, 1.0),
    real("losses.normal_difference", 0.0, 1.0),
    whole("losses.normal_points", 0, u64::MAX),
    above("learning_rate", 0.0, 10.0),
    whole("milestones_percent[]", 0, 100),
    real("learning_rate_factor", 0.0, 10.0),
    whole("hold_out_every", 0, 1_000_000),
    whole("validate_every", 1, STEPS),
    whole("checkpoint_every", 1, STEPS),
];

/// What only datasets of objects have, but for the encoder.
const OF_OBJECTS: &[NumberRange] = &[
    whole("objects", 1, 4096),
    whole("views", 1, 4096),
    real("hull_depth", 0.0, WEIGHT),
    real("hull_occupancy", 0.0, WEIGHT),
    whole("points", 1, RAYS),
    real("color_jitter", 0.0, 2.0),
    real("box_share", 0.0, 1.0),
    real("inside_share", 0.0, 1.0),
    real("threshold", 0.001, 0.999),
    whole("validate_objects", 0, 1_000_000),
];

/// What systems of other papers have, but for encoder and decoder.
const OF_SYSTEMS: &[NumberRange] = &[
    whole("seed", 0, u64::MAX),
    whole("steps", 1, STEPS),
    whole("code_dim", 1, 4096),
    whole("objects", 1, 4096),
    whole("views", 1, 4096),
    whole("rays", 1, RAYS),
    whole("points", 1, 1 << 20),
    real("threshold", 0.001, 0.999),
    above("sharpness", 0.0, 1.0),
    real("laplacian", 0.0, WEIGHT),
    real("flatness", 0.0, WEIGHT),
    above("learning_rate", 0.0, 10.0),
    whole("milestones_percent[]", 0, 100),
    real("learning_rate_factor", 0.0, 10.0),
    whole("validate_objects", 0, 1_000_000),
    whole("validate_every", 1, STEPS),
    whole("checkpoint_every", 1, STEPS),
];

impl SystemConfig {
    /// The range of every number.
    pub fn ranges() -> Vec<NumberRange> {
        let parts = [nested("encoder", EncoderConfig::RANGES), nested("decoder", ShapeDecoderConfig::RANGES)];
        [OF_SYSTEMS.to_vec(), parts.concat()].concat()
    }
}

impl TrainConfig {
    /// The range of every number.
    pub fn ranges() -> Vec<NumberRange> {
        [RANGES.to_vec(), nested("model", DecoderConfig::RANGES)].concat()
    }
}

impl ObjectsConfig {
    /// The range of every number.
    pub fn ranges() -> Vec<NumberRange> {
        [TrainConfig::ranges(), OF_OBJECTS.to_vec(), nested("encoder", EncoderConfig::RANGES)].concat()
    }
}
