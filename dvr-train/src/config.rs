//! Everything that determines a training run, in one serialisable place.

use dvr_core::number_range::{OutOfRange, check_config};
use dvr_core::{HOLD_OUT_EVERY, Supervision};
use dvr_model::DecoderConfig;
use dvr_render::{RootMethod, SlopeRule};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::learners::batch::PixelSampling;
use crate::methods::overrides::overridden;

/// Weights of the losses. A weight of 0 leaves the term out of the computation altogether.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossWeights {
    /// Colour of hits, L1. Its gradient shapes the surface.
    pub color: f64,
    /// Colour of hits, L1, with the surface held still: trains the texture alone.
    pub detached_color: f64,
    /// Image gradient over neighbouring pixels of hits.
    pub image_gradient: f64,
    /// Depth of hits against depth maps.
    pub depth: f64,
    /// Whether the depth loss is the distance of points in object space rather than the difference in camera z.
    pub depth_on_points: bool,
    /// Depth at the projections of sparse points, where the dataset has them (COLMAP, `pcl.npz`).
    pub sparse_depth: f64,
    /// Sparse points a step.
    pub sparse_points: usize,
    /// Free space along rays of background pixels.
    pub free_space: f64,
    /// Occupancy somewhere on rays of object pixels that hit nothing.
    pub occupancy: f64,
    /// Smoothness of the normals at hits.
    pub normal: f64,
    /// Edge of the box around a hit from which its neighbour is drawn, object units.
    pub normal_distance: f64,
    /// Distance over which central differences take the normals, object units; 0 takes exact derivatives.
    ///
    /// The exact normals of a ReLU network do not move with its biases (their masks are locally constant);
    /// differences, DVR's reference code's way, feel the kinks within a step and train the biases.
    pub normal_difference: f64,
    /// Most hits, evenly chosen, that the normal term looks at in a step: it costs eight evaluations a hit.
    pub normal_points: usize,
}

/// Where on a ray of an object pixel that hits nothing occupancy is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OccupancyPoint {
    /// At a random depth in the cube, as in DVR's reference code.
    Random,
    /// Where the logit is largest already. Thin parts train much better: the demand does not wander.
    Densest,
}

/// What the masks alone are used for: their visual hull.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HullConfig {
    /// Voxels along an edge of the hull.
    pub resolution: usize,
    /// Steps of plain occupancy fitting to the hull before rays are cast; 0 starts from noise.
    pub warm_start_steps: usize,
    /// Points a step of it.
    pub warm_start_points: usize,
    /// Whether rays are only searched inside the hull (and a voxel around it) rather than in the whole cube.
    pub bound_rays: bool,
}

/// One entry of the sampling schedule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarchStage {
    /// Share of the run, in percent, from which the entry holds.
    pub from_percent: u32,
    /// Samples on a ray.
    pub samples: usize,
}

/// Everything that determines a run, besides the scene and the backend.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Which measurements the shape is learned from.
    pub supervision: Supervision,
    /// Seed of all random choices. Same seed, same backend: same numbers.
    pub seed: u64,
    /// Optimiser steps.
    pub steps: usize,
    /// The network.
    pub model: DecoderConfig,
    /// What the visual hull of the masks is used for.
    pub hull: HullConfig,
    /// Rays a step, over all training views.
    pub rays: usize,
    /// Edge of the square pixel patches that rays come in; 2 or more for the image gradient term.
    pub patch_size: usize,
    /// Share of the patches whose first pixel is drawn from the object's pixels; the others come from the whole image.
    pub object_share: f64,
    /// Samples on a ray, growing over the run.
    pub march: Vec<MarchStage>,
    /// Whether each step shifts the samples of each ray at random.
    pub jitter: bool,
    /// How a crossing between two samples is located.
    pub root: RootMethod,
    /// Evaluations a ray of the root search.
    pub root_steps: usize,
    /// How the depth gradient is kept finite at grazing rays.
    pub slope: SlopeRule,
    /// Where occupancy is asked for on a ray that should hit.
    pub occupancy_point: OccupancyPoint,
    /// Loss weights.
    pub losses: LossWeights,
    /// Adam's first step size.
    pub learning_rate: f64,
    /// Shares of the run, in percent, at which the step size is multiplied by `learning_rate_factor`.
    pub milestones_percent: Vec<u32>,
    /// See `milestones_percent`.
    pub learning_rate_factor: f64,
    /// One view in this many is for testing, and one in twice as many for validation, where the dataset does not say
    /// ([`dvr_core::Scene::hold_out`]); 0 trains on all.
    pub hold_out_every: usize,
    /// Steps between validations.
    pub validate_every: usize,
    /// Steps between checkpoints.
    pub checkpoint_every: usize,
}

impl TrainConfig {
    /// Defaults for a kind of supervision.
    pub fn new(supervision: Supervision) -> Self {
        let (color, detached_color, depth) = match supervision {
            Supervision::Rgb => (1.0, 0.0, 0.0),
            Supervision::Depth => (0.0, 1.0, 10.0),
            Supervision::RgbDepth => (1.0, 0.0, 10.0),
            Supervision::Occupancy => (0.0, 0.0, 0.0),
        };
        Self {
            supervision,
            seed: 0,
            steps: 600,
            model: DecoderConfig::new().with_octaves(4),
            hull: HullConfig { resolution: 64, warm_start_steps: 300, warm_start_points: 2048, bound_rays: true },
            rays: 1024,
            patch_size: 2,
            object_share: 0.5,
            march: vec![MarchStage { from_percent: 0, samples: 24 }, MarchStage { from_percent: 70, samples: 48 }],
            jitter: true,
            root: RootMethod::default(),
            root_steps: 4,
            slope: SlopeRule::default(),
            occupancy_point: OccupancyPoint::Densest,
            losses: LossWeights {
                color,
                detached_color,
                image_gradient: color,
                depth,
                depth_on_points: true,
                sparse_depth: 0.0,
                sparse_points: 128,
                free_space: 1.0,
                occupancy: 1.0,
                normal: 0.05,
                normal_distance: 0.01,
                normal_difference: 0.0,
                normal_points: 128,
            },
            learning_rate: 3e-3,
            milestones_percent: vec![60, 85],
            learning_rate_factor: 0.3,
            hold_out_every: HOLD_OUT_EVERY,
            validate_every: 100,
            checkpoint_every: 100,
        }
    }

    /// The paper's settings, with its faults in sampling and slopes repaired: a network without encoding that starts
    /// from noise, rays through the whole cube, 16 to 128 samples (its 50k, 100k and 250k steps as shares of 300k),
    /// false position, occupancy at random points. For comparison, and for long runs.
    pub fn classic(supervision: Supervision) -> Self {
        let base = Self::new(supervision);
        Self {
            model: DecoderConfig::new(),
            hull: HullConfig { warm_start_steps: 0, bound_rays: false, ..base.hull },
            object_share: 0.0,
            march: [(0, 16), (17, 32), (33, 64), (83, 128)]
                .map(|(from_percent, samples)| MarchStage { from_percent, samples })
                .to_vec(),
            jitter: false,
            root: RootMethod::Secant,
            root_steps: 8,
            occupancy_point: OccupancyPoint::Random,
            losses: LossWeights {
                normal: 0.1,
                normal_distance: 1e-3,
                normal_difference: 1e-3,
                normal_points: usize::MAX,
                ..base.losses
            },
            learning_rate: 5e-4,
            milestones_percent: Vec::new(),
            ..base
        }
    }

    /// Samples on a ray at a step.
    pub fn samples_at(&self, step: usize) -> usize {
        let percent = self.percent(step);
        let stage = self.march.iter().rev().find(|stage| f64::from(stage.from_percent) <= percent);
        stage.or(self.march.first()).map_or(64, |stage| stage.samples)
    }

    /// Adam's step size at a step.
    pub fn learning_rate_at(&self, step: usize) -> f64 {
        fallen(self.learning_rate, self.learning_rate_factor, &self.milestones_percent, self.percent(step))
    }

    /// Which pixels a step looks at.
    pub(crate) fn sampling(&self) -> PixelSampling {
        PixelSampling { rays: self.rays, patch_size: self.patch_size, object_share: self.object_share }
    }

    fn percent(&self, step: usize) -> f64 {
        percent(step, self.steps)
    }

    /// This configuration with some of its values replaced by those of a JSON object, nested like the configuration.
    ///
    /// # Errors
    /// Names the first key that does not exist, or the value that has the wrong type or is out of range.
    pub fn overridden(&self, overrides: &serde_json::Value) -> Result<Self> {
        let config: Self = overridden(self, overrides, &[], &Self::ranges())?;
        config.check()?;
        Ok(config)
    }

    /// Reads a complete configuration, as checkpoints carry it.
    ///
    /// # Errors
    /// Names the first unknown or missing key, or the value that is out of range.
    pub fn from_json(text: &str) -> Result<Self> {
        let value: serde_json::Value =
            serde_json::from_str(text).map_err(|e| Error::BadConfig { problem: e.to_string() })?;
        let config: Self =
            serde_json::from_value(value.clone()).map_err(|e| Error::BadConfig { problem: e.to_string() })?;
        // Nested configurations of burn ignore what they do not know: lay the text over what was understood.
        config.overridden(&value)
    }

    /// Checks that the values make sense together.
    ///
    /// # Errors
    /// Names the key, the value and the range.
    pub fn check(&self) -> Result<()> {
        check_config(self, &Self::ranges())?;
        if self.rays < self.patch_size * self.patch_size {
            return Err(OutOfRange::new("rays", self.rays, "at least one patch (patch_size squared)").into());
        }
        if self.losses.image_gradient > 0.0 && self.patch_size < 2 {
            return Err(
                OutOfRange::new("patch_size", self.patch_size, "at least 2 with an image_gradient weight").into()
            );
        }
        if self.march.is_empty() {
            return Err(OutOfRange::new("march", "[]", "a list of at least one entry").into());
        }
        Ok(())
    }
}

/// A step size times `factor` for each milestone, in percent of the steps, that is passed.
pub(crate) fn fallen(first: f64, factor: f64, milestones_percent: &[u32], percent: f64) -> f64 {
    let passed = milestones_percent.iter().filter(|milestone| f64::from(**milestone) <= percent).count();
    first * factor.powi(passed as i32)
}

/// So many steps, in percent of all.
pub(crate) fn percent(step: usize, steps: usize) -> f64 {
    100.0 * step as f64 / steps.max(1) as f64
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_config_survives_a_round_trip() {
        for supervision in [Supervision::Rgb, Supervision::Depth, Supervision::RgbDepth] {
            let classic = TrainConfig::classic(supervision);
            assert_eq!(TrainConfig::from_json(&serde_json::to_string(&classic).unwrap()).unwrap(), classic);
            let config = TrainConfig::new(supervision);
            assert_eq!(TrainConfig::from_json(&serde_json::to_string(&config).unwrap()).unwrap(), config);
        }
    }

    #[test]
    fn an_override_changes_one_value_and_keeps_the_others() {
        let config = TrainConfig::new(Supervision::Rgb);
        let changed = config.overridden(&json!({"losses": {"normal": 0.2}, "model": {"hidden": 64}})).unwrap();
        assert_eq!((changed.losses.normal, changed.model.hidden), (0.2, 64));
        assert_eq!(changed.losses.color, config.losses.color);
        let classic = config.overridden(&json!({"slope": {"kind": "classic", "epsilon": 1e-3}})).unwrap();
        assert_eq!(classic.slope, SlopeRule::CLASSIC);
    }

    #[test]
    fn unknown_keys_are_named_also_in_nested_objects() {
        let config = TrainConfig::new(Supervision::Rgb);
        for (json, key) in [(json!({"stesp": 3}), "`stesp`"), (json!({"model": {"width": 3}}), "`model.width`")] {
            let message = config.overridden(&json).unwrap_err().to_string();
            assert!(message.contains(key), "{message}");
        }
    }

    #[test]
    fn values_out_of_range_are_refused_with_their_key() {
        let config = TrainConfig::new(Supervision::Rgb);
        for json in [
            json!({"losses": {"color": -1.0}}),
            json!({"learning_rate": 0.0}),
            json!({"patch_size": 1}),
            json!({"march": []}),
            json!({"rays": "many"}),
        ] {
            assert!(config.overridden(&json).is_err(), "{json}");
        }
    }

    #[test]
    fn schedules_hold_from_their_percentage_on() {
        let config = TrainConfig { steps: 1000, ..TrainConfig::new(Supervision::Rgb) };
        assert_eq!((config.samples_at(0), config.samples_at(699), config.samples_at(700)), (24, 24, 48));
        assert!(config.learning_rate_at(600) < config.learning_rate_at(599));
    }
}
