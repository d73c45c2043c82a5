//! Everything that determines the training of a model on a dataset of objects.

use std::path::PathBuf;

use dvr_model::{DecoderConfig, EncoderConfig, ImageModelConfig};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::hulls::Hulls;
use super::mirror::{Likeness, Mirror, Symmetry};
use crate::config::{HullConfig, MarchStage, TrainConfig};
use crate::error::Result;
use crate::methods::overrides::{overridden, visible};
use crate::methods::record::MethodRecord;
use dvr_core::dataset::ObjectDataset;
use dvr_core::number_range::{OutOfRange, check_numbers};
use dvr_core::{MirrorAxis, Supervision};

/// What a single scene's training has, and that of objects has not.
const HIDDEN: &[&str] = &["hold_out_every", "hull.warm_start_steps", "hull.warm_start_points", "hull.bound_rays"];

/// The threshold of Occupancy Networks' code for single pictures, whose points are uniform (`configs/img/onet.yaml`; Mescheder et
/// al. 2019).
const ONET_THRESHOLD: f64 = 0.2;

/// That of fields which are learned at points of visual hulls: thin parts whose place a picture leaves open are nowhere more likely
/// than not. Of .2, .3, .4 and .5 the objects of validation are nearest at .3 to .4.
const HULL_THRESHOLD: f64 = 0.35;

/// Share of the points that are drawn in the object's box.
const BOX_SHARE: f64 = 0.5;

/// Share of the points that are drawn among those that are inside: thin objects fill a hundredth of the cube, and are hardly met
/// otherwise. The surface is at a half then: what comes to that would be far less likely at points that are uniform.
const INSIDE_SHARE: f64 = 0.25;

fn half() -> f64 {
    0.5
}

/// Everything that determines a run over many objects, besides the dataset and the backend.
///
/// In JSON the keys of [`TrainConfig`] stand beside the others, but for `hold_out_every` (what is held out are objects)
/// and all of `hull` but its `resolution`. `rays` counts the rays of one object in a step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectsConfig {
    /// What makes the latent code of an object.
    pub encoder: EncoderConfig,
    /// File whose ResNet-18 the encoder starts from: torchvision's own, or an encoder of DVR's reference code; `null` starts
    /// from random features. It is read once, when the run begins.
    #[serde(default)]
    pub pretrained: Option<PathBuf>,
    /// Objects a step.
    pub objects: usize,
    /// Views of each object that a step learns from, drawn anew each time.
    pub views: usize,
    /// Whether only one view of each object is ever learned from, the same in all steps: the paper's single-view
    /// supervision.
    pub one_view: bool,
    /// With `rgb`: weight of the loss against the depth of the visual hull of all masks of an object, `hull.resolution`
    /// voxels wide; colours then train the texture alone. 0 leaves it out, and colours shape the surface. So they do
    /// with `one_view`, where other views' masks are not known.
    #[serde(default)]
    pub hull_depth: f64,
    /// With pictures: weight of the cross entropy against the occupancy of the visual hull of all masks, and with depth maps of
    /// what these leave of it, at `points` of each object a step; a third of them near where the hull ends. 0 leaves it out.
    #[serde(default)]
    pub hull_occupancy: f64,
    /// Whether objects are learned from as their mirror images too, and seen so: a shape is then what a picture and the same one
    /// flipped from left to right say of it, on average.
    #[serde(default)]
    pub mirror: Mirror,
    /// Whether objects are taken for their own mirror images: a shape is then the mean of what is said of a point and of its mirror
    /// image, unless features of places are looked up and the picture's silhouette fits the shape better without.
    #[serde(default)]
    pub symmetry: Symmetry,
    /// How much the colours of objects differ from those of their pictures while they are learned from, in the picture that the
    /// encoder sees and in the pixels alike: channels change places, and have exponents from `exp(-color_jitter)` to
    /// `exp(color_jitter)`. 0 leaves colours as they are.
    #[serde(default)]
    pub color_jitter: f64,
    /// Points of each object in a step of `occupancy` supervision, or of its visual hull.
    pub points: usize,
    /// Share of these that are drawn in the padded box of the object: from 0 to 1.
    #[serde(default)]
    pub box_share: f64,
    /// Share of these that are drawn among what is inside the object, which all others in the padded cube hardly meet where it is
    /// thin: from 0 to what `box_share` leaves.
    #[serde(default)]
    pub inside_share: f64,
    /// The occupancy at which the surface lies, between 0 and 1.
    #[serde(default = "half")]
    pub threshold: f64,
    /// Objects of the validation split that a validation looks at, spread evenly over them.
    pub validate_objects: usize,
    /// Decoder, losses, marching, schedule.
    #[serde(flatten)]
    pub train: TrainConfig,
}

impl ObjectsConfig {
    /// Defaults for a kind of supervision: of a size that two cores can train in a quarter of an hour on some hundred
    /// objects.
    ///
    /// A ResNet-18 takes many times as long a step as all the rest. Two octaves, not the four of a single scene:
    /// without a hull to start from, four leave noise in space that no ray has cleared.
    pub fn new(supervision: Supervision) -> Self {
        let base = TrainConfig::new(supervision);
        let knows_shapes = supervision == Supervision::Occupancy;
        let by_rays = Self {
            encoder: EncoderConfig::Convolutional { image_size: 64, width: 32 },
            pretrained: None,
            objects: 16,
            views: 1,
            one_view: false,
            hull_depth: 10.0,
            hull_occupancy: 0.0,
            mirror: Mirror::Off,
            symmetry: Symmetry::Off,
            color_jitter: 0.0,
            points: 512,
            box_share: if knows_shapes { BOX_SHARE } else { 0.0 },
            inside_share: if knows_shapes { INSIDE_SHARE } else { 0.0 },
            threshold: half(),
            validate_objects: 40,
            train: TrainConfig {
                steps: 9000,
                model: DecoderConfig::new().with_code_dim(128).with_blocks(3).with_octaves(2),
                hull: no_hull(&base),
                rays: 64,
                march: vec![MarchStage { from_percent: 0, samples: 16 }],
                learning_rate: 1e-3,
                milestones_percent: vec![55, 80],
                hold_out_every: 0,
                validate_every: 600,
                checkpoint_every: 300,
                ..base
            },
        };
        if supervision == Supervision::Rgb { by_rays.by_points() } else { by_rays }
    }

    /// The same, learned by points of visual hulls, with few rays for surfaces and colours.
    fn by_points(self) -> Self {
        let mut train = self.train;
        train.model.film = true;
        (train.steps, train.rays, train.learning_rate) = (4000, 16, 2e-3);
        // Nearly half a cosine.
        (train.milestones_percent, train.learning_rate_factor) = (vec![40, 60, 75, 85, 93], 0.5);
        // Beside the weight of points.
        (train.losses.detached_color, train.losses.normal) = (12.0, 0.5);
        Self {
            encoder: EncoderConfig::ConvolutionalBn { image_size: 64, width: 32 },
            objects: 32,
            hull_occupancy: 100.0,
            mirror: Mirror::Auto,
            symmetry: Symmetry::Auto,
            points: 128,
            threshold: HULL_THRESHOLD,
            train,
            ..self
        }
    }

    /// The paper's setting: ResNet-18 on pictures of 224 pixels, codes of 256, a decoder of width 512, 64 objects
    /// of 1024 rays a step, and what [`TrainConfig::classic`] says of marching and losses. For comparison, and for
    /// large machines.
    pub fn classic(supervision: Supervision) -> Self {
        let base = TrainConfig::classic(supervision);
        let ImageModelConfig { encoder, decoder } = ImageModelConfig::default();
        Self {
            encoder,
            objects: 64,
            hull_depth: 0.0,
            hull_occupancy: 0.0,
            mirror: Mirror::Off,
            symmetry: Symmetry::Off,
            color_jitter: 0.0,
            points: 2048,
            box_share: 0.0,
            inside_share: 0.0,
            threshold: if supervision == Supervision::Occupancy { ONET_THRESHOLD } else { half() },
            train: TrainConfig {
                steps: 300_000,
                model: decoder,
                hull: no_hull(&base),
                rays: 1024,
                learning_rate: 1e-4,
                hold_out_every: 0,
                validate_every: 2000,
                checkpoint_every: 1000,
                ..base
            },
            ..Self::new(supervision)
        }
    }

    /// The configuration as JSON, without what means nothing here.
    pub(crate) fn to_value(&self) -> Result<Value> {
        visible(self, HIDDEN)
    }

    /// The same configuration with some values replaced.
    ///
    /// # Errors
    /// Names the first key that does not exist, or the value that has the wrong type.
    pub(crate) fn overridden(&self, overrides: &Value) -> Result<Self> {
        overridden(self, overrides, HIDDEN, &Self::ranges())
    }

    /// The configuration that a checkpoint holds; `None` where its method learns from a single scene.
    ///
    /// # Errors
    /// When the record holds another version's configuration.
    pub fn of_record(record: &MethodRecord) -> Result<Option<Self>> {
        let is_of_objects = record.config.get("encoder").is_some();
        let read = || Self::new(Supervision::default()).overridden(&Self::completed(&record.config));
        is_of_objects.then(read).transpose()
    }

    /// A recorded configuration with what it says nothing of, where it is older than these keys: they were not there then. That of
    /// another kind of method stays as it is.
    pub(crate) fn completed(recorded: &Value) -> Value {
        let mut config = recorded.clone();
        if config.get("encoder").is_none() || config.get("model").is_none() {
            return config;
        }
        let mut complete = |pointer: &str, key: &str, value: Value| {
            if let Some(keys) = config.pointer_mut(pointer).and_then(Value::as_object_mut) {
                keys.entry(key).or_insert(value);
            }
        };
        complete("/model", "film", false.into());
        complete("", "hull_occupancy", 0.into());
        complete("", "inside_share", 0.into());
        complete("", "mirror", "off".into());
        complete("", "symmetry", "off".into());
        complete("", "color_jitter", 0.into());
        complete("", "threshold", half().into());
        config
    }

    /// The logit of the occupancy at which the surface lies.
    pub(crate) fn surface_logit(&self) -> f64 {
        (self.threshold / (1.0 - self.threshold)).ln()
    }

    /// Whether visual hulls stand for depth maps.
    pub(crate) fn hull_stands_for_depth(&self) -> bool {
        self.train.supervision == Supervision::Rgb && !self.one_view && self.hull_depth > 0.0
    }

    /// Whether visual hulls are learned from at all. With `one_view`, other views' masks are not known.
    pub(crate) fn uses_hulls(&self) -> bool {
        let has_views = self.train.supervision != Supervision::Occupancy && !self.one_view;
        self.hull_stands_for_depth() || has_views && self.hull_occupancy > 0.0
    }

    /// Points of the visual hull of each object that a step learns from.
    pub(crate) fn hull_points(&self) -> usize {
        if self.uses_hulls() && self.hull_occupancy > 0.0 { self.points } else { 0 }
    }

    /// The visual hulls of a dataset's objects.
    pub(crate) fn hulls(&self) -> Hulls {
        let by_depth = matches!(self.train.supervision, Supervision::Depth | Supervision::RgbDepth);
        Hulls::new(self.train.hull.resolution, by_depth, self.hull_occupancy > 0.0)
    }

    /// Mirror and symmetry, found where they are still to be found: by the visual hulls of training objects. Neither where there are no
    /// pictures to flip, or other views' masks are not known.
    pub(crate) fn found_mirror(&self, dataset: &ObjectDataset) -> (Mirror, Symmetry) {
        let takes_symmetry = self.encoder.local_channels().is_some();
        let is_asked = self.mirror == Mirror::Auto || takes_symmetry && self.symmetry == Symmetry::Auto;
        let is_known = !self.one_view && self.encoder.image_size().is_some();
        let likeness =
            if is_asked && is_known { Likeness::of_training(dataset, &self.hulls()) } else { Likeness::default() };
        let mirror = self.mirror.found(likeness);
        let axis = mirror.axis().filter(|_| takes_symmetry);
        (mirror, self.symmetry.found(axis, likeness))
    }

    /// The axis in whose mirror objects are learned from too, where there is one; what knows objects by their number alone has no
    /// pictures to flip.
    pub(crate) fn mirror_axis(&self) -> Option<MirrorAxis> {
        self.encoder.image_size().and_then(|_| self.mirror.axis())
    }

    /// The axis in whose mirror objects are taken to be the same, where they are.
    pub(crate) fn symmetry_axis(&self) -> Option<MirrorAxis> {
        self.mirror_axis().filter(|_| self.symmetry == Symmetry::On)
    }

    /// What a step's loss follows: [`ObjectsConfig::train`], with hulls in the place of depth maps where they are used.
    pub(crate) fn objective(&self) -> TrainConfig {
        let mut config = self.train.clone();
        if self.hull_stands_for_depth() {
            let losses = &mut config.losses;
            losses.depth = self.hull_depth;
            // Where the depth is known, what colour says of it is noise: it fits one object's pixels, not the next one's.
            losses.detached_color += std::mem::take(&mut losses.color);
            losses.image_gradient = 0.0;
        }
        config
    }

    /// Encoder and decoder together.
    pub fn image_model(&self) -> ImageModelConfig {
        ImageModelConfig { encoder: self.encoder.clone(), decoder: self.train.model.clone() }
    }

    /// Checks that the values make sense together.
    ///
    /// # Errors
    /// Names the key, the value and the range.
    pub fn check(&self) -> Result<()> {
        check_numbers(&self.to_value()?, &Self::ranges())?;
        self.train.check()?;
        self.image_model().check().map_err(|wrong| {
            // Here the decoder is called `model`, as in the configuration of a single scene.
            OutOfRange { key: wrong.key.replace("decoder.", "model."), ..wrong }
        })?;
        if self.box_share + self.inside_share > 1.0 {
            return Err(OutOfRange::new("inside_share", self.inside_share, "at most 1 less `box_share`").into());
        }
        if self.one_view && self.views > 1 {
            return Err(OutOfRange::new("views", self.views, "1 with `one_view`").into());
        }
        Ok(())
    }
}

fn no_hull(base: &TrainConfig) -> HullConfig {
    HullConfig { warm_start_steps: 0, bound_rays: false, ..base.hull.clone() }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_configuration_survives_a_round_trip_and_its_keys_stand_side_by_side() {
        for config in [ObjectsConfig::new(Supervision::Rgb), ObjectsConfig::classic(Supervision::Depth)] {
            config.check().unwrap();
            let value = config.to_value().unwrap();
            assert!(value.get("rays").is_some() && value.get("encoder").is_some());
            assert!(value.get("hold_out_every").is_none() && value["hull"].get("bound_rays").is_none());
            assert_eq!(ObjectsConfig::new(Supervision::Rgb).overridden(&value).unwrap(), config);
        }
    }

    #[test]
    fn files_that_know_nothing_of_later_keys_keep_the_network_that_they_hold() {
        let mut config = ObjectsConfig::new(Supervision::Rgb).to_value().unwrap();
        config["model"].as_object_mut().unwrap().remove("film");
        for key in ["mirror", "symmetry", "hull_occupancy", "threshold"] {
            config.as_object_mut().unwrap().remove(key);
        }
        let record = MethodRecord { method: "objects".into(), config };
        let read = ObjectsConfig::of_record(&record).unwrap().unwrap();
        assert!(!read.train.model.film && read.mirror == Mirror::Off && read.hull_occupancy == 0.0);
        assert_eq!((read.threshold, read.symmetry), (0.5, Symmetry::Off));
        let config = ObjectsConfig::new(Supervision::Rgb).to_value().unwrap();
        let record = MethodRecord { method: "objects".into(), config };
        assert!(ObjectsConfig::of_record(&record).unwrap().unwrap().train.model.film);
    }

    #[test]
    fn overrides_reach_both_parts_and_nonsense_is_named() {
        let base = ObjectsConfig::new(Supervision::Rgb);
        let changes = json!({"losses": {"normal": 0.2}, "encoder": {"kind": "codes"}, "objects": 3});
        let config = base.overridden(&changes).unwrap();
        assert_eq!((config.train.losses.normal, config.objects), (0.2, 3));
        assert_eq!(config.encoder, EncoderConfig::Codes { objects: 0 });
        for (wrong, named) in [
            (json!({"rayz": 3}), "rayz"),
            (json!({"views": 0}), "views"),
            (json!({"views": 2, "one_view": true}), "views"),
            (json!({"model": {"code_dim": 0}}), "model.code_dim"),
            (json!({"encoder": {"kind": "transformer"}}), "transformer"),
        ] {
            let refused = base.overridden(&wrong).and_then(|config| config.check());
            let message = refused.unwrap_err().to_string();
            assert!(message.contains(named), "{message}");
        }
    }
}
