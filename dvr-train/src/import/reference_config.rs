//! YAML configurations of DVR's reference code, read as ours.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use dvr_core::dataset::ReadOptions;
use dvr_model::{DecoderConfig, EncoderConfig};
use serde_json::Value;

use crate::config::{LossWeights, TrainConfig};
use crate::error::{Error, Result};
use crate::methods::method::Method;
use crate::methods::network::decoder_method;
use crate::methods::objects::ObjectsMethod;
use crate::objects::config::ObjectsConfig;
use dvr_core::Supervision;

/// What a configuration of DVR's reference code says that has a meaning here.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceConfig {
    /// Network, losses, schedule. `rays` are those of one image.
    pub train: TrainConfig,
    /// What makes the codes; `None` for one scene.
    pub encoder: Option<EncoderConfig>,
    /// Images a step, each of another object where there are many: `training.batch_size`.
    pub images_per_step: usize,
    /// Whether only one view of each object is learned from: `data.n_views: 1`.
    pub one_view: bool,
    /// How the scene is to be read.
    pub reading: ReadOptions,
    /// What the configuration asks for and does not get, a line a key.
    pub notes: Vec<String>,
}

/// How many configurations may inherit from each other before this is taken for a circle.
const MOST_ANCESTORS: usize = 16;

/// Steps of a run, of which the reference code's sampling schedule (50 000, 100 000, 250 000) takes its shares here.
const STEPS: usize = 300_000;

/// Keys, or beginnings of keys, without a meaning here, and why.
const WITHOUT_MEANING: [(&str, &str); 16] = [
    ("data.depth_range", "rays are searched inside the object's cube"),
    ("data.path", "the dataset is given on the command line"),
    ("data.classes", "the dataset is given on the command line"),
    ("data.img_", "the layout is found by looking"),
    ("data.", "the layout is found by looking"),
    ("model.lambda_normals", "the reference code does not know it either; its lambda_normal is"),
    ("model.reduction_method", "losses are means over rays, and Adam does not see their scale"),
    (
        "training.scheduler_milestones",
        "they count passes over the dataset; here milestones_percent counts percent of the run",
    ),
    ("training.model_selection", "the validation pictures, or their silhouettes, choose the best checkpoint"),
    ("training.use_cube_intersection", "rays are always searched inside the object's cube"),
    ("training.always_freespace", "background rays always count for free space"),
    ("training.out_dir", "the folder is given on the command line"),
    ("test.model_file", "the checkpoint is given on the command line"),
    ("test.", "evaluation is configured where it is done"),
    ("generation.", "extraction is configured where it is done"),
    ("rendering.", "rendering is configured where it is done"),
];

impl ReferenceConfig {
    /// Reads a configuration with all that it inherits; keys that it leaves out have the reference code's defaults.
    ///
    /// `inherit_from` is taken as the reference code takes it, from the folder in which its `configs/` lies, wherever that is
    /// above the file, or from the current folder.
    ///
    /// # Errors
    /// When a file is missing or no YAML, or a key that has a meaning has a value without one.
    pub fn read(path: &Path) -> Result<Self> {
        let mut keys = Keys { values: BTreeMap::new(), path: path.to_owned() };
        inherit(path, &mut keys.values, MOST_ANCESTORS)?;
        keys.translate()
    }

    /// The method that the configuration describes.
    pub fn method(&self) -> Box<dyn Method> {
        match (self.of_scene(), self.of_objects()) {
            (_, Some(objects)) => Box::new(ObjectsMethod::classic(objects)),
            (train, None) => Box::new(decoder_method("classic", train.unwrap_or_else(|| self.train.clone()))),
        }
    }

    /// The configuration for a single scene, where this is one.
    pub(crate) fn of_scene(&self) -> Option<TrainConfig> {
        let train = self.train.clone();
        self.encoder.is_none().then(|| TrainConfig { rays: train.rays.saturating_mul(self.images_per_step), ..train })
    }

    /// The configuration for a dataset of many objects, where this is one.
    pub(crate) fn of_objects(&self) -> Option<ObjectsConfig> {
        self.encoder.as_ref().map(|encoder| ObjectsConfig {
            encoder: encoder.clone(),
            objects: self.images_per_step,
            one_view: self.one_view,
            train: self.train.clone(),
            ..ObjectsConfig::classic(self.train.supervision)
        })
    }
}

/// Adds what a file says, and before it what it inherits.
fn inherit(path: &Path, values: &mut BTreeMap<String, Value>, most: usize) -> Result<()> {
    let refuse = |problem: String| Error::BrokenFile { path: path.to_owned(), problem };
    let text = dvr_core::files::read_text(path)?;
    let value: Value = serde_saphyr::from_str(&text).map_err(|e| {
        let line = e.to_string().lines().next().unwrap_or_default().to_owned();
        refuse(format!("this is no YAML ({line})"))
    })?;
    let Value::Object(mut sections) = value else {
        return Err(refuse("there are no keys in it".into()));
    };
    match sections.remove("inherit_from") {
        None | Some(Value::Null) => (),
        Some(Value::String(_)) if most == 0 => {
            return Err(refuse("it inherits from itself".into()));
        }
        Some(Value::String(from)) => inherit(&ancestor(path, &from)?, values, most - 1)?,
        Some(other) => return Err(refuse(format!("inherit_from is {other}"))),
    }
    flatten("", Value::Object(sections), values);
    Ok(())
}

/// The file that `from` means in the configuration `path`.
fn ancestor(path: &Path, from: &str) -> Result<PathBuf> {
    let above = path.ancestors().skip(1).map(|folder| folder.join(from));
    above.chain([PathBuf::from(from)]).find(|file| file.is_file()).ok_or_else(|| Error::BrokenFile {
        path: path.to_owned(),
        problem: format!("it inherits from {from:?}, which lies in no folder above it"),
    })
}

/// Nested keys with dots between; later values replace earlier ones.
fn flatten(prefix: &str, value: Value, values: &mut BTreeMap<String, Value>) {
    match value {
        Value::Object(entries) => {
            for (key, value) in entries {
                let key = if prefix.is_empty() { key } else { format!("{prefix}.{key}") };
                flatten(&key, value, values);
            }
        }
        value => {
            values.insert(prefix.to_owned(), value);
        }
    }
}

/// The keys of a configuration that nobody has asked for yet.
struct Keys {
    values: BTreeMap<String, Value>,
    path: PathBuf,
}

impl Keys {
    fn translate(mut self) -> Result<ReferenceConfig> {
        if self.text("method", "dvr")?.as_deref() != Some("dvr") {
            return Err(self.refusal("method is not dvr".into()));
        }
        let decoder = DecoderConfig::new()
            .with_hidden(self.count("model.decoder_kwargs.hidden_size", 512)?)
            .with_blocks(self.count("model.decoder_kwargs.n_blocks", 5)?)
            .with_leaky(self.truth("model.decoder_kwargs.leaky", false)?)
            .with_code_dim(self.count("model.c_dim", 256)?);
        let encoder = self.encoder()?;
        let decoder = if encoder.is_some() { decoder } else { decoder.with_code_dim(0) };
        let depth = self.number("model.lambda_depth", 0.0)?;
        let color = self.number("model.lambda_rgb", 1.0)?;
        let supervision = match (color > 0.0, depth > 0.0) {
            (_, false) => Supervision::Rgb,
            (false, true) => Supervision::Depth,
            (true, true) => Supervision::RgbDepth,
        };
        let base = TrainConfig::classic(supervision);
        let train = TrainConfig {
            steps: STEPS,
            rays: self.count("training.n_training_points", 1024)?,
            patch_size: self.count("model.patch_size", 1)?,
            losses: LossWeights {
                color,
                detached_color: 0.0,
                depth,
                image_gradient: self.number("model.lambda_image_gradients", 0.0)?,
                depth_on_points: self.truth("training.depth_loss_on_world_points", false)?,
                sparse_depth: self.number("model.lambda_sparse_depth", 0.0)?,
                free_space: self.number("model.lambda_freespace", 1.0)?,
                occupancy: self.number("model.lambda_occupied", 1.0)?,
                normal: self.number("model.lambda_normal", 0.05)?,
                ..base.losses
            },
            learning_rate: self.number("training.learning_rate", 1e-4)?,
            learning_rate_factor: self.number("training.scheduler_gamma", 0.5)?,
            validate_every: self.count("training.validate_every", 2000)?,
            checkpoint_every: self.count("training.checkpoint_every", 200)?,
            // The reference code trains on every view and validates on the same.
            hold_out_every: 0,
            model: decoder,
            ..base
        };
        let reading = ReadOptions {
            visual_hull_depth: self.truth("data.depth_from_visual_hull", false)?,
            ignored_views: self.list("data.ignore_image_idx")?,
            ..ReadOptions::default()
        };
        let one_view = self.count("data.n_views", 0)? == 1;
        let images_per_step = self.count("training.batch_size", 64)?;
        Ok(ReferenceConfig { train, encoder, images_per_step, one_view, reading, notes: self.left_over() })
    }

    /// What makes the codes.
    fn encoder(&mut self) -> Result<Option<EncoderConfig>> {
        let image_size = self.count("data.img_size_input", 224)?;
        Ok(match self.text("model.encoder", "resnet18")?.as_deref() {
            None => None,
            Some("resnet18") => Some(EncoderConfig::Resnet18 { image_size }),
            Some("simple_conv") => Some(EncoderConfig::Convolutional { image_size, width: 32 }),
            Some("idx") => Some(EncoderConfig::Codes { objects: 0 }),
            Some(other) => {
                return Err(self.refusal(format!("model.encoder is {other:?}; here are resnet18, simple_conv and idx")));
            }
        })
    }

    /// A line for every key that nobody asked for.
    fn left_over(self) -> Vec<String> {
        let line = |key: &String| {
            let reason = WITHOUT_MEANING.iter().find(|(begin, _)| key.starts_with(begin));
            let reason = reason.map_or(String::new(), |(_, reason)| format!(": {reason}"));
            format!("{key} has no meaning here{reason}")
        };
        self.values.keys().map(line).collect()
    }

    fn number(&mut self, key: &'static str, default: f64) -> Result<f64> {
        match self.values.remove(key) {
            None => Ok(default),
            Some(value) => value.as_f64().ok_or_else(|| self.refusal(format!("{key} is {value}, not a number"))),
        }
    }

    fn count(&mut self, key: &'static str, default: usize) -> Result<usize> {
        match self.values.remove(key) {
            None => Ok(default),
            Some(value) => {
                let count = value.as_u64().and_then(|count| usize::try_from(count).ok());
                count.ok_or_else(|| self.refusal(format!("{key} is {value}, not a whole number from 0")))
            }
        }
    }

    fn truth(&mut self, key: &'static str, default: bool) -> Result<bool> {
        match self.values.remove(key) {
            None => Ok(default),
            Some(value) => value.as_bool().ok_or_else(|| self.refusal(format!("{key} is {value}, not true or false"))),
        }
    }

    /// A word, or `None` where it is null.
    fn text(&mut self, key: &'static str, default: &str) -> Result<Option<String>> {
        match self.values.remove(key) {
            None => Ok(Some(default.to_owned())),
            Some(Value::Null) => Ok(None),
            Some(Value::String(text)) => Ok(Some(text)),
            Some(value) => Err(self.refusal(format!("{key} is {value}, not a word"))),
        }
    }

    /// A list of numbers, as the names that views can be left out by.
    fn list(&mut self, key: &'static str) -> Result<Vec<String>> {
        match self.values.remove(key) {
            None | Some(Value::Null) => Ok(Vec::new()),
            Some(Value::Array(values)) => Ok(values.iter().map(ToString::to_string).collect()),
            Some(value) => Err(self.refusal(format!("{key} is {value}, not a list"))),
        }
    }

    fn refusal(&self, problem: String) -> Error {
        Error::BrokenFile { path: self.path.clone(), problem }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        folder
    }

    fn refusal(text: &str) -> String {
        let folder = folder(&[("a.yaml", text)]);
        ReferenceConfig::read(&folder.path().join("a.yaml")).unwrap_err().to_string()
    }

    #[test]
    fn a_configuration_inherits_and_says_what_has_no_meaning() {
        let base = "data:\n  dataset_name: DTU\n  ignore_image_idx: [3, 40]\n  depth_range: [0., 1400.]\n\
                    model:\n  c_dim: 0\n  encoder: null\n  patch_size: 2\n  lambda_image_gradients: 1.\n  lambda_normals: 0.1\n\
                    training:\n  n_training_points: 2048\n  batch_size: 1\n  depth_loss_on_world_points: True\n";
        let child = "inherit_from: configs/mvs/base.yaml\nmodel:\n  lambda_depth: 1.\n  decoder_kwargs: {}\n\
                     training:\n  learning_rate: 0.001\n  n_training_points: 512\n";
        let folder = folder(&[("configs/mvs/base.yaml", base), ("configs/mvs/child.yaml", child)]);
        let config = ReferenceConfig::read(&folder.path().join("configs/mvs/child.yaml")).unwrap();
        assert_eq!((config.encoder, config.images_per_step, config.one_view), (None, 1, false));
        let train = &config.train;
        assert_eq!((train.rays, train.patch_size, train.learning_rate), (512, 2, 1e-3));
        assert_eq!((train.supervision, train.losses.depth, train.losses.normal), (Supervision::RgbDepth, 1.0, 0.05));
        assert!(train.losses.depth_on_points && train.losses.image_gradient == 1.0);
        assert_eq!((train.model.hidden, train.model.code_dim), (512, 0));
        assert_eq!(config.reading.ignored_views, ["3", "40"]);
        let notes = config.notes.join("\n");
        for key in ["data.dataset_name", "data.depth_range", "model.lambda_normals"] {
            assert!(notes.contains(&format!("{key} has no meaning here: ")), "{notes}");
        }
        assert_eq!(config.notes.len(), 3, "{notes}");
        train.check().unwrap();
    }

    #[test]
    fn an_empty_choice_is_the_originals_default() {
        let folder = folder(&[("a.yaml", "method: dvr\n")]);
        let config = ReferenceConfig::read(&folder.path().join("a.yaml")).unwrap();
        assert_eq!(config.encoder, Some(EncoderConfig::default()));
        assert_eq!((config.train.model.code_dim, config.train.model.hidden, config.train.rays), (256, 512, 1024));
        assert_eq!((config.images_per_step, config.train.learning_rate), (64, 1e-4));
        assert!(config.notes.is_empty());
    }

    #[test]
    fn broken_files_and_values_are_named() {
        assert!(refusal("a: [1\nb: }").contains("no YAML"));
        assert!(refusal("").contains("no keys"));
        assert!(refusal("model:\n  encoder: resnet101\n").contains("resnet101"));
        assert!(refusal("model:\n  c_dim: many\n").contains("model.c_dim is \"many\""));
        assert!(refusal("inherit_from: nowhere.yaml\n").contains("nowhere.yaml"));
        assert!(refusal("inherit_from: a.yaml\n").contains("itself"));
        assert!(refusal("method: onet\n").contains("method"));
        assert!(ReferenceConfig::read(Path::new("/nowhere.yaml")).unwrap_err().to_string().contains("nowhere.yaml"));
    }
}
