//! Adam's state in the checkpoints of DVR's reference code.

use std::collections::BTreeMap;
use std::path::Path;

use burn::module::Module;
use burn::tensor::Device;
use burn_store::pytorch_reader::PickleValue;
use burn_store::{ModuleSnapshot, bridge};

use super::file::{Pickle, Tensors, entry, read_tensors, renamed, whole};
use crate::error::RecordError;
use crate::tensors::{collect, fill};

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

/// Adam's state as it lies in the file: numbered, in the order in which the modules' parameters were made.
pub(super) struct OptimizerState {
    /// Tensors `state.<number>.<what>`.
    pub(super) tensors: Tensors,
    /// The parameters' numbers, in order.
    pub(super) numbers: Vec<i64>,
    /// Steps, where they are plain numbers (before PyTorch 1.12), by parameter.
    plain_steps: BTreeMap<i64, usize>,
}

impl OptimizerState {
    /// The state in a file; `None` where it has none.
    pub(super) fn read(path: &Path, root: &Pickle, notes: &mut Vec<String>) -> Option<Self> {
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
    pub(super) fn moments<M: Module + ModuleSnapshot + Clone>(
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
            let mut tensors: Tensors = collect(network)
                .map_err(|e| e.to_string())?
                .into_iter()
                .map(|tensor| (tensor.name.clone(), tensor))
                .collect();
            for (name, number) in names.iter().zip(&self.numbers) {
                let key = format!("state.{number}.{what}");
                let tensor = self.tensors.get(&key).ok_or_else(|| format!("{key} is missing"))?;
                let (name, tensor) = renamed(tensor.clone(), name);
                tensors.insert(name, tensor);
            }
            fill(network.clone(), tensors.into_values().collect(), device).map_err(|e| e.to_string())
        };
        let steps = self.steps().ok_or("its number of steps is unknown")?;
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

/// Names of the parameters in the order in which the reference code's constructors make them, which is how its optimiser
/// counts.
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
    use crate::{DecoderConfig, EncoderConfig, ImageModelConfig};

    #[test]
    fn the_optimiser_counts_parameters_as_the_reference_code_s_constructors_make_them() {
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
