//! From a checkpoint of DVR's reference code to a run of ours.

use std::collections::BTreeMap;
use std::path::PathBuf;

use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::{AdamState, AdaptiveMomentumState, GradientsParams, LearningRate, ModuleOptimizer, Optimizer};
use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::Similarity;
use dvr_core::dataset::{ObjectOptions, ReadOptions};
use dvr_model::{
    AdamMoments, Codes, DecoderConfig, Encoder, EncoderConfig, ImageModel, Imported, ImportedNetwork, PytorchCheckpoint,
};

use crate::config::TrainConfig;
use crate::error::{CodesError, Error, Result};
use crate::import::reference_config::ReferenceConfig;
use crate::learners::adam::adam;
use crate::learners::learner::LearnerState;
use crate::learners::module_state::module_state;
use crate::methods::method::Method;
use crate::methods::network::decoder_method;
use crate::methods::objects::ObjectsMethod;
use crate::objects::config::ObjectsConfig;
use crate::run::checkpoint::{CHECKPOINT_VERSION, Checkpoint, CheckpointHeader};
use dvr_core::Supervision;

/// What an import takes besides the file.
#[derive(Clone, Debug, Default)]
pub struct ImportOptions {
    /// The configuration that the network was trained with; without it, the paper's settings for one scene or many.
    pub config: Option<ReferenceConfig>,
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
    fn unknown(method: &dyn Method, reading: ReadOptions) -> Result<Self> {
        let visual_hull_depth = reading.visual_hull_depth;
        let reading = match method.objects() {
            Some(_) => serde_json::to_value(ObjectOptions { visual_hull_depth, ..ObjectOptions::default() }),
            _ => serde_json::to_value(reading),
        };
        let reading = reading.map_err(|e| Error::NotStored { problem: e.to_string() })?;
        Ok(Self { path: PathBuf::new(), reading, object_to_world: Similarity::default() })
    }
}

/// The checkpoint of a run that stands where one of DVR's reference code stood: network, Adam's moments and step.
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
                return Err(CodesError::HasEncoder.into());
            }
            let encoder = with_image_size(model.encoder.clone(), config.as_ref());
            let method = of_objects(config.as_ref(), encoder, model.decoder.clone(), found.learning_rate);
            (method, state_of(network, adam.as_ref())?)
        }
        ImportedNetwork::Decoder(imported) => {
            let Imported { config: model, network, adam } = imported.as_ref();
            match (model.code_dim, codes) {
                (0, None) => {
                    let method = of_scene(config.as_ref(), model.clone(), found.learning_rate);
                    (method, state_of(network, adam.as_ref())?)
                }
                (0, Some(_)) => return Err(CodesError::NotTaken.into()),
                (length, None) => return Err(CodesError::Missing { length }.into()),
                (length, Some(codes)) => {
                    let encoder = EncoderConfig::Codes { objects: codes.len() };
                    let weight = Param::from_tensor(table(&codes, length, device)?);
                    let method = of_objects(config.as_ref(), encoder, model.clone(), found.learning_rate);
                    let model = ImageModel {
                        encoder: Encoder::Codes(Codes { weight }),
                        decoder: network.clone(),
                        aligned: None,
                    };
                    (method, state_of(&model, adam.as_ref())?)
                }
            }
        }
    };
    method.check()?;
    let reading = config.map_or_else(ReadOptions::default, |config| {
        found.notes.extend(config.notes);
        config.reading
    });
    let scene = scene.map_or_else(|| ImportedScene::unknown(method.as_ref(), reading), Ok)?;
    let header = CheckpointHeader {
        version: CHECKPOINT_VERSION,
        method: method.record()?,
        common: method.common(),
        step: found.iteration.map_or(0, |last| usize::try_from(last + 1).unwrap_or(0)),
        seconds: 0.0,
        best: None,
        scene: scene.path,
        reading: scene.reading,
        object_to_world: scene.object_to_world,
        views: None,
        cameras: BTreeMap::new(),
        refine_cameras: 0,
        exposures: Default::default(),
        lengths: Vec::new(),
        support: None,
        notes: Vec::new(),
    };
    Ok(Checkpoint { header, state })
}

/// How training of one scene would go on: as the reference code's configuration has it.
fn of_scene(config: Option<&ReferenceConfig>, model: DecoderConfig, learning_rate: Option<f64>) -> Box<dyn Method> {
    let base = config.and_then(ReferenceConfig::of_scene).unwrap_or_else(|| TrainConfig::classic(Supervision::Rgb));
    Box::new(decoder_method("classic", going_on(TrainConfig { model, ..base }, learning_rate)))
}

/// The same for a model of many objects.
fn of_objects(
    config: Option<&ReferenceConfig>,
    encoder: EncoderConfig,
    model: DecoderConfig,
    learning_rate: Option<f64>,
) -> Box<dyn Method> {
    let base = config.and_then(ReferenceConfig::of_objects);
    let base = base.unwrap_or_else(|| ObjectsConfig::classic(Supervision::Rgb));
    let train = going_on(TrainConfig { model, ..base.train.clone() }, learning_rate);
    Box::new(ObjectsMethod::classic(ObjectsConfig { encoder, train, ..base }))
}

/// With the step size that the optimiser had last, and with no last step but the end of the reference code's sampling
/// schedule.
fn going_on(train: TrainConfig, learning_rate: Option<f64>) -> TrainConfig {
    let learning_rate = learning_rate.filter(|rate| *rate > 0.0).unwrap_or(train.learning_rate);
    let steps = train.steps.max(ObjectsConfig::classic(train.supervision).train.steps);
    TrainConfig { learning_rate, steps, ..train }
}

/// The image size is not in the tensors: the configuration's, where there is one.
fn with_image_size(found: EncoderConfig, config: Option<&ReferenceConfig>) -> EncoderConfig {
    let size = config.and_then(|config| config.encoder.as_ref()?.image_size());
    match (found, size) {
        (EncoderConfig::Resnet18 { .. }, Some(image_size)) => EncoderConfig::Resnet18 { image_size },
        (EncoderConfig::Convolutional { width, .. }, Some(image_size)) => {
            EncoderConfig::Convolutional { image_size, width }
        }
        (found, _) => found,
    }
}

/// Codes as a tensor `[objects, length]`.
fn table(codes: &[Vec<f32>], length: usize, device: &Device) -> Result<Tensor<2>> {
    if codes.is_empty() {
        return Err(CodesError::Empty.into());
    }
    if let Some(wrong) = codes.iter().find(|code| code.len() != length) {
        return Err(CodesError::Length { found: wrong.len(), expected: length }.into());
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

/// An optimiser that changes nothing and takes down Adam's state: the gradients of its first step are the first
/// moments, those of its second step the second ones. burn has no other way into an optimiser's record.
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

#[cfg(test)]
mod tests {
    use burn::module::ModuleMapper;
    use dvr_model::Decoder;

    use super::*;
    use crate::learners::module_state::{restore_module, restore_optimizer};
    use crate::methods::overrides::overridden;

    /// Every parameter at one value.
    struct Constant(f64);

    impl ModuleMapper for Constant {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            param.map(|tensor| tensor.zeros_like() + self.0)
        }
    }

    fn found(code_dim: usize) -> PytorchCheckpoint {
        let config = DecoderConfig::new().with_hidden(4).with_blocks(1).with_code_dim(code_dim);
        let network = config.init(&Device::flex());
        let moment = |value| network.clone().map(&mut Constant(value));
        let adam = AdamMoments { steps: 10, first: moment(0.1), second: moment(0.04) };
        PytorchCheckpoint {
            network: ImportedNetwork::Decoder(Box::new(Imported { config, network, adam: Some(adam) })),
            epoch: Some(3),
            iteration: Some(9),
            best_validation: None,
            learning_rate: Some(0.01),
            notes: Vec::new(),
        }
    }

    #[test]
    fn training_goes_on_with_the_moments_of_the_file() {
        let checkpoint = import(&mut found(0), ImportOptions::default(), &Device::flex()).unwrap();
        let base = TrainConfig::classic(Supervision::Rgb);
        let config: TrainConfig =
            overridden(&base, &checkpoint.header.method.config, &[], &TrainConfig::ranges()).unwrap();
        assert_eq!((checkpoint.header.step, config.learning_rate), (10, 0.01));
        let tracking = Device::flex().autodiff();
        let decoder: Decoder = restore_module(&checkpoint.state.model, config.model.init(&tracking)).unwrap();
        let mut optimizer = restore_optimizer(&checkpoint.state.training, adam()).unwrap();
        let gradients = as_gradients(&decoder.clone().map(&mut Constant(1.0)));
        let before = decoder.fc_p.weight.val().inner();
        let after = optimizer.step(0.01, decoder, gradients).fc_p.weight.val().inner();
        // Adam's eleventh step: m = .9 * .1 + .1, v = .999 * .04 + .001.
        let (m, v) = (0.19 / (1.0 - 0.9f64.powi(11)), (0.999 * 0.04 + 0.001) / (1.0 - 0.999f64.powi(11)));
        let expected = 0.01 * m / v.sqrt();
        for moved in (before - after).into_data().iter::<f64>() {
            assert!((moved - expected).abs() < 1e-6, "{moved} {expected}");
        }
    }

    #[test]
    fn codes_make_a_model_of_many_objects_and_must_fit() {
        let with = |codes| ImportOptions { codes, ..ImportOptions::default() };
        let codes = vec![vec![0.5, 1.0], vec![2.0, 3.0]];
        let checkpoint = import(&mut found(2), with(Some(codes.clone())), &Device::flex()).unwrap();
        let config = ObjectsConfig::of_record(&checkpoint.header.method).unwrap().expect("many objects");
        assert_eq!(config.encoder, EncoderConfig::Codes { objects: 2 });
        let model = restore_module(&checkpoint.state.model, config.image_model().init(&Device::flex())).unwrap();
        let Encoder::Codes(table) = model.encoder else { panic!("codes") };
        assert_eq!(table.weight.val().into_data().iter::<f32>().collect::<Vec<_>>(), codes.concat());

        let refusal = |code_dim, codes| {
            import(&mut found(code_dim), with(codes), &Device::flex()).map(|_| ()).unwrap_err().to_string()
        };
        assert!(refusal(2, None).contains("length 2"));
        assert!(refusal(0, Some(codes.clone())).contains("no codes"));
        assert!(refusal(3, Some(codes)).contains("length 3"));
        assert!(refusal(2, Some(Vec::new())).contains("of codes has none"));
    }
}
