//! Everything that determines the training of a system.

use std::path::PathBuf;

use dvr_core::Supervision;
use dvr_core::number_range::{OutOfRange, check_numbers};
use dvr_model::{EncoderConfig, ShapeDecoderConfig, ShapeModelConfig};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::config::{fallen, percent};
use crate::error::{Error, Result};
use crate::methods::overrides::{overridden, visible};
use crate::methods::record::MethodRecord;

/// A system that DVR is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum System {
    /// Differentiable Ray Consistency (Tulsiani et al. 2017).
    Drc,
    /// Soft Rasterizer (Liu et al. 2019).
    SoftRas,
    /// 3D-R2N2 (Choy et al. 2016), with one picture.
    R2n2,
    /// Point Set Generation (Fan et al. 2017).
    Psgn,
    /// AtlasNet (Groueix et al. 2018).
    AtlasNet,
    /// Pixel2Mesh (Wang et al. 2018).
    Pixel2Mesh,
}

impl System {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Drc, Self::SoftRas, Self::R2n2, Self::Psgn, Self::AtlasNet, Self::Pixel2Mesh];

    /// Its name as a method.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Drc => "drc",
            Self::SoftRas => "softras",
            Self::R2n2 => "r2n2",
            Self::Psgn => "psgn",
            Self::AtlasNet => "atlasnet",
            Self::Pixel2Mesh => "pixel2mesh",
        }
    }

    /// What it can learn from; the first is its default.
    pub const fn supervisions(self) -> &'static [Supervision] {
        match self {
            Self::Drc => &[Supervision::Rgb, Supervision::Depth],
            Self::SoftRas => &[Supervision::Rgb],
            Self::R2n2 | Self::Psgn | Self::AtlasNet | Self::Pixel2Mesh => &[Supervision::Occupancy],
        }
    }

    /// DVR's small encoder, with what the decoder needs of it.
    fn encoder(self) -> EncoderConfig {
        match self {
            Self::Pixel2Mesh => EncoderConfig::Local { image_size: 64, width: 32, channels: 64 },
            Self::Drc | Self::SoftRas | Self::R2n2 | Self::Psgn | Self::AtlasNet => {
                EncoderConfig::ConvolutionalBn { image_size: 64, width: 32 }
            }
        }
    }

    /// The decoder of its default size.
    fn decoder(self) -> ShapeDecoderConfig {
        match self {
            Self::Drc | Self::R2n2 => ShapeDecoderConfig::Voxels { width: 6 },
            Self::SoftRas => ShapeDecoderConfig::Sphere { width: 256 },
            Self::Psgn => ShapeDecoderConfig::Points { width: 16 },
            Self::AtlasNet => ShapeDecoderConfig::Patches { patches: 25, width: 128 },
            Self::Pixel2Mesh => ShapeDecoderConfig::Graph { width: 64 },
        }
    }

    /// Keys of the configuration that mean nothing to it; which system it is says the method's name.
    fn hidden(self) -> &'static [&'static str] {
        match self {
            Self::Drc => &["system", "points", "sharpness", "laplacian", "flatness"],
            Self::SoftRas => &["system", "points", "rays", "threshold"],
            Self::R2n2 => &["system", "points", "views", "rays", "sharpness", "laplacian", "flatness"],
            Self::Pixel2Mesh => {
                const HIDDEN: &[&str] = &[
                    "system",
                    "pretrained",
                    "code_dim",
                    "views",
                    "rays",
                    "threshold",
                    "sharpness",
                    "laplacian",
                    "flatness",
                ];
                HIDDEN
            }
            Self::Psgn | Self::AtlasNet => {
                &["system", "views", "rays", "threshold", "sharpness", "laplacian", "flatness"]
            }
        }
    }
}

/// Everything that determines a run of a system, besides the dataset and the backend. In JSON, keys that mean nothing to
/// the system are left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SystemConfig {
    /// Which system.
    pub system: System,
    /// What the shape is learned from.
    pub supervision: Supervision,
    /// Seed of all random choices.
    pub seed: u64,
    /// Optimiser steps.
    pub steps: usize,
    /// What makes the latent code of an object.
    pub encoder: EncoderConfig,
    /// File whose ResNet-18 the encoder starts from, as for DVR; `null` starts from random features.
    pub pretrained: Option<PathBuf>,
    /// Length of the latent code.
    pub code_dim: usize,
    /// What makes a shape of it.
    pub decoder: ShapeDecoderConfig,
    /// Objects a step.
    pub objects: usize,
    /// Views of each object that a step learns from.
    pub views: usize,
    /// Pixels of each of these views.
    pub rays: usize,
    /// Points of the true surface of each object in a step.
    pub points: usize,
    /// The occupancy of voxels at which the surface lies, between 0 and 1.
    pub threshold: f64,
    /// How soft the edges of silhouettes are, in squares of half a picture's width.
    pub sharpness: f64,
    /// Weight of the squared distances of vertices from the mean of their neighbours.
    pub laplacian: f64,
    /// Weight of what bends at edges.
    pub flatness: f64,
    /// Adam's step size.
    pub learning_rate: f64,
    /// Percentages of the steps at which the step size falls.
    pub milestones_percent: Vec<u32>,
    /// By which factor.
    pub learning_rate_factor: f64,
    /// Objects of the validation split that a validation looks at.
    pub validate_objects: usize,
    /// Steps between two validations.
    pub validate_every: usize,
    /// Steps between two checkpoints.
    pub checkpoint_every: usize,
}

impl SystemConfig {
    /// Defaults: encoder, objects and views as those of DVR's [`ObjectsConfig`](super::super::ObjectsConfig), so that systems
    /// differ in decoder and loss alone.
    pub fn new(system: System, supervision: Supervision) -> Self {
        Self {
            system,
            supervision,
            seed: 0,
            steps: 5000,
            encoder: system.encoder(),
            pretrained: None,
            code_dim: 128,
            decoder: system.decoder(),
            objects: 16,
            views: 2,
            rays: 128,
            points: 1024,
            threshold: if system == System::R2n2 { 0.4 } else { 0.5 },
            sharpness: 1e-4,
            laplacian: 5e-3,
            flatness: 5e-4,
            learning_rate: 1e-3,
            milestones_percent: vec![55, 80],
            learning_rate_factor: 0.5,
            validate_objects: 40,
            validate_every: 600,
            checkpoint_every: 300,
        }
    }

    /// The configuration as JSON, without what means nothing here.
    pub(crate) fn to_value(&self) -> Result<Value> {
        visible(self, self.system.hidden())
    }

    /// The same configuration with some values replaced.
    ///
    /// # Errors
    /// Names the first key that does not exist, or the value that has the wrong type.
    pub(crate) fn overridden(&self, overrides: &Value) -> Result<Self> {
        overridden(self, overrides, self.system.hidden(), &Self::ranges())
    }

    /// The configuration that a checkpoint holds; `None` where its method is no such system.
    ///
    /// # Errors
    /// When the record holds another version's configuration.
    pub fn of_record(record: &MethodRecord) -> Result<Option<Self>> {
        let system = System::ALL.into_iter().find(|system| system.name() == record.method);
        let of = |system: System| Self::new(system, system.supervisions()[0]).overridden(&record.config);
        system.map(of).transpose()
    }

    /// Encoder and decoder together.
    pub fn model(&self) -> ShapeModelConfig {
        ShapeModelConfig { encoder: self.encoder.clone(), code_dim: self.code_dim, decoder: self.decoder }
    }

    /// Adam's step size after so many steps.
    pub(crate) fn learning_rate_at(&self, step: usize) -> f64 {
        let Self { learning_rate, learning_rate_factor, steps, .. } = *self;
        fallen(learning_rate, learning_rate_factor, &self.milestones_percent, percent(step, steps))
    }

    /// Checks that the values make sense together.
    ///
    /// # Errors
    /// Names the key, the value and the range.
    pub fn check(&self) -> Result<()> {
        check_numbers(&self.to_value()?, &Self::ranges())?;
        self.model().check()?;
        let own = self.system.decoder();
        if std::mem::discriminant(&own) != std::mem::discriminant(&self.decoder) {
            let problem = format!("{} has another kind of decoder than {:?}", self.system.name(), self.decoder);
            return Err(Error::BadConfig { problem });
        }
        if matches!(self.decoder, ShapeDecoderConfig::Voxels { .. }) && self.objects < 2 {
            let range = format!("at least 2, since {} normalises over the objects of a step", self.system.name());
            return Err(OutOfRange::new("objects", self.objects, range).into());
        }
        if !self.system.supervisions().contains(&self.supervision) {
            let known: Vec<String> = self.system.supervisions().iter().map(Supervision::to_string).collect();
            let range = format!("{} (method {})", known.join(" or "), self.system.name());
            return Err(OutOfRange::new("supervision", self.supervision, range).into());
        }
        Ok(())
    }
}
