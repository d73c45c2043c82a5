//! Checkpoints of DVR's reference code, and torchvision's pretrained ResNet-18: PyTorch files, zip and legacy, without PyTorch.
//!
//! A checkpoint (`im2mesh/checkpoints.py`) is a dictionary with the state dict `model` (names `decoder.*`,
//! `encoder.*`), in most files the state of Adam as `optimizer`, and the numbers `epoch_it`, `it` and `loss_val_best`.
//! It does not hold the configuration: that follows from the tensors' shapes, but for whether the decoder is `leaky`.

mod file;
mod optimizer;
mod pretrained;

use std::path::Path;

use burn::tensor::{Device, TensorData};
use burn_store::bridge;

use file::{Pickle, Tensors, matrix, number, read_tensors, renamed, whole};
pub use optimizer::AdamMoments;
use optimizer::OptimizerState;
pub use pretrained::load_pretrained;

use crate::decoder::DecoderConfig;
use crate::encoder::EncoderConfig;
use crate::error::RecordError;
use crate::image_model::ImageModelConfig;
use crate::record::NetworkConfig;
use crate::tensors::fill;

/// What a PyTorch file of the reference code holds.
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

/// The networks that the reference code trains.
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

/// Reads a checkpoint of the reference code, or a bare state dict of its model or its decoder. `leaky` says whether the
/// decoder was trained with `leaky: true`, which its tensors do not tell.
///
/// # Errors
/// When the file is not a PyTorch file or is cut short; when its tensors are not those of a model of the reference code, naming
/// the first one that is missing, has no place, or has the wrong shape.
pub fn read_pytorch(path: &Path, leaky: bool, device: &Device) -> Result<PytorchCheckpoint, RecordError> {
    let root = Pickle::read(path)?;
    let mut notes = Vec::new();
    let mut tensors = read_tensors(path, root.get("model").is_some().then_some("model"))?;
    let is_bare_decoder = tensors.contains_key("fc_p.weight");
    if !is_bare_decoder && !tensors.keys().any(|name| name.starts_with("decoder.")) {
        return Err(if tensors.keys().any(|name| name.starts_with("encoder.")) {
            RecordError::NoDecoder
        } else {
            let first = tensors.keys().min().map_or("nothing", String::as_str);
            RecordError::Architecture {
                found: format!("there are no tensors decoder.*; the first is {first:?}"),
                expected: "a model of DVR's reference code",
            }
        });
    }
    let has_encoder = tensors.keys().any(|name| name.starts_with("encoder."));
    if !is_bare_decoder && !has_encoder {
        tensors = tensors
            .into_iter()
            .map(|(name, tensor)| renamed(tensor, name.strip_prefix("decoder.").unwrap_or(&name)))
            .collect();
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
        let config = ImageModelConfig { encoder: encoder_config(&tensors, decoder.code_dim)?, decoder };
        config.check()?;
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

/// The network of a configuration with tensors from a file, and with Adam's state where that fits.
fn import<C: NetworkConfig>(
    config: C,
    tensors: Tensors,
    state: Option<OptimizerState>,
    device: &Device,
    notes: &mut Vec<String>,
) -> Result<Imported<C>, RecordError> {
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
///
/// Tensors that the configuration makes large are compared with it here: a file that contradicts itself must not make
/// anybody allocate what it does not hold.
fn decoder_config(tensors: &Tensors, prefix: &str, leaky: bool) -> Result<DecoderConfig, RecordError> {
    let [hidden, inputs] = matrix(tensors, &format!("{prefix}fc_p.weight"))?;
    if inputs != 3 {
        let name = format!("{prefix}fc_p.weight");
        return Err(RecordError::Shape { name, found: vec![hidden, inputs], expected: format!("[{hidden}, 3]") });
    }
    let blocks = (0..).take_while(|i| tensors.contains_key(&format!("{prefix}blocks.{i}.fc_0.weight"))).count();
    for i in 0..blocks {
        expect(tensors, &format!("{prefix}blocks.{i}.fc_0.weight"), [hidden, hidden])?;
    }
    let code = format!("{prefix}fc_c.0.weight");
    let code_dim = if tensors.contains_key(&code) { matrix(tensors, &code)?[1] } else { 0 };
    if code_dim > 0 {
        expect(tensors, &code, [hidden, code_dim])?;
    }
    Ok(DecoderConfig::new().with_code_dim(code_dim).with_hidden(hidden).with_blocks(blocks).with_leaky(leaky))
}

/// The configuration of an encoder that makes codes of some length, from the names and shapes of its tensors.
fn encoder_config(tensors: &Tensors, code_dim: usize) -> Result<EncoderConfig, RecordError> {
    let image_size = EncoderConfig::default().image_size().unwrap_or_default();
    if let Some(first) = tensors.get("encoder.conv0.weight") {
        let width = first.shape.first().copied().unwrap_or(0);
        expect(tensors, "encoder.fc_out.weight", [code_dim, width.saturating_mul(16)])?;
        return Ok(EncoderConfig::Convolutional { image_size, width });
    }
    if tensors.contains_key("encoder.weight") {
        let [objects, _] = matrix(tensors, "encoder.weight")?;
        expect(tensors, "encoder.weight", [objects, code_dim])?;
        return Ok(EncoderConfig::Codes { objects });
    }
    check_is_resnet18(tensors, "encoder.features.")?;
    Ok(EncoderConfig::Resnet18 { image_size })
}

/// Checks the extents of a matrix.
fn expect(tensors: &Tensors, name: &str, extents: [usize; 2]) -> Result<(), RecordError> {
    let found = matrix(tensors, name)?;
    if found == extents {
        return Ok(());
    }
    Err(RecordError::Shape { name: name.to_owned(), found: found.to_vec(), expected: format!("{extents:?}") })
}

/// Tells a ResNet-18 from its larger relatives, whose names are a superset of its own.
fn check_is_resnet18(tensors: &Tensors, prefix: &str) -> Result<(), RecordError> {
    let has = |name: &str| tensors.contains_key(&format!("{prefix}{name}"));
    if has("layer1.0.conv3.weight") || has("layer1.2.conv1.weight") {
        return Err(RecordError::Architecture {
            found: "the encoder is a larger ResNet".into(),
            expected: "ResNet-18",
        });
    }
    if !has("layer1.0.conv1.weight") {
        let first = tensors.keys().filter(|name| name.starts_with("encoder.")).min().or(tensors.keys().min());
        let first = first.map_or("nothing", |name| name.as_str());
        return Err(RecordError::Architecture {
            found: format!("an encoder whose tensors begin with {first:?}"),
            expected: "ResNet-18, five convolutions or a table of codes",
        });
    }
    Ok(())
}

/// Adds three outputs of zeros, raw colours, to tensors of a last layer that has only the occupancy's.
fn add_texture(tensors: &mut Tensors, is_last: impl Fn(&str) -> bool) -> Result<(), RecordError> {
    for (_, tensor) in tensors.iter_mut().filter(|(name, _)| is_last(name)) {
        let data = bridge::to_data(tensor).map_err(RecordError::damaged)?;
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
    fn another_file_is_refused() {
        assert!(refusal(b"").contains("not a readable file of tensors"));
        assert!(refusal(b"solid cube\n").contains("not a readable file of tensors"));
        // An empty dictionary, as a plain pickle.
        assert!(refusal(b"\x80\x02}q\x00.").contains("no tensors"), "{}", refusal(b"\x80\x02}q\x00."));
        assert!(
            read_pytorch(Path::new("/nowhere.pt"), false, &Device::flex()).unwrap_err().to_string().contains("nowhere")
        );
    }
}
