//! Encoders that start from features which others have trained.

use std::path::Path;

use burn::tensor::Device;

use super::architecture::check_is_resnet18;
use super::file::{Pickle, Tensors, read_tensors, renamed};
use crate::encoder::{Encoder, Resnet18};
use crate::error::RecordError;
use crate::tensors::fill;

/// An encoder with the features of a ResNet-18 from a file: torchvision's own (`conv1.weight`, `layer1.0.conv1.weight`,
/// ..., whose classifier `fc` is left out), or an encoder or model of the reference code (`encoder.features.*`).
///
/// The last linear layer is taken along where its code has the same length.
///
/// # Errors
/// When the encoder is not a ResNet-18, or the file cannot be read or holds something else.
pub fn load_pretrained(encoder: Encoder, path: &Path, device: &Device) -> Result<Encoder, RecordError> {
    let Encoder::Resnet18(Resnet18 { features, fc }) = encoder else {
        return Err(RecordError::EncoderWithoutFeatures);
    };
    let root = Pickle::read(path)?;
    let key = ["model", "state_dict"].into_iter().find(|key| root.get(key).is_some());
    let tensors = read_tensors(path, key)?;
    let part = |prefix: &str| -> Tensors {
        let inside = tensors.iter().filter_map(|(name, tensor)| Some((name.strip_prefix(prefix)?, tensor)));
        inside.map(|(name, tensor)| renamed(tensor.clone(), name)).collect()
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
