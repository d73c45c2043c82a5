//! A checkpoint of the reference code: network, progress and Adam's state.

use std::path::Path;

use burn::tensor::{Device, TensorData};
use burn_store::bridge;

use super::architecture::{decoder_config, encoder_config};
use super::file::{Pickle, Tensors, matrix, number, read_tensors, renamed, whole};
use super::optimizer::{AdamMoments, OptimizerState};
use crate::decoder::DecoderConfig;
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
/// decoder was trained with `leaky: true`, which its tensors do not show.
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
