//! From a checkpoint of the original to a run of ours.

use std::path::PathBuf;

use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::{AdamState, AdaptiveMomentumState, GradientsParams, LearningRate, ModuleOptimizer, Optimizer};
use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::Similarity;
use dvr_core::dataset::{ObjectOptions, ReadOptions};
use dvr_model::{AdamMoments, Codes, Encoder, EncoderConfig, ImageModel, Imported, ImportedNetwork, PytorchCheckpoint};

use crate::checkpoint::{CHECKPOINT_VERSION, Checkpoint, CheckpointHeader, LearnerState};
use crate::config::{Supervision, TrainConfig};
use crate::error::{Error, Result};
use crate::learner::module_state;
use crate::method::Method;
use crate::objects::ObjectsConfig;
use crate::original_config::OriginalConfig;
use crate::trainer::adam;

/// What an import is told besides the file.
#[derive(Clone, Debug, Default)]
pub struct ImportOptions {
    /// The configuration that the network was trained with; without it, the original's settings for one scene or many.
    pub config: Option<OriginalConfig>,
    /// The scene or dataset that the network was trained on.
    pub scene: Option<ImportedScene>,
    /// Latent codes, a row an object, for a decoder that takes codes and has no encoder.
    pub codes: Option<Vec<Vec<f32>>>,
}

/// The scene or dataset that an imported network was trained on.
#[derive(Clone, Debug)]
pub struct ImportedScene {
    /// Its folder.
    pub path: PathBuf,
    /// How it is read.
    pub reading: serde_json::Value,
    /// Takes object space to the world of the scene's files.
    pub object_to_world: Similarity,
}

impl ImportedScene {
    /// Nothing is known but how it is to be read, should somebody say where it lies.
    fn unknown(method: &Method, reading: ReadOptions) -> Result<Self> {
        let visual_hull_depth = reading.visual_hull_depth;
        let reading = match method {
            Method::Objects(_) => serde_json::to_value(ObjectOptions { visual_hull_depth, ..ObjectOptions::default() }),
            _ => serde_json::to_value(reading),
        };
        let reading = reading.map_err(|e| Error::Config(e.to_string()))?;
        Ok(Self { path: PathBuf::new(), reading, object_to_world: Similarity::default() })
    }
}

/// The checkpoint of a run that stands where the original's stood: network, Adam's moments and step.
///
/// What has no place in a run of ours is added to the notes of `found`.
///
/// # Errors
/// When the decoder takes codes and there are none, codes have another length, or there are codes and no use for them.
pub fn import(found: &mut PytorchCheckpoint, options: ImportOptions, device: &Device) -> Result<Checkpoint> {
    let ImportOptions { config, scene, codes } = options;
    if let Some(best) = found.best_validation {
        found.notes.push(format!("loss_val_best ({best}) is left out: runs are validated in other units here"));
    }
    let (method, state) = match &found.network {
        ImportedNetwork::ImageModel(imported) => {
            let Imported { config: model, network, adam } = imported.as_ref();
            if codes.is_some() {
                return Err(Error::Config("the file has an encoder, which makes the codes: leave --codes away".into()));
            }
            let encoder = with_image_size(model.encoder.clone(), config.as_ref());
            let train = TrainConfig { model: model.decoder.clone(), ..settings(config.as_ref(), found.learning_rate) };
            (of_objects(config.as_ref(), encoder, train), state_of(network, adam.as_ref())?)
        }
        ImportedNetwork::Decoder(imported) => {
            let Imported { config: model, network, adam } = imported.as_ref();
            let train = TrainConfig { model: model.clone(), ..settings(config.as_ref(), found.learning_rate) };
            match (model.code_dim, codes) {
                (0, None) => (Method::Network(train), state_of(network, adam.as_ref())?),
                (0, Some(_)) => return Err(Error::Config("the decoder takes no codes: leave --codes away".into())),
                (length, None) => {
                    return Err(Error::Config(format!(
                        "the decoder takes codes of length {length}, and the file has no encoder that makes them: give \
                         the objects' codes with --codes FILE.npz"
                    )));
                }
                (length, Some(codes)) => {
                    let encoder = EncoderConfig::Codes { objects: codes.len() };
                    let weight = Param::from_tensor(table(&codes, length, device)?);
                    let model = ImageModel { encoder: Encoder::Codes(Codes { weight }), decoder: network.clone() };
                    (of_objects(config.as_ref(), encoder, train), state_of(&model, adam.as_ref())?)
                }
            }
        }
    };
    method.check()?;
    let reading = config.map_or_else(ReadOptions::default, |config| {
        found.notes.extend(config.notes);
        config.reading
    });
    let scene = scene.map_or_else(|| ImportedScene::unknown(&method, reading), Ok)?;
    let header = CheckpointHeader {
        version: CHECKPOINT_VERSION,
        method,
        step: found.iteration.map_or(0, |last| usize::try_from(last + 1).unwrap_or(0)),
        seconds: 0.0,
        best: None,
        scene: scene.path,
        reading: scene.reading,
        object_to_world: scene.object_to_world,
        held_out: Vec::new(),
    };
    Ok(Checkpoint { header, state })
}

/// How training would go on: as the original's configuration has it, with the step size that its optimiser had last.
fn settings(config: Option<&OriginalConfig>, learning_rate: Option<f64>) -> TrainConfig {
    let mut train = config.map_or_else(|| TrainConfig::classic(Supervision::Rgb), |config| config.train.clone());
    train.learning_rate = learning_rate.filter(|rate| *rate > 0.0).unwrap_or(train.learning_rate);
    // The original has no last step: its sampling schedule ends at 250 000.
    train.steps = train.steps.max(ObjectsConfig::classic(Supervision::Rgb).train.steps);
    train
}

/// The image size is not in the tensors: the configuration's, where there is one.
fn with_image_size(found: EncoderConfig, config: Option<&OriginalConfig>) -> EncoderConfig {
    let size = config.and_then(|config| config.encoder.as_ref()?.image_size());
    match (found, size) {
        (EncoderConfig::Resnet18 { .. }, Some(image_size)) => EncoderConfig::Resnet18 { image_size },
        (EncoderConfig::Convolutional { width, .. }, Some(image_size)) => {
            EncoderConfig::Convolutional { image_size, width }
        }
        (found, _) => found,
    }
}

/// The method of a model of many objects.
fn of_objects(config: Option<&OriginalConfig>, encoder: EncoderConfig, train: TrainConfig) -> Method {
    let classic = ObjectsConfig::classic(train.supervision);
    Method::Objects(ObjectsConfig {
        encoder,
        objects: config.map_or(classic.objects, |config| config.images_a_step),
        one_view: config.is_some_and(|config| config.one_view),
        train,
        ..classic
    })
}

/// Codes as a tensor `[objects, length]`.
fn table(codes: &[Vec<f32>], length: usize, device: &Device) -> Result<Tensor<2>> {
    if codes.is_empty() {
        return Err(Error::Config("there are no codes in --codes".into()));
    }
    if let Some(wrong) = codes.iter().find(|code| code.len() != length) {
        return Err(Error::Config(format!(
            "the codes have the length {}, and the decoder takes codes of length {length}",
            wrong.len()
        )));
    }
    Ok(Tensor::from_data(TensorData::new(codes.concat(), [codes.len(), length]), device))
}

/// A network and, where there is one, its optimiser's state, as a checkpoint keeps them.
fn state_of<M: Module, N: Module>(network: &M, moments: Option<&AdamMoments<N>>) -> Result<LearnerState> {
    let Some(moments) = moments else { return module_state(network.clone(), &adam()) };
    let mut optimizer = ModuleOptimizer::from(LayDown { steps: moments.steps });
    let mut laid = network.clone().train();
    for moment in [&moments.first, &moments.second] {
        laid = optimizer.step(0.0, laid, as_gradients(moment));
    }
    module_state(network.clone(), &optimizer)
}

/// An optimiser that changes nothing and takes down Adam's state: the gradients of its first step are the first moments,
/// those of its second step the second ones. burn has no other way into an optimiser's record.
#[derive(Clone)]
struct LayDown {
    /// Steps that Adam has done.
    steps: usize,
}

impl Optimizer for LayDown {
    type State<const D: usize> = AdamState<D>;

    fn step<const D: usize>(
        &self,
        _: LearningRate,
        tensor: Tensor<D>,
        moment: Tensor<D>,
        state: Option<AdamState<D>>,
    ) -> (Tensor<D>, Option<AdamState<D>>) {
        let state = match state {
            None => AdaptiveMomentumState::new(self.steps, moment.clone(), moment.zeros_like()),
            Some(state) => AdaptiveMomentumState { moment_2: moment, ..state.momentum },
        };
        (tensor, Some(AdamState::new(state)))
    }

    fn to_device<const D: usize>(mut state: AdamState<D>, device: &Device) -> AdamState<D> {
        state.momentum = state.momentum.to_device(device);
        state
    }
}

/// A module's parameters as the gradients of the parameters with the same identities; statistics are no parameters.
fn as_gradients<M: Module>(moments: &M) -> GradientsParams {
    let mut collector = Collector { path: Vec::new(), gradients: GradientsParams::new() };
    moments.visit(&mut collector);
    collector.gradients
}

struct Collector {
    path: Vec<String>,
    gradients: GradientsParams,
}

impl ModuleVisitor for Collector {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let is_statistic = |name: &String| name.starts_with("running_") || name == "batches_tracked";
        if !self.path.last().is_some_and(is_statistic) {
            self.gradients.register(param.id, param.val().inner());
        }
    }
}
