//! The method and configuration that the arguments of `dvr train` ask for.

use std::path::Path;

use anyhow::{Context, Result, bail};
use dvr_train::{METHODS, Method, ReferenceConfig, method_by_name};
use serde_json::{Value, json};

use super::print_notes;
use crate::args::{CapacityArg, TrainArgs};

/// Defaults with what the arguments change.
pub fn method_of_args(args: &TrainArgs, is_dataset: bool) -> Result<Box<dyn Method>> {
    let name = method_name(args, is_dataset)?.unwrap_or(if is_dataset { "objects" } else { "grid" });
    configured(method_by_name(name, args.supervision)?, args, is_dataset)
}

/// A method with what the arguments change: a file, then single values, then the flags for seed and steps: later ones win.
pub fn configured(mut method: Box<dyn Method>, args: &TrainArgs, is_dataset: bool) -> Result<Box<dyn Method>> {
    refuse_misplaced(args, method.as_ref())?;
    method = method.with_overrides(&capacity(args))?;
    if let Some(path) = &args.config {
        method = if path.extension().is_some_and(|ending| ending == "yaml" || ending == "yml") {
            of_reference_config(path, args, is_dataset)?
        } else {
            let text = dvr_core::files::read_text(path)?;
            let json = serde_json::from_str(&text).with_context(|| format!("{} is no JSON", path.display()))?;
            method.overridden(&json).with_context(|| path.display().to_string())?
        };
    }
    // The same kind keeps the method's own size.
    let others = |kind: &&String| method.config().is_ok_and(|config| config["encoder"]["kind"] != **kind);
    if let Some(kind) = args.encoder.as_ref().filter(others) {
        method = method.with_overrides(&json!({ "encoder": { "kind": kind } }))?;
    }
    if let Some(path) = &args.pretrained {
        method = method.with_overrides(&json!({ "pretrained": path }))?;
    }
    if !args.set.is_empty() {
        let with = || format!("--set {}", args.set.join(" --set "));
        method = method.overridden(&assignments(&args.set)?).with_context(with)?;
    }
    for (key, value) in [("seed", args.seed.map(Value::from)), ("steps", args.steps.map(Value::from))] {
        if let Some(value) = value {
            method = method.with_overrides(&json!({ key: value }))?;
        }
    }
    method.check()?;
    Ok(method)
}

/// The method's name, where it is given. What trains a network on a scene has a counterpart for datasets.
pub fn method_name(args: &TrainArgs, is_dataset: bool) -> Result<Option<&'static str>> {
    let asked = args.method.map(|method| match (is_dataset, method.0) {
        (true, "network") => "objects",
        (true, "classic") => "objects-classic",
        (_, name) => name,
    });
    let fits = |name: &str| METHODS.iter().any(|entry| entry.name == name && entry.learns_objects == is_dataset);
    match asked {
        Some(name) if fits(name) => Ok(Some(name)),
        Some(name) if is_dataset => {
            let others = METHODS.iter().filter(|entry| entry.learns_objects).map(|entry| entry.name);
            let others = others.filter(|name| !name.starts_with("objects")).collect::<Vec<_>>().join(", ");
            bail!(
                "a dataset of many objects takes --method network or classic, or a system of another paper ({others}); {name} \
                 reconstructs a single scene"
            )
        }
        Some(name) => bail!("--method {name} is for datasets of many objects, and this is a single scene"),
        None => Ok(None),
    }
}

/// Refuses flags that mean nothing to the method.
fn refuse_misplaced(args: &TrainArgs, method: &dyn Method) -> Result<()> {
    let objects = &args.objects;
    let is_dataset = method.objects().is_some();
    let has_pictures = objects.inputs.is_some() || args.encoder.is_some() || args.pretrained.is_some();
    if !is_dataset && (!objects.categories.is_empty() || has_pictures) {
        bail!(
            "--categories, --inputs, --encoder and --pretrained are for datasets of many objects, and this is a single scene"
        );
    }
    if method.name() != "grid" && (args.capacity.is_some() || args.max_bytes.is_some()) {
        bail!("--capacity and --max-bytes belong to --method grid");
    }
    if is_dataset && args.refine_cameras.is_some() {
        bail!("--refine-cameras is for a single scene, and this is a dataset of many");
    }
    Ok(())
}

/// What `--capacity` and `--max-bytes` say.
fn capacity(args: &TrainArgs) -> Value {
    let mut overrides = json!({});
    if let Some(CapacityArg::Cells(cells)) = args.capacity {
        overrides["capacity"] = json!({ "cells": cells });
        if cells < dvr_train::GridConfig::default().first_cells {
            overrides["first_cells"] = json!(cells);
        }
    }
    if let Some(bytes) = args.max_bytes {
        overrides["max_bytes"] = json!(bytes);
    }
    overrides
}

/// All `--set` together: one after the other they might make no sense, though together they do.
fn assignments(set: &[String]) -> Result<Value> {
    let mut overrides = json!({});
    for assignment in set {
        let Some((key, value)) = assignment.split_once('=') else {
            bail!("--set {assignment}: write KEY=VALUE, e.g. --set rays=512");
        };
        let value = value_of(value);
        let mut place = &mut overrides;
        for part in key.split('.') {
            if !place.is_object() {
                *place = json!({});
            }
            place = &mut place[part];
        }
        *place = value;
    }
    Ok(overrides)
}

/// The JSON value that a text stands for. Numbers may be written as people do (`.5`, `+2`), and strings without quotes
/// (`random`).
fn value_of(text: &str) -> Value {
    let whole = || text.parse().ok().map(|number: i64| Value::from(number));
    let decimal = || text.parse().ok().and_then(serde_json::Number::from_f64).map(Value::Number);
    let word = || Value::String(text.to_owned());
    serde_json::from_str(text).ok().or_else(whole).or_else(decimal).unwrap_or_else(word)
}

/// The method that a YAML configuration of DVR's reference code describes.
fn of_reference_config(path: &Path, args: &TrainArgs, is_dataset: bool) -> Result<Box<dyn Method>> {
    if args.method.is_some() || args.supervision.is_some() {
        bail!("{} says method and supervision: leave --method and --supervision away", path.display());
    }
    let reference = ReferenceConfig::read(path)?;
    print_notes(&reference.notes);
    if !reference.reading.ignored_views.is_empty() {
        let views = reference.reading.ignored_views.join(",");
        print_notes(&[format!("data.ignore_image_idx is left to you: --ignore {views}")]);
    }
    if reference.reading.visual_hull_depth {
        print_notes(&["data.depth_from_visual_hull is left to you: --visual-hull-depth".into()]);
    }
    let method = reference.method();
    match (method.objects().is_some(), is_dataset) {
        (true, false) => bail!("{} is for a dataset of many objects, and this is a single scene", path.display()),
        (false, true) => bail!("{} is for a single scene, and this is a dataset of many objects", path.display()),
        _ => Ok(method),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_json_numbers_as_people_write_them_or_words() {
        let of = |texts: &[&str]| texts.iter().map(|text| value_of(text)).collect::<Vec<_>>();
        assert_eq!(
            of(&[".002", "+2", "1.", "-.5", "1e-3"]),
            [json!(0.002), json!(2), json!(1.0), json!(-0.5), json!(0.001)]
        );
        assert_eq!(of(&["7", "true", "null", "[1,2]"]), [json!(7), json!(true), json!(null), json!([1, 2])]);
        assert_eq!(
            of(&["random", "inf", "NaN", "", "1,5"]),
            ["random", "inf", "NaN", "", "1,5"].map(|word| json!(word))
        );
    }
}
