//! Options for a run that has begun: they may repeat how it began, and change nothing that its results depend on.

use anyhow::{Result, bail};
use dvr_core::dataset::{Normalise, ObjectOptions};
use dvr_train::{Checkpoint, Method, method_of};
use serde::Serialize;
use serde_json::Value;

use super::SceneReading;
use super::method_of_args::{configured, method_name};
use crate::args::{MasksFrom, SceneArgs, TrainArgs};

/// The method of a run that is resumed: the one that it began with, but for more steps where it takes them.
///
/// # Errors
/// Lists the options that differ from those at the beginning, with both values. Options that are not given are as they
/// were; those that decide about nothing but time, place and what is written at the end may differ.
pub fn resumed_method(args: &TrainArgs, checkpoint: &Checkpoint) -> Result<Box<dyn Method>> {
    let stored = method_of(&checkpoint.header.method)?;
    let is_dataset = stored.objects().is_some();
    let mut differences = Differences::default();
    differences.compare("--method", stored.name(), method_name(args, is_dataset)?);
    differences.compare("--supervision", stored.common().supervision, args.supervision);
    differences.compare("--refine-cameras", checkpoint.header.refine_cameras, args.refine_cameras);
    let lengths: Vec<&str> = checkpoint.header.lengths.iter().map(|length| length.text.as_str()).collect();
    let given: Vec<&str> = args.scale.iter().map(|length| length.text.as_str()).collect();
    differences.compare("--scale", lengths, Some(given).filter(|given| !given.is_empty()));
    let is_dropped = checkpoint.header.support.is_some_and(|support| support.is_dropped);
    differences.compare("--drop-support", is_dropped, given_flag(args.drop_support));
    differences.compare_reading(args, checkpoint, is_dataset);
    let mut method = stored;
    // Other methods have other settings, which would only hide this.
    if differences.is_empty() {
        let before = method.config()?;
        let given = configured(method_of(&checkpoint.header.method)?, args, is_dataset)?;
        differences.compare("--method", method.name(), Some(given.name()));
        let free: &[&str] = if method.takes_more_steps() { &["steps"] } else { &[] };
        differences.compare_settings("", &before, &given.config()?, free);
        method = given;
    }
    differences.refuse(args)?;
    Ok(method)
}

/// Refuses to read the scene of a run otherwise than for its training.
///
/// # Errors
/// Lists the options that differ from those at the beginning, with both values.
pub fn refuse_other_reading(given: &SceneArgs, checkpoint: &Checkpoint) -> Result<()> {
    let mut differences = Differences::default();
    if let Ok(stored) = serde_json::from_value(checkpoint.header.reading.clone()) {
        differences.compare_scene(given, &stored);
    }
    if !differences.is_empty() {
        let differences = differences.0.join("; ");
        bail!("a run is measured on its scene as it was read for training, and options differ: {differences}");
    }
    Ok(())
}

/// Options that differ.
#[derive(Default)]
struct Differences(Vec<String>);

impl Differences {
    fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Compares an option, where it is given.
    fn compare<T: Serialize + PartialEq<G>, G: Serialize>(&mut self, option: &str, was: T, is: Option<G>) {
        if let Some(is) = is.filter(|is| was != *is) {
            self.0.push(format!("{option} was {}, is {}", text(&was), text(&is)));
        }
    }

    /// Compares how the scene or the dataset is read, as far as that is said again.
    fn compare_reading(&mut self, args: &TrainArgs, checkpoint: &Checkpoint, is_dataset: bool) {
        let reading = checkpoint.header.reading.clone();
        if is_dataset {
            // Without, opening the dataset says so.
            let Ok(stored) = serde_json::from_value::<ObjectOptions>(reading) else { return };
            let given = &args.objects;
            let categories = Some(given.categories.clone()).filter(|categories| !categories.is_empty());
            self.compare("--categories", stored.categories, categories);
            self.compare("--inputs", stored.inputs, given.inputs.clone().map(Some));
            self.compare("--visual-hull-depth", stored.visual_hull_depth, given_flag(args.reading.visual_hull_depth));
        } else if let Ok(stored) = serde_json::from_value::<SceneReading>(reading) {
            self.compare_scene(&args.reading, &stored);
            let segment = args.segment.segment.as_ref().map(|command| Some(command.to_string()));
            self.compare("--segment", stored.segment, segment);
        }
    }

    fn compare_scene(&mut self, given: &SceneArgs, stored: &SceneReading) {
        let options = &stored.options;
        let ignored = Some(given.ignore.clone()).filter(|views| !views.is_empty());
        self.compare("--format", options.format, given.format.map(Some));
        self.compare("--downscale", options.downscale, given.downscale);
        self.compare("--background", options.background, given.background().map(Some));
        let masks = matches!(given.masks, Some(MasksFrom::Folder(_))).then(|| given.read_options().masks);
        self.compare("--masks", options.masks.clone(), masks);
        self.compare("--no-mask-refinement", !stored.refine_masks, given_flag(given.no_mask_refinement));
        self.compare("--views", options.n_views, given.views.map(Some));
        self.compare("--ignore", options.ignored_views.clone(), ignored);
        let bounds = if let Normalise::Box(bounds) = options.normalise { Some(bounds) } else { None };
        self.compare("--box", bounds, given.bounds.map(Some));
        self.compare("--normalise", options.normalise, given.normalise.map(|how| how.normalise()));
        self.compare("--visual-hull-depth", options.visual_hull_depth, given_flag(given.visual_hull_depth));
    }

    /// Compares configurations key by key, but for those of the names `free`.
    fn compare_settings(&mut self, key: &str, was: &Value, is: &Value, free: &[&str]) {
        if let (Value::Object(was), Value::Object(is)) = (was, is) {
            let keys = was.keys().chain(is.keys().filter(|key| !was.contains_key(*key)));
            for name in keys.filter(|name| !free.contains(&name.as_str())) {
                let inner = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                let value = |side: &serde_json::Map<String, Value>| side.get(name).cloned().unwrap_or_default();
                self.compare_settings(&inner, &value(was), &value(is), &[]);
            }
            return;
        }
        self.compare(&format!("setting {key}"), was, Some(is));
    }

    fn refuse(self, args: &TrainArgs) -> Result<()> {
        if self.is_empty() {
            return Ok(());
        }
        let out = args.out.as_deref().unwrap_or(std::path::Path::new(""));
        bail!(
            "{}: the run began with other options: {}. Leave these out to resume it, or start a new run with another --out",
            out.display(),
            self.0.join("; ")
        )
    }
}

/// A flag without a value says something only where it is given.
fn given_flag(flag: bool) -> Option<bool> {
    flag.then_some(true)
}

/// A value for people: strings without quotes, nothing as `none`.
fn text(value: &impl Serialize) -> String {
    match serde_json::to_value(value).unwrap_or_default() {
        Value::Null => "none".into(),
        Value::String(text) => text,
        Value::Bool(true) => "on".into(),
        Value::Bool(false) => "off".into(),
        Value::Array(values) if values.is_empty() => "none".into(),
        Value::Array(values) => values.iter().map(text).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    }
}
