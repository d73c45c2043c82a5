//! Every number of every configuration has a range, which is checked before anything is made of it and told in the guide.

use dvr_core::number_range::{Allowed, NumberRange, check_numbers};
use dvr_core::synth::SynthConfig;
use dvr_render::extract::ExtractSettings;
use dvr_train::{
    Error, GridConfig, METHODS, Method, ObjectsConfig, ObjectsTraining, SystemConfig, TrainConfig, method_by_name,
};
use serde_json::{Value, json};

/// Values that nobody means.
fn absurd() -> Vec<Value> {
    let big = 4_294_967_295u64;
    vec![
        json!(0),
        json!(-1),
        json!(null),
        json!("nan"),
        json!("inf"),
        json!(big),
        json!(u64::MAX),
        json!(1e18),
        json!(-1e300),
    ]
}

/// Keys of all numbers of a configuration, as a table of ranges writes them, with the places where they stand.
fn numbers(value: &Value, key: &str, place: &str, found: &mut Vec<(String, String)>) {
    match value {
        Value::Number(_) => found.push((key.to_owned(), place.to_owned())),
        Value::Object(fields) => {
            for (name, value) in fields {
                let dot = if key.is_empty() { "" } else { "." };
                numbers(value, &format!("{key}{dot}{name}"), &format!("{place}/{name}"), found);
            }
        }
        Value::Array(items) => {
            items
                .iter()
                .enumerate()
                .for_each(|(i, item)| numbers(item, &format!("{key}[]"), &format!("{place}/{i}"), found));
        }
        _ => {}
    }
}

/// The configurations of a method: the default, and those with the other forms that values may have.
fn variants(method: &dyn Method) -> Vec<Value> {
    let forms = [
        json!({}),
        json!({"capacity": {"cells": 64}, "disagreeing_views": {"one-in": 9}}),
        json!({"disagreeing_views": {"exactly": 1}}),
        json!({"slope": {"kind": "classic", "epsilon": 1e-3}, "milestones_percent": [50]}),
        json!({"encoder": {"kind": "resnet18"}}),
        json!({"encoder": {"kind": "codes", "objects": 3}}),
        json!({"decoder": {"kind": "patches", "patches": 3}}),
    ];
    forms.iter().filter_map(|form| method.overridden(form).ok()).map(|method| method.config().unwrap()).collect()
}

/// A whole configuration with one value replaced.
fn with(config: &Value, place: &str, value: &Value) -> Value {
    let mut config = config.clone();
    *config.pointer_mut(place).unwrap() = value.clone();
    config
}

fn range<'r>(ranges: &'r [NumberRange], key: &str) -> &'r Allowed {
    &ranges.iter().find(|range| range.key == key).unwrap_or_else(|| panic!("{key} has no range")).allowed
}

fn ranges_of(method: &dyn Method) -> Vec<NumberRange> {
    match (method.name(), method.objects()) {
        ("grid" | "hull", _) => GridConfig::ranges(),
        (_, Some(ObjectsTraining::Fields(_))) => ObjectsConfig::ranges(),
        (_, Some(ObjectsTraining::System(_))) => SystemConfig::ranges(),
        (_, None) => TrainConfig::ranges(),
    }
}

#[test]
fn absurd_numbers_of_methods_are_refused_with_their_key_or_in_range() {
    let mut tried = 0;
    for entry in METHODS {
        let method = method_by_name(entry.name, None).unwrap();
        let ranges = ranges_of(method.as_ref());
        for config in variants(method.as_ref()) {
            let mut found = Vec::new();
            numbers(&config, "", "", &mut found);
            for (key, place) in found {
                for value in absurd() {
                    tried += 1;
                    let is_in_range = range(&ranges, &key).holds(&value);
                    match method.overridden(&with(&config, &place, &value)) {
                        Ok(_) => assert!(is_in_range, "{} {key} = {value} is taken", entry.name),
                        // What is in range may still not go together with other values.
                        Err(Error::OutOfRange(wrong)) => {
                            assert!(is_in_range || wrong.key == key, "{} {key} = {value}: {wrong}", entry.name);
                            assert!(!wrong.range.is_empty() && !wrong.value.is_empty(), "{wrong}");
                        }
                        Err(other) => panic!("{} {key} = {value}: {other}", entry.name),
                    }
                }
            }
        }
    }
    assert!(tried > 2000, "{tried}");
}

#[test]
fn absurd_numbers_of_datasets_and_extraction_are_refused_with_their_key() {
    let synth = serde_json::to_value(SynthConfig::default()).unwrap();
    let ring = with(&synth, "/placement", &json!({"ring": {"elevation": 20.0}}));
    let cap = with(&synth, "/placement", &json!({"cap": {"half_angle": 60.0}}));
    let arc = with(&synth, "/placement", &json!({"arc": {"elevation": 20.0, "angle": 90.0}}));
    let glossy = with(&synth, "/lighting/gloss", &json!({"roughness": 0.3, "metallic": 1.0, "light_half_angle": 20.0}));
    let extraction = serde_json::to_value(ExtractSettings::default()).unwrap();
    for (config, ranges) in [
        (synth, SynthConfig::RANGES),
        (ring, SynthConfig::RANGES),
        (cap, SynthConfig::RANGES),
        (arc, SynthConfig::RANGES),
        (glossy, SynthConfig::RANGES),
        (extraction, ExtractSettings::RANGES),
    ] {
        let mut found = Vec::new();
        numbers(&config, "", "", &mut found);
        assert!(found.len() > 5);
        for (key, place) in found {
            for value in absurd() {
                let checked = check_numbers(&with(&config, &place, &value), ranges);
                let is_in_range = range(ranges, &key).holds(&value);
                assert_eq!(checked.is_ok(), is_in_range, "{key} = {value}");
                assert!(checked.is_ok() || checked.is_err_and(|wrong| wrong.key == key));
            }
        }
    }
}

#[test]
fn every_range_is_that_of_a_number() {
    let mut known = Vec::new();
    for entry in METHODS {
        let method = method_by_name(entry.name, None).unwrap();
        variants(method.as_ref()).iter().for_each(|config| numbers(config, "", "", &mut known));
    }
    let all = [GridConfig::ranges(), ObjectsConfig::ranges(), SystemConfig::ranges()].concat();
    let idle = all.iter().find(|range| !known.iter().any(|(key, _)| *key == range.key));
    assert!(idle.is_none(), "{idle:?}");
}

#[test]
fn the_guide_tells_every_range() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/guide/settings.md");
    let guide = std::fs::read_to_string(path).unwrap();
    let tables = [
        ("grid", GridConfig::ranges()),
        ("network", TrainConfig::ranges()),
        (
            "objects",
            ObjectsConfig::ranges().into_iter().filter(|range| !TrainConfig::ranges().contains(range)).collect(),
        ),
        ("systems", SystemConfig::ranges()),
        ("synth", SynthConfig::RANGES.to_vec()),
    ];
    let row = |range: &NumberRange| format!("| `{}` | {} |\n", range.key, range.allowed);
    let table = |ranges: &[NumberRange]| ranges.iter().map(row).collect::<String>();
    let missing: String = (tables.iter())
        .filter(|(_, ranges)| !guide.contains(&table(ranges)))
        .map(|(name, ranges)| format!("\n{name}:\n{}", table(ranges)))
        .collect();
    assert!(missing.is_empty(), "docs/guide/settings.md lacks tables of ranges: {missing}");
}
