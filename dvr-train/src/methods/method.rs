//! The ways to reconstruct a scene, or to learn from many, each with its configuration.

use serde::{Deserialize, Serialize};

use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::objects::ObjectsConfig;
use dvr_core::Supervision;
use dvr_grid::GridConfig;

/// A method and everything that determines its run, besides the scene and the backend.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// A field on grids, trained in seconds.
    Grid(GridConfig),
    /// The publication's network.
    Network(TrainConfig),
    /// One network for many objects, each given by a picture.
    Objects(ObjectsConfig),
}

impl Method {
    /// Which measurements teach the shape.
    pub fn supervision(&self) -> Supervision {
        match self {
            Self::Grid(config) => config.supervision,
            Self::Network(config) => config.supervision,
            Self::Objects(config) => config.train.supervision,
        }
    }

    /// Seed of all random choices.
    pub fn seed(&self) -> u64 {
        match self {
            Self::Grid(config) => config.seed,
            Self::Network(config) => config.seed,
            Self::Objects(config) => config.train.seed,
        }
    }

    /// One view in so many is held out, where the dataset does not say.
    pub fn hold_out_every(&self) -> usize {
        match self {
            Self::Grid(config) => config.hold_out_every,
            Self::Network(config) => config.hold_out_every,
            Self::Objects(config) => config.train.hold_out_every,
        }
    }

    /// Rounds in which cameras are refined before training.
    pub fn refine_cameras(&self) -> usize {
        match self {
            Self::Grid(config) => config.refine_cameras,
            Self::Network(config) => config.refine_cameras,
            Self::Objects(_) => 0,
        }
    }

    /// Weight of the loss against depth maps.
    pub fn depth_weight(&self) -> f64 {
        match self {
            Self::Grid(config) => config.losses.depth,
            Self::Network(config) => config.losses.depth,
            Self::Objects(config) => config.train.losses.depth,
        }
    }

    /// The same method with another seed, or other numbers of steps.
    #[must_use]
    pub fn with(mut self, seed: Option<u64>, steps: Option<usize>) -> Self {
        let (own_seed, own_steps) = match &mut self {
            Self::Grid(config) => (&mut config.seed, &mut config.steps),
            Self::Network(config) => (&mut config.seed, &mut config.steps),
            Self::Objects(config) => (&mut config.train.seed, &mut config.train.steps),
        };
        *own_seed = seed.unwrap_or(*own_seed);
        *own_steps = steps.unwrap_or(*own_steps);
        self
    }

    /// This configuration with some of its values replaced by those of a JSON object, nested like the configuration.
    ///
    /// # Errors
    /// Names the first key that does not exist, or the value that has the wrong type or is out of range.
    pub fn overridden(&self, overrides: &serde_json::Value) -> Result<Self> {
        let method = match self {
            Self::Grid(config) => Self::Grid(overridden(config, overrides)?),
            Self::Network(config) => Self::Network(overridden(config, overrides)?),
            Self::Objects(config) => Self::Objects(overridden(config, overrides)?),
        };
        method.check()?;
        Ok(method)
    }

    /// Checks that the values make sense together.
    ///
    /// # Errors
    /// Names the key, the value and the range.
    pub fn check(&self) -> Result<()> {
        match self {
            Self::Grid(config) => config.check().map_err(Error::from),
            Self::Network(config) => config.check(),
            Self::Objects(config) => return config.check(),
        }?;
        if self.supervision() == Supervision::Occupancy {
            return Err(Error::Config(
                "supervision occupancy is for datasets of many objects; a single scene takes rgb, depth or rgb+depth"
                    .into(),
            ));
        }
        Ok(())
    }

    /// The configuration as JSON, for people and for `--config`.
    pub fn to_json(&self) -> Result<String> {
        match self {
            Self::Grid(config) => serde_json::to_string_pretty(config),
            Self::Network(config) => serde_json::to_string_pretty(config),
            Self::Objects(config) => serde_json::to_string_pretty(config),
        }
        .map_err(|e| Error::Config(e.to_string()))
    }
}

/// A configuration with some values replaced.
pub(crate) fn overridden<T: Serialize + for<'de> Deserialize<'de>>(
    config: &T,
    overrides: &serde_json::Value,
) -> Result<T> {
    let fail = |e: serde_json::Error| Error::Config(e.to_string());
    let mut value = serde_json::to_value(config).map_err(fail)?;
    overlay(&mut value, overrides, "")?;
    serde_json::from_value(value).map_err(fail)
}

/// Lays the values of `over` on `base`; objects are merged key by key, anything else is replaced.
fn overlay(base: &mut serde_json::Value, over: &serde_json::Value, path: &str) -> Result<()> {
    let (Some(fields), Some(over)) = (base.as_object_mut(), over.as_object()) else {
        *base = over.clone();
        return Ok(());
    };
    // An enum is replaced whole, since its fields depend on its variant: `slope` by its tag, `capacity` by its only
    // key.
    let is_other_variant = fields.len() == 1 && over.len() == 1 && !over.keys().any(|key| fields.contains_key(key));
    if over.contains_key("kind") || is_other_variant {
        *base = serde_json::Value::Object(over.clone());
        return Ok(());
    }
    for (key, value) in over {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        let names = fields.keys().cloned().collect::<Vec<_>>().join(", ");
        match fields.get_mut(key) {
            None => return Err(Error::Config(format!("unknown key `{path}`; there are: {names}"))),
            Some(inner) => overlay(inner, value, &path)?,
        }
    }
    Ok(())
}
