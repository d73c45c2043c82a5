//! Any field that can be trained on rays, as a method: the whole run for a decoder of one's own.

use std::fmt;
use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::Arc;

use burn::module::Module;
use burn::tensor::Device;
use dvr_core::View;
use dvr_model::seeded;
use dvr_render::Crossing;
use serde_json::Value;

use crate::config::TrainConfig;
use crate::error::Result;
use crate::learners::learner::Learner;
use crate::learners::module_state::{check_holds, restore_module};
use crate::learners::sparse::SparseTargets;
use crate::learners::trainer::Trainer;
use crate::learners::warm_start::{carve_hull, hull_bound, warm_start};
use crate::methods::field_model::FieldModel;
use crate::methods::method::{Method, Needs, Schedule, Start, check_scene_supervision};
use crate::methods::overrides::{overridden, visible};
use crate::methods::record::CommonSettings;
use crate::methods::trained_model::TrainedModel;

/// Bytes of a voxel of the hull while it is carved, and of a pixel of the silhouettes that carve it.
const HULL_VOXEL: u64 = 4;
const SILHOUETTE_PIXEL: u64 = 8;

type MakeField<F> = Arc<dyn Fn(&TrainConfig, &Device) -> F + Send + Sync>;
type SaveConfigured<F> = Arc<dyn Fn(&TrainConfig, &F, &Path) -> Result<()> + Send + Sync>;

/// A field that is trained on rays of photographs, sampled and differentiated as DVR does.
///
/// This is all that a field of one's own needs for a whole run: checkpoints, resuming, validation, mesh and figures.
/// The example `own_decoder` shows it.
pub struct FieldMethod<F> {
    name: String,
    config: TrainConfig,
    make: MakeField<F>,
    save: Option<SaveConfigured<F>>,
    memory: Option<fn(&TrainConfig) -> u64>,
    has_decoder_settings: bool,
}

impl<F: Crossing + Module + 'static> FieldMethod<F> {
    /// A method of this name; `make` is to make an untrained field on a device.
    pub fn new(
        name: impl Into<String>,
        config: TrainConfig,
        make: impl Fn(&TrainConfig, &Device) -> F + Send + Sync + 'static,
    ) -> Self {
        let make = Arc::new(make);
        Self { name: name.into(), config, make, save: None, memory: None, has_decoder_settings: false }
    }

    /// How the trained field is written for other programs.
    #[must_use]
    pub fn saved_by(self, save: impl Fn(&TrainConfig, &F, &Path) -> Result<()> + Send + Sync + 'static) -> Self {
        Self { save: Some(Arc::new(save)), ..self }
    }

    /// How many bytes of GPU memory a step takes at most, about.
    #[must_use]
    pub fn with_memory_estimate(self, estimate: fn(&TrainConfig) -> u64) -> Self {
        Self { memory: Some(estimate), ..self }
    }

    /// Lets [`TrainConfig::model`] be a part of the configuration, for fields that are made from it.
    #[must_use]
    pub fn with_decoder_settings(self) -> Self {
        Self { has_decoder_settings: true, ..self }
    }

    /// The configuration.
    pub fn settings(&self) -> &TrainConfig {
        &self.config
    }

    /// Keys of the configuration without a meaning for this field.
    fn hidden(&self) -> &'static [&'static str] {
        if self.has_decoder_settings { &[] } else { &["model"] }
    }
}

impl<F> Clone for FieldMethod<F> {
    fn clone(&self) -> Self {
        let Self { name, config, make, save, memory, has_decoder_settings } = self;
        Self {
            name: name.clone(),
            config: config.clone(),
            make: make.clone(),
            save: save.clone(),
            memory: *memory,
            has_decoder_settings: *has_decoder_settings,
        }
    }
}

impl<F> fmt::Debug for FieldMethod<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FieldMethod").field("name", &self.name).field("config", &self.config).finish_non_exhaustive()
    }
}

impl<F: Crossing + Module + 'static> Method for FieldMethod<F> {
    fn name(&self) -> &str {
        &self.name
    }

    fn config(&self) -> Result<Value> {
        visible(&self.config, self.hidden())
    }

    fn common(&self) -> CommonSettings {
        let TrainConfig { supervision, seed, steps, hold_out_every, .. } = self.config;
        CommonSettings { supervision, seed, steps, hold_out_every }
    }

    fn with_overrides(&self, overrides: &Value) -> Result<Box<dyn Method>> {
        let config = overridden(&self.config, overrides, self.hidden(), &TrainConfig::ranges())?;
        Ok(Box::new(Self { config, ..self.clone() }))
    }

    fn check(&self) -> Result<()> {
        self.config.check()?;
        check_scene_supervision(self.config.supervision)
    }

    fn schedule(&self) -> Schedule {
        let TrainConfig { validate_every, checkpoint_every, .. } = self.config;
        Schedule { validate_every, checkpoint_every, best: Some(|found| found.psnr) }
    }

    fn takes_more_steps(&self) -> bool {
        true
    }

    fn needs(&self) -> Needs {
        let losses = &self.config.losses;
        Needs { depth: losses.depth > 0.0, sparse_points: losses.sparse_depth > 0.0 }
    }

    /// The field, fitted to the visual hull unless its parameters come from a checkpoint.
    fn start<'a>(&self, start: Start<'a, '_>) -> Result<Box<dyn Learner + 'a>> {
        let Start { scene, train, validation, device, data_parallel, is_resumed, cancellation, observer } = start;
        let config = &self.config;
        let mut field = seeded(&device, config.seed, || (self.make)(config, &device.clone().autodiff()));
        let hull = carve_hull(&train, config.hull.resolution)?;
        if hull.is_empty() {
            observer.note("the masks have no visual hull in common: training starts from noise");
        }
        if !is_resumed && !hull.is_empty() && config.hull.warm_start_steps > 0 {
            observer.phase("fitting the visual hull", config.hull.warm_start_steps);
            let progress = |done| observer.progress(done, "");
            field = warm_start(field, &hull, config, &device, cancellation, progress)?;
        }
        let bound = if config.hull.bound_rays { hull_bound(&hull) } else { None };
        let sparse = SparseTargets::new(scene, &train);
        let trainer = Trainer::new(field, train, validation, config.clone(), device).data_parallel(data_parallel);
        Ok(Box::new(trainer.with_bound(bound).with_sparse_targets(sparse)))
    }

    fn load(&self, model: &[u8], device: &Device) -> Result<Box<dyn TrainedModel>> {
        if self.has_decoder_settings {
            check_holds(model, self.config.model.parameters())?;
        }
        let field = restore_module(model, (self.make)(&self.config, device))?.valid();
        let parameters = field.num_params();
        let (save, config) = (self.save.clone(), self.config.clone());
        let save = save.map(|save| Arc::new(move |field: &F, path: &Path| save(&config, field, path)) as _);
        Ok(Box::new(FieldModel::new(field, parameters, save)))
    }

    fn rays(&self) -> Option<RangeInclusive<usize>> {
        Some(self.config.sampling().patch_pixels()..=self.config.rays)
    }

    fn host_memory(&self, train: &[&View]) -> u64 {
        let hull = (self.config.hull.resolution as u64).saturating_pow(3) * HULL_VOXEL;
        let pixels = |view: &&View| u64::from(view.image.width()) * u64::from(view.image.height());
        self.memory_estimate(None) + hull + train.iter().map(pixels).sum::<u64>() * SILHOUETTE_PIXEL
    }

    fn memory_estimate(&self, rays: Option<usize>) -> u64 {
        let Some(estimate) = self.memory else { return 0 };
        let mut config = self.config.clone();
        if let Some(rays) = rays {
            config.rays = rays;
            config.hull.warm_start_points = config.hull.warm_start_points.min(rays);
        }
        estimate(&config)
    }
}
