//! The settings of a run beside the defaults of its method.

use dvr_train::{METHODS, MethodRecord, Supervision, method_by_name};
use serde_json::Value;

use crate::error::Result;

/// A run's settings beside the defaults of its method.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The method's name.
    pub preset: String,
    /// Settings that differ: key, value, the preset's value.
    pub changed: Vec<[String; 3]>,
    /// The whole configuration, as JSON for people.
    pub whole: String,
}

impl Settings {
    /// Compares a configuration with the defaults of its method. A method that is not in the registry has no defaults
    /// here, and nothing differs.
    ///
    /// # Errors
    /// When the defaults cannot be written as JSON.
    pub fn new(record: &MethodRecord, supervision: Supervision) -> Result<Self> {
        let mut changed = Vec::new();
        if METHODS.iter().any(|entry| entry.name == record.method) {
            let preset = method_by_name(&record.method, supervision)?.config()?;
            compare(&record.config, &preset, "", &mut changed);
        }
        Ok(Self { preset: record.method.clone(), changed, whole: record.pretty() })
    }
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
    use serde_json::json;

    #[test]
    fn only_what_differs_from_the_methods_defaults_is_listed() {
        let settings = |name: &str, supervision: Supervision, changes: Value| {
            let method = method_by_name(name, supervision).unwrap().overridden(&changes).unwrap();
            Settings::new(&method.record().unwrap(), supervision).unwrap()
        };
        for entry in METHODS {
            // A single scene has no occupancies to learn from.
            let known = entry.supervisions.iter().copied();
            for supervision in known.filter(|&s| entry.learns_objects || s != Supervision::Occupancy) {
                let defaults = settings(entry.name, supervision, json!({}));
                assert_eq!((defaults.preset.as_str(), defaults.changed.len()), (entry.name, 0), "{supervision:?}");
            }
        }
        let changes = json!({"seed": 7, "capacity": {"cells": 64}, "losses": {"mask": {"weight": 3.0}}});
        let mut changed = settings("grid", Supervision::RgbDepth, changes).changed;
        changed.sort();
        let keys: Vec<&str> = changed.iter().map(|[key, ..]| key.as_str()).collect();
        assert_eq!(keys, ["capacity", "losses.mask.weight", "seed"]);
        assert_eq!(changed[1][1..], ["3.0", "10.0"]);
        let own = MethodRecord { method: "fourier".into(), config: json!({"rays": 3}) };
        assert!(Settings::new(&own, Supervision::Rgb).unwrap().changed.is_empty());
    }
}
