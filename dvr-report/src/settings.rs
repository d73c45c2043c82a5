//! The settings of a run beside the defaults of its method.

use dvr_train::{GridConfig, Method, ObjectsConfig, TrainConfig};
use serde_json::Value;

use crate::error::Result;

/// A method's settings beside those of the preset with the fewest differences.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The preset: a method by its name.
    pub preset: &'static str,
    /// Settings that differ: key, value, the preset's value.
    pub changed: Vec<[String; 3]>,
    /// The whole configuration, as JSON for people.
    pub whole: String,
}

impl Settings {
    /// Finds the preset that needs the fewest changes.
    ///
    /// # Errors
    /// When the configuration cannot be written as JSON.
    pub fn new(method: &Method) -> Result<Self> {
        let supervision = method.supervision();
        let presets = match method {
            Method::Grid(_) => {
                vec![("grid", Method::Grid(GridConfig::new(supervision))), ("hull", Method::Grid(GridConfig::hull()))]
            }
            Method::Network(_) => vec![
                ("network", Method::Network(TrainConfig::new(supervision))),
                ("classic", Method::Network(TrainConfig::classic(supervision))),
            ],
            Method::Objects(_) => vec![
                ("network", Method::Objects(ObjectsConfig::new(supervision))),
                ("classic", Method::Objects(ObjectsConfig::classic(supervision))),
            ],
        };
        let whole = method.to_json()?;
        let own = value(&whole);
        let mut nearest: Option<(&'static str, Vec<[String; 3]>)> = None;
        for (name, preset) in presets {
            let mut changed = Vec::new();
            compare(&own, &value(&preset.to_json()?), "", &mut changed);
            if nearest.as_ref().is_none_or(|(_, other)| changed.len() < other.len()) {
                nearest = Some((name, changed));
            }
        }
        let (preset, changed) = nearest.unwrap_or_default();
        Ok(Self { preset, changed, whole })
    }
}

/// A configuration as a value; the program wrote it itself.
fn value(json: &str) -> Value {
    serde_json::from_str(json).unwrap_or(Value::Null)
}

/// Collects what differs, by dotted keys.
fn compare(own: &Value, preset: &Value, path: &str, changed: &mut Vec<[String; 3]>) {
    if own == preset {
        return;
    }
    if let (Some(own), Some(preset)) = (own.as_object(), preset.as_object())
        && own.keys().eq(preset.keys())
    {
        for (key, value) in own {
            let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            compare(value, &preset[key], &path, changed);
        }
        return;
    }
    changed.push([path.to_owned(), own.to_string(), preset.to_string()]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use dvr_train::{Capacity, Supervision};

    #[test]
    fn only_what_differs_from_the_nearest_preset_is_listed() {
        let defaults = Settings::new(&Method::Grid(GridConfig::new(Supervision::RgbDepth))).unwrap();
        assert_eq!((defaults.preset, defaults.changed.len()), ("grid", 0));
        assert_eq!(Settings::new(&Method::Grid(GridConfig::hull())).unwrap().preset, "hull");
        assert_eq!(Settings::new(&Method::Network(TrainConfig::classic(Supervision::Rgb))).unwrap().preset, "classic");
        let mut config = GridConfig { seed: 7, capacity: Capacity::Cells(64), ..GridConfig::new(Supervision::Rgb) };
        config.losses.mask = 3.0;
        let mut changed = Settings::new(&Method::Grid(config)).unwrap().changed;
        changed.sort();
        let keys: Vec<&str> = changed.iter().map(|[key, ..]| key.as_str()).collect();
        assert_eq!(keys, ["capacity", "losses.mask", "seed"]);
        assert_eq!(changed[1][1..], ["3.0", "10.0"]);
    }
}
