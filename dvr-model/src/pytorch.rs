//! The original's checkpoints, and torchvision's pretrained ResNet-18: PyTorch files, zip and legacy, without PyTorch.
//!
//! A checkpoint (`im2mesh/checkpoints.py`) is a dictionary with the state dict `model` (names `decoder.*`, `encoder.*`), in
//! most files the state of Adam as `optimizer`, and the numbers `epoch_it`, `it` and `loss_val_best`. It does not hold the
//! configuration: that follows from the tensors' shapes, but for whether the decoder is `leaky`.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use burn::module::Module;
use burn::tensor::{Device, TensorData};
use burn_store::burn_pack::Tensor as NamedTensor;
use burn_store::pytorch_reader::{PickleValue, PytorchReader};
use burn_store::{ModuleSnapshot, bridge};

use crate::decoder::DecoderConfig;
use crate::encoder::{Encoder, EncoderConfig, Resnet18};
use crate::image_model::ImageModelConfig;
use crate::record::{NetworkConfig, RecordError};
use crate::tensors::{collect, fill};

/// What a PyTorch file of the original holds.
#[derive(Clone, Debug)]
pub struct PytorchCheckpoint {
    /// The network.
    pub network: ImportedNetwork,
    /// Passes over the dataset, counted from 0: `epoch_it`.
    pub epoch: Option<i64>,
    /// The last training step, counted from 0: `it`.
    pub iteration: Option<i64>,
    /// The best validation so far, in whatever metric the configuration chose: `loss_val_best`.
    pub best_validation: Option<f64>,
    /// Adam's step size at the end: `lr` of the first parameter group.
    pub learning_rate: Option<f64>,
    /// What the user should know.
    pub notes: Vec<String>,
}

/// The networks that the original trains.
#[derive(Clone, Debug)]
pub enum ImportedNetwork {
    /// A decoder without an encoder: one scene, or objects whose codes are kept elsewhere.
    Decoder(Box<Imported<DecoderConfig>>),
    /// A decoder and what makes its codes.
    ImageModel(Box<Imported<ImageModelConfig>>),
}

/// A network and the state of its optimiser.
#[derive(Clone, Debug)]
pub struct Imported<C: NetworkConfig> {
    /// Its configuration, from the shapes.
    pub config: C,
    /// The network.
    pub network: C::Network,
    /// Adam's state, where the file has it.
    pub adam: Option<AdamMoments<C::Network>>,
}

/// The state of Adam: each moment as a network whose parameters are the moments of the parameters.
///
/// Parameters have the same identities as in the network that the state belongs to.
#[derive(Clone, Debug)]
pub struct AdamMoments<M> {
    /// Steps done.
    pub steps: usize,
    /// Running means of gradients, `exp_avg`.
    pub first: M,
    /// Running means of squared gradients, `exp_avg_sq`.
    pub second: M,
}

/// Reads a checkpoint of the original, or a bare state dict of its model or its decoder. `leaky` says whether the decoder
/// was trained with `leaky: true`, which its tensors do not tell.
///
/// # Errors
/// When the file is no PyTorch file or is cut short; when its tensors are not those of a model of the original, naming
/// the first one that is missing, has no place, or has the wrong shape.
pub fn read_pytorch(path: &Path, leaky: bool, device: &Device) -> Result<PytorchCheckpoint, RecordError> {
    let root = Pickle::read(path)?;
    let mut notes = Vec::new();
    let mut tensors = read_tensors(path, root.get("model").is_some().then_some("model"))?;
    let is_bare_decoder = tensors.contains_key("fc_p.weight");
    if !is_bare_decoder && !tensors.keys().any(|name| name.starts_with("decoder.")) {
        return Err(RecordError::Shape(if tensors.keys().any(|name| name.starts_with("encoder.")) {
            "the file holds an encoder and no decoder; it can start a training (--pretrained), but is no model".into()
        } else {
            let names: Vec<_> = tensors.keys().take(3).cloned().collect();
            format!("there are no tensors decoder.* as in a model of the original, but {}", names.join(", "))
        }));
    }
    let has_encoder = tensors.keys().any(|name| name.starts_with("encoder."));
    if !is_bare_decoder && !has_encoder {
        tensors = tensors.into_iter().map(|(name, tensor)| renamed(tensor, &name, "decoder.", "")).collect();
    }
    let prefix = if has_encoder { "decoder." } else { "" };
    let decoder = decoder_config(&tensors, prefix, leaky)?;
    let mut state = OptimizerState::read(path, &root, &mut notes);
    if matrix(&tensors, &format!("{prefix}fc_out.weight"))?[0] == 1 {
        notes.push("the network has no texture (out_dim 1): its colour is grey everywhere".into());
        add_texture(&mut tensors, |name| name.starts_with(&format!("{prefix}fc_out.")))?;
        if let Some(state) = &mut state {
            // The optimiser counts the last layer's parameters as 2 and 3.
            let last = state.numbers.get(2..4).unwrap_or_default().to_vec();
            let is_last = |name: &str| last.iter().any(|i| name.starts_with(&format!("state.{i}.exp")));
            add_texture(&mut state.tensors, is_last)?;
        }
    }
    let network = if has_encoder {
        let config = ImageModelConfig { encoder: encoder_config(&tensors)?, decoder };
        config.check().map_err(|e| RecordError::Shape(e.to_string()))?;
        ImportedNetwork::ImageModel(Box::new(import(config, tensors, state, device, &mut notes)?))
    } else {
        ImportedNetwork::Decoder(Box::new(import(decoder, tensors, state, device, &mut notes)?))
    };
    Ok(PytorchCheckpoint {
        network,
        epoch: root.get("epoch_it").and_then(whole),
        iteration: root.get("it").and_then(whole),
        best_validation: root.get("loss_val_best").and_then(number).filter(|value| value.is_finite()),
        learning_rate: root.parameter_group().and_then(|group| number(group.get("lr")?)),
        notes,
    })
}

/// An encoder with the features of a ResNet-18 from a file: torchvision's own (`conv1.weight`, `layer1.0.conv1.weight`, ...,
/// whose classifier `fc` is left out), or an encoder or model of the original (`encoder.features.*`).
///
/// The last linear layer is taken along where its code has the same length.
///
/// # Errors
/// When the encoder is not a ResNet-18, or the file cannot be read or holds something else.
pub fn load_pretrained(encoder: Encoder, path: &Path, device: &Device) -> Result<Encoder, RecordError> {
    let Encoder::Resnet18(Resnet18 { features, fc }) = encoder else {
        return Err(RecordError::Shape("pretrained features are those of a ResNet-18; the encoder is another".into()));
    };
    let root = Pickle::read(path)?;
    let key = ["model", "state_dict"].into_iter().find(|key| root.get(key).is_some());
    let tensors = read_tensors(path, key)?;
    let part = |prefix: &str| -> HashMap<String, NamedTensor> {
        let inside = tensors.iter().filter(|(name, _)| name.starts_with(prefix));
        inside.map(|(name, tensor)| renamed(tensor.clone(), name, prefix, "")).collect()
    };
    let ours = part("encoder.features.");
    let mut found = if ours.is_empty() { part("") } else { ours };
    let is_classifier = |name: &String| name == "fc.weight" || name == "fc.bias";
    found.retain(|name, _| !is_classifier(name));
    check_is_resnet18(&found, "")?;
    let features = fill(features, found.into_values().collect(), device)?;
    let last = part("encoder.fc.");
    let fits = last.get("weight").is_some_and(|weight| weight.shape.first() == fc.weight.shape().last());
    let fc = if fits { fill(fc, last.into_values().collect(), device)? } else { fc };
    Ok(Encoder::Resnet18(Resnet18 { features, fc }))
}

/// The network of a configuration with tensors from a file, and with Adam's state where that fits.
fn import<C: NetworkConfig>(
    config: C,
    tensors: HashMap<String, NamedTensor>,
    state: Option<OptimizerState>,
    device: &Device,
    notes: &mut Vec<String>,
) -> Result<Imported<C>, RecordError>
where
    C::Network: Clone,
{
    let network = fill(config.fresh(device), tensors.into_values().collect(), device)?;
    let adam = match state.map(|state| state.moments(&network, device)).transpose() {
        Ok(adam) => adam,
        Err(reason) => {
            notes.push(format!("the optimiser's state is left out: {reason}. Training would start with fresh moments"));
            None
        }
    };
    Ok(Imported { config, network, adam })
}

/// The configuration of a decoder, from the shapes of its tensors.
fn decoder_config(
    tensors: &HashMap<String, NamedTensor>,
    prefix: &str,
    leaky: bool,
) -> Result<DecoderConfig, RecordError> {
    let extents = |name: &str| matrix(tensors, &format!("{prefix}{name}"));
    let [hidden, inputs] = extents("fc_p.weight")?;
    if inputs != 3 {
        return Err(RecordError::Shape(format!("{prefix}fc_p takes {inputs} inputs, the original's takes 3")));
    }
    let blocks = (0..).take_while(|i| tensors.contains_key(&format!("{prefix}blocks.{i}.fc_0.weight"))).count();
    let code_dim =
        if tensors.contains_key(&format!("{prefix}fc_c.0.weight")) { extents("fc_c.0.weight")?[1] } else { 0 };
    Ok(DecoderConfig::new().with_code_dim(code_dim).with_hidden(hidden).with_blocks(blocks).with_leaky(leaky))
}

/// The configuration of an encoder, from the names and shapes of its tensors.
fn encoder_config(tensors: &HashMap<String, NamedTensor>) -> Result<EncoderConfig, RecordError> {
    let image_size = EncoderConfig::default().image_size().unwrap_or_default();
    if tensors.contains_key("encoder.conv0.weight") {
        let width = tensors["encoder.conv0.weight"].shape.first().copied().unwrap_or(0);
        return Ok(EncoderConfig::Convolutional { image_size, width });
    }
    if tensors.contains_key("encoder.weight") {
        let [objects, _] = matrix(tensors, "encoder.weight")?;
        return Ok(EncoderConfig::Codes { objects });
    }
    check_is_resnet18(tensors, "encoder.features.")?;
    Ok(EncoderConfig::Resnet18 { image_size })
}

/// Tells a ResNet-18 from its larger relatives, whose names are a superset of its own.
fn check_is_resnet18(tensors: &HashMap<String, NamedTensor>, prefix: &str) -> Result<(), RecordError> {
    let has = |name: &str| tensors.contains_key(&format!("{prefix}{name}"));
    if has("layer1.0.conv3.weight") || has("layer1.2.conv1.weight") {
        return Err(RecordError::Shape("the encoder is a larger ResNet; only ResNet-18 is supported".into()));
    }
    if !has("layer1.0.conv1.weight") {
        let first = tensors.keys().filter(|name| name.starts_with("encoder.")).min().or(tensors.keys().min());
        let first = first.map_or("nothing", |name| name.as_str());
        return Err(RecordError::Shape(format!("no encoder that is known here: the tensors begin with {first:?}")));
    }
    Ok(())
}

/// Adds three outputs of zeros, raw colours, to tensors of a last layer that has only the occupancy's.
fn add_texture(tensors: &mut HashMap<String, NamedTensor>, is_last: impl Fn(&str) -> bool) -> Result<(), RecordError> {
    for (_, tensor) in tensors.iter_mut().filter(|(name, _)| is_last(name)) {
        let data = bridge::to_data(tensor).map_err(|e| RecordError::Container(e.to_string()))?;
        let mut shape: Vec<usize> = tensor.shape.iter().copied().collect();
        let mut values: Vec<f32> = data.iter::<f32>().collect();
        values.resize(4 * values.len(), 0.0);
        if let Some(outputs) = shape.first_mut() {
            *outputs = 4;
        }
        *tensor = bridge::from_data(TensorData::new(values, shape), tensor.name.clone(), None);
    }
    Ok(())
}

/// The two extents of a matrix.
fn matrix(tensors: &HashMap<String, NamedTensor>, name: &str) -> Result<[usize; 2], RecordError> {
    let tensor = tensors.get(name).ok_or_else(|| RecordError::Shape(format!("tensor {name:?} is missing")))?;
    let shape: Vec<usize> = tensor.shape.iter().copied().collect();
    <[usize; 2]>::try_from(shape)
        .map_err(|shape| RecordError::Shape(format!("tensor {name:?} has the shape {shape:?}, a matrix is needed")))
}

/// A tensor whose name begins with another prefix.
fn renamed(mut tensor: NamedTensor, name: &str, from: &str, to: &str) -> (String, NamedTensor) {
    let name = name.strip_prefix(from).map_or_else(|| name.to_owned(), |rest| format!("{to}{rest}"));
    tensor.name.clone_from(&name);
    (name, tensor)
}

/// The tensors below a key of the file, by name, their bytes unread.
fn read_tensors(path: &Path, key: Option<&str>) -> Result<HashMap<String, NamedTensor>, RecordError> {
    let reader = match key {
        Some(key) => PytorchReader::with_top_level_key(path, key),
        None => PytorchReader::new(path),
    };
    let tensors = reader.map_err(|e| RecordError::Container(e.to_string()))?.into_tensors();
    Ok(tensors.into_iter().map(|(name, tensor)| (name, bridge::from_pytorch(tensor))).collect())
}

/// What a file holds besides tensors.
struct Pickle(HashMap<String, PickleValue>);

impl Pickle {
    fn read(path: &Path) -> Result<Self, RecordError> {
        std::fs::File::open(path).map_err(|e| dvr_core::Error::io(path, e))?;
        match PytorchReader::read_pickle_data(path, None).map_err(|e| RecordError::Container(e.to_string()))? {
            PickleValue::Dict(entries) => Ok(Self(entries)),
            _ => Err(RecordError::Container("there is no dictionary of tensors in it".into())),
        }
    }

    fn get(&self, key: &str) -> Option<&PickleValue> {
        self.0.get(key)
    }

    /// The first parameter group of the optimiser: its settings, and the numbers of its parameters.
    fn parameter_group(&self) -> Option<&HashMap<String, PickleValue>> {
        match entry(self.get("optimizer")?, "param_groups")? {
            PickleValue::List(groups) => match groups.first()? {
                PickleValue::Dict(group) => Some(group),
                _ => None,
            },
            _ => None,
        }
    }
}

fn entry<'a>(value: &'a PickleValue, key: &str) -> Option<&'a PickleValue> {
    if let PickleValue::Dict(entries) = value { entries.get(key) } else { None }
}

fn number(value: &PickleValue) -> Option<f64> {
    match value {
        PickleValue::Float(value) => Some(*value),
        PickleValue::Int(value) => Some(*value as f64),
        _ => None,
    }
}

fn whole(value: &PickleValue) -> Option<i64> {
    if let PickleValue::Int(value) = value { Some(*value) } else { None }
}

/// Adam's state as it lies in the file: numbered, in the order in which the modules' parameters were made.
struct OptimizerState {
    /// Tensors `state.<number>.<what>`.
    tensors: HashMap<String, NamedTensor>,
    /// The parameters' numbers, in order.
    numbers: Vec<i64>,
    /// Steps, where they are plain numbers (before PyTorch 1.12), by parameter.
    plain_steps: BTreeMap<i64, usize>,
}

impl OptimizerState {
    /// The state in a file; `None` where it has none.
    fn read(path: &Path, root: &Pickle, notes: &mut Vec<String>) -> Option<Self> {
        let optimizer = root.get("optimizer")?;
        let group = root.parameter_group()?;
        let numbers = match group.get("params") {
            Some(PickleValue::List(numbers)) => numbers.iter().filter_map(whole).collect::<Vec<_>>(),
            _ => Vec::new(),
        };
        let plain_steps = numbers.iter().filter_map(|&i| {
            let state = entry(entry(optimizer, "state")?, &i.to_string())?;
            Some((i, usize::try_from(whole(entry(state, "step")?)?).ok()?))
        });
        let plain_steps = plain_steps.collect();
        match read_tensors(path, Some("optimizer")) {
            Ok(tensors) if tensors.is_empty() => None,
            Ok(tensors) => Some(Self { tensors, numbers, plain_steps }),
            Err(error) => {
                notes.push(format!("the optimiser's state cannot be read: {error}"));
                None
            }
        }
    }

    /// The state of a network's parameters.
    fn moments<M: Module + ModuleSnapshot + Clone>(
        self,
        network: &M,
        device: &Device,
    ) -> Result<AdamMoments<M>, String> {
        let names = registration_order(network).map_err(|e| e.to_string())?;
        if names.len() != self.numbers.len() {
            return Err(format!("it is about {} parameters, the model has {}", self.numbers.len(), names.len()));
        }
        let moment = |what: &str| -> Result<M, String> {
            // Buffers have no moments: the network's own stay in their places.
            let mut tensors: HashMap<String, NamedTensor> = collect(network)
                .map_err(|e| e.to_string())?
                .into_iter()
                .map(|tensor| (tensor.name.clone(), tensor))
                .collect();
            for (name, number) in names.iter().zip(&self.numbers) {
                let key = format!("state.{number}.{what}");
                let tensor = self.tensors.get(&key).ok_or_else(|| format!("{key} is missing"))?;
                let (name, tensor) = renamed(tensor.clone(), name, "", "");
                tensors.insert(name, tensor);
            }
            fill(network.clone(), tensors.into_values().collect(), device).map_err(|e| e.to_string())
        };
        let steps = self.steps().ok_or("its number of steps cannot be told")?;
        Ok(AdamMoments { steps, first: moment("exp_avg")?, second: moment("exp_avg_sq")? })
    }

    /// Steps done, of the first parameter.
    fn steps(&self) -> Option<usize> {
        let number = self.numbers.first()?;
        if let Some(steps) = self.plain_steps.get(number) {
            return Some(*steps);
        }
        let step = self.tensors.get(&format!("state.{number}.step"))?;
        let steps = bridge::to_data(step).ok()?.iter::<f64>().next()?;
        (steps >= 0.0).then_some(steps as usize)
    }
}

/// Names of the parameters in the order in which the original's constructors make them, which is how its optimiser counts.
fn registration_order<M: Module + ModuleSnapshot>(network: &M) -> Result<Vec<String>, RecordError> {
    let mut names: Vec<String> = collect(network)?.into_iter().map(|tensor| tensor.name).collect();
    names.retain(|name| !["running_mean", "running_var", "num_batches_tracked"].iter().any(|end| name.ends_with(end)));
    // The decoder makes its last layer before its codes' and its blocks, and is made before the encoder.
    names.sort_by_key(|name| {
        let name = name.strip_prefix("decoder.").unwrap_or(name);
        ["fc_p.", "fc_out.", "fc_c.", "blocks."].iter().position(|part| name.starts_with(part)).unwrap_or(4)
    });
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(bytes: &[u8]) -> String {
        let file = std::env::temp_dir().join(format!("dvr-not-pytorch-{}-{}.pt", std::process::id(), bytes.len()));
        std::fs::write(&file, bytes).unwrap();
        let refused = read_pytorch(&file, false, &Device::flex()).map(|_| ());
        std::fs::remove_file(&file).unwrap();
        refused.unwrap_err().to_string()
    }

    #[test]
    fn what_is_no_checkpoint_is_refused() {
        assert!(refusal(b"").contains("not a readable file of tensors"));
        assert!(refusal(b"solid cube\n").contains("not a readable file of tensors"));
        // An empty dictionary, as a plain pickle.
        assert!(refusal(b"\x80\x02}q\x00.").contains("no tensors"), "{}", refusal(b"\x80\x02}q\x00."));
        assert!(
            read_pytorch(Path::new("/nowhere.pt"), false, &Device::flex()).unwrap_err().to_string().contains("nowhere")
        );
    }

    #[test]
    fn the_optimiser_counts_parameters_as_the_originals_constructors_make_them() {
        let decoder = DecoderConfig::new().with_code_dim(2).with_hidden(4).with_blocks(1);
        let encoder = EncoderConfig::Convolutional { image_size: 64, width: 1 };
        let model = ImageModelConfig { encoder, decoder }.init(&Device::flex());
        let names = registration_order(&model).unwrap();
        let expected = [
            "decoder.fc_p.weight",
            "decoder.fc_p.bias",
            "decoder.fc_out.weight",
            "decoder.fc_out.bias",
            "decoder.fc_c.0.weight",
            "decoder.fc_c.0.bias",
            "decoder.blocks.0.fc_0.weight",
            "decoder.blocks.0.fc_0.bias",
            "decoder.blocks.0.fc_1.weight",
            "decoder.blocks.0.fc_1.bias",
            "encoder.conv0.weight",
            "encoder.conv0.bias",
        ];
        assert_eq!(names[..12], expected);
        assert_eq!(names.last().map(String::as_str), Some("encoder.fc_out.bias"));
    }
}
