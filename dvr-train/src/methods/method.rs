//! What a way to reconstruct is: everything that determines its runs, besides the scene and the device.

use std::fmt::Debug;
use std::ops::RangeInclusive;

use burn::tensor::Device;
use dvr_core::metrics::depth_maps::StereoDepth;
use dvr_core::{Cancellation, Scene, SparsePoints, Supervision, View};
use dvr_grid::GridConfig;
use dvr_model::EncoderConfig;
use serde_json::Value;

use crate::error::{Error, Result};
use crate::learners::learner::Learner;
use crate::methods::record::{CommonSettings, MethodRecord};
use crate::methods::trained_model::TrainedModel;
use crate::objects::config::ObjectsConfig;
use crate::objects::systems::config::SystemConfig;
use crate::observer::Observer;
use crate::run::best::Best;

/// A configured method. [`crate::train`] takes it through a whole run; `dvr_train::methods` lists those that are known
/// by name, and any other works as well (see [`crate::FieldMethod`]).
pub trait Method: Debug + Send + Sync {
    /// Its name, which checkpoints carry.
    fn name(&self) -> &str;

    /// The configuration as JSON.
    ///
    /// # Errors
    /// When it has values that JSON cannot express.
    fn config(&self) -> Result<Value>;

    /// The settings that every method has.
    fn common(&self) -> CommonSettings;

    /// The same method with some values replaced by those of a JSON object, nested like the configuration. The result
    /// is not checked.
    ///
    /// # Errors
    /// Names the first key that does not exist, or the value that has the wrong type.
    fn with_overrides(&self, overrides: &Value) -> Result<Box<dyn Method>>;

    /// Checks that the values make sense together.
    ///
    /// # Errors
    /// Names the key, the value and the range.
    fn check(&self) -> Result<()>;

    /// How often a run validates and stores.
    fn schedule(&self) -> Schedule;

    /// What the scene has to have.
    fn needs(&self) -> Needs {
        Needs::default()
    }

    /// A learner that stands at the start of training.
    ///
    /// # Errors
    /// When the method cannot learn from this scene, or not on these devices.
    fn start<'a>(&self, start: Start<'a, '_>) -> Result<Box<dyn Learner + 'a>>;

    /// The model that a learner of this method stored.
    ///
    /// # Errors
    /// When the bytes are damaged or do not fit the configuration.
    fn load(&self, model: &[u8], device: &Device) -> Result<Box<dyn TrainedModel>>;

    /// The depths that its runs find in these views before training ([`Learner::stereo_depths`]), found again.
    ///
    /// # Errors
    /// When it cannot learn from these views.
    fn stereo_depths(&self, train: &[&View], cancellation: &Cancellation) -> Result<Vec<StereoDepth>> {
        let _ = (train, cancellation);
        Ok(Vec::new())
    }

    /// Whether a GPU can train it. If not, one can still render the result.
    fn trains_on_gpu(&self) -> bool {
        true
    }

    /// Whether the stored model is worth a file of its own: compact, and whole without the checkpoint.
    fn is_compact(&self) -> bool {
        false
    }

    /// The fewest rays that a step can have, and those that it has: what may be lowered to take less memory.
    fn rays(&self) -> Option<RangeInclusive<usize>> {
        None
    }

    /// Bytes of GPU memory that a step takes at most, about, with so many rays (see [`Method::rays`]). 0 where that is
    /// not known before the scene is.
    fn memory_estimate(&self, rays: Option<usize>) -> u64 {
        let _ = rays;
        0
    }

    /// Bytes of main memory that training on these views takes at most, about, besides the photographs and the program:
    /// by default that of a step, as if it were computed on the CPU.
    fn host_memory(&self, train: &[&View]) -> u64 {
        let _ = train;
        self.memory_estimate(None)
    }

    /// Most cells along an edge of the grid that its field lies on; `None` where it lies on none.
    fn most_cells(&self) -> Option<usize> {
        None
    }

    /// How the coarse field is trained with which cameras are refined.
    fn camera_refinement(&self) -> GridConfig {
        let CommonSettings { supervision, seed, hold_out_every, .. } = self.common();
        GridConfig { seed, hold_out_every, ..GridConfig::new(supervision) }
    }

    /// Whether a run can be resumed with another number of steps: not where steps are those of each stage.
    fn takes_more_steps(&self) -> bool {
        false
    }

    /// The configuration for a dataset of many objects, where this is a method for such.
    fn objects(&self) -> Option<ObjectsTraining<'_>> {
        None
    }
}

/// What is learned from a dataset of many objects.
#[derive(Clone, Copy, Debug)]
pub enum ObjectsTraining<'a> {
    /// A field of each object: DVR, or an Occupancy Network.
    Fields(&'a ObjectsConfig),
    /// A whole shape of each: a system that DVR is compared with.
    System(&'a SystemConfig),
}

impl<'a> ObjectsTraining<'a> {
    /// What makes the codes.
    pub fn encoder(self) -> &'a EncoderConfig {
        match self {
            Self::Fields(config) => &config.encoder,
            Self::System(config) => &config.encoder,
        }
    }

    /// Whether only one view of each object is ever learned from.
    pub fn is_of_one_view(self) -> bool {
        matches!(self, Self::Fields(ObjectsConfig { one_view: true, .. }))
    }
}

impl dyn Method + '_ {
    /// As checkpoints keep it.
    ///
    /// # Errors
    /// As [`Method::config`].
    pub fn record(&self) -> Result<MethodRecord> {
        Ok(MethodRecord { method: self.name().to_owned(), config: self.config()? })
    }

    /// The same method with some values replaced, checked; see [`Method::with_overrides`].
    ///
    /// # Errors
    /// Names the first key that does not exist, or the value that has the wrong type or is out of range.
    pub fn overridden(&self, overrides: &Value) -> Result<Box<dyn Method>> {
        let method = self.with_overrides(overrides)?;
        method.check()?;
        Ok(method)
    }

    /// Checks that the scene has what the method learns from.
    ///
    /// # Errors
    /// Says what is missing: masks of any view, or what [`Method::needs`] names.
    pub fn check_scene(&self, scene: &Scene) -> Result<()> {
        scene.require_masks()?;
        let Needs { depth, sparse_points } = self.needs();
        let supervision = self.common().supervision;
        if depth && !scene.views_of(dvr_core::Split::Train).any(|view| view.depth.is_some()) {
            return Err(Error::NeedsDepth { supervision, scene: scene.name.clone() });
        }
        if sparse_points && !scene.sparse_points.as_ref().is_some_and(SparsePoints::has_tracks) {
            return Err(Error::NeedsSparsePoints { scene: scene.name.clone() });
        }
        Ok(())
    }
}

/// What a learner starts from.
pub struct Start<'a, 'o> {
    /// The scene, for what it has besides views.
    pub scene: &'a Scene,
    /// The views to learn from.
    pub train: Vec<&'a View>,
    /// The views that choices during the run go by.
    pub validation: Vec<&'a View>,
    /// The device that holds the parameters, without autodiff.
    pub device: Device,
    /// Devices that share each step with it, without autodiff too.
    pub data_parallel: Vec<Device>,
    /// Whether the parameters will come from a checkpoint.
    pub is_resumed: bool,
    /// Asks to stop early.
    pub cancellation: &'o Cancellation,
    /// Hears how long it takes.
    pub observer: &'o mut dyn Observer,
}

/// How often a run looks up.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    /// Steps between validations.
    pub validate_every: usize,
    /// Steps between checkpoints.
    pub checkpoint_every: usize,
    /// The figure by which the best step is chosen to stand for the run; without one, the last step does.
    pub best: Option<fn(&Best) -> f64>,
}

/// What a scene has to have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Depth maps of training views.
    pub depth: bool,
    /// Sparse points.
    pub sparse_points: bool,
}

/// Refuses supervision by occupancy samples, which only datasets of many objects have.
pub(crate) fn check_scene_supervision(supervision: Supervision) -> Result<()> {
    if supervision == Supervision::Occupancy { Err(Error::SceneOccupancy) } else { Ok(()) }
}
