//! Modules as named tensors with PyTorch's names and layout, and back.
//!
//! Linear weights are `[out, in]`, normalisations have `weight` and `bias`, and every batch normalisation has its count
//! of batches: what `state_dict()` of the modules of DVR's reference code gives.

use burn::module::Module;
use burn::tensor::{Bytes, DType, Device, Shape, Tensor, TensorData};
use burn_store::burn_pack::Tensor as NamedTensor;
use burn_store::{ApplyError, BurnToPyTorchAdapter, FloatCastAdapter, ModuleAdapter, ModuleSnapshot};
use burn_store::{PyTorchToBurnAdapter, bridge};

use crate::error::RecordError;

/// The parameter of our encoder that stands for PyTorch's counts of batches.
const BATCHES: &str = "batches_tracked";

/// PyTorch's count of batches in a batch normalisation.
pub(crate) const TORCH_BATCHES: &str = "num_batches_tracked";

/// Statistics of a batch normalisation, beside which PyTorch keeps its count.
const RUNNING_MEAN: &str = "running_mean";

/// All tensors of a module, in its order.
///
/// # Errors
/// When a tensor cannot be read back from its device.
pub(crate) fn collect<M: Module + ModuleSnapshot>(module: &M) -> Result<Vec<NamedTensor>, RecordError> {
    let mut tensors = module.collect(None, Some(Box::new(BurnToPyTorchAdapter)), true);
    let Some(at) = tensors.iter().position(|tensor| leaf(&tensor.name) == BATCHES) else { return Ok(tensors) };
    let count = bridge::into_data(tensors.remove(at)).map_err(RecordError::damaged)?;
    let count = count.iter::<f64>().next().unwrap_or(0.0) as i64;
    let means = tensors.iter().filter_map(|tensor| tensor.name.strip_suffix(RUNNING_MEAN).map(str::to_owned));
    let counts: Vec<_> = means.map(|prefix| whole_number(count, format!("{prefix}{TORCH_BATCHES}"))).collect();
    tensors.extend(counts);
    Ok(tensors)
}

/// The module with its parameters replaced by tensors of the same names and shapes, in the float type of `device`.
///
/// # Errors
/// Names tensors that have no place, that are missing, that have another shape, or that cannot be read.
pub(crate) fn fill<M: Module + ModuleSnapshot>(
    mut module: M,
    tensors: Vec<NamedTensor>,
    device: &Device,
) -> Result<M, RecordError> {
    let dtype = Tensor::<1>::zeros([1], device).dtype();
    let adapter = PyTorchToBurnAdapter.chain(FloatCastAdapter::to(dtype));
    let result = module.apply(one_count(tensors)?, None, Some(Box::new(adapter)), true);
    if let Some(error) = result.errors.first() {
        return Err(match error {
            ApplyError::ShapeMismatch { path, expected, found } => RecordError::Shape {
                name: path.clone(),
                found: found.iter().copied().collect(),
                expected: format!("{:?}", expected.iter().collect::<Vec<_>>()),
            },
            ApplyError::LoadError { path, message } => {
                RecordError::DamagedTensor { name: path.clone(), reason: message.clone() }
            }
            other => RecordError::damaged(other),
        });
    }
    if !result.unused.is_empty() {
        return Err(RecordError::UnknownTensors { names: result.unused });
    }
    // A file without normalisations' counts, as safetensors of other programs, is complete.
    let missing: Vec<_> =
        result.missing.into_iter().map(|(path, _)| path).filter(|path| leaf(path) != BATCHES).collect();
    if missing.is_empty() { Ok(module) } else { Err(RecordError::MissingTensors { names: missing }) }
}

/// PyTorch's counts of batches, which are all the same, as the one that our encoder keeps.
fn one_count(tensors: Vec<NamedTensor>) -> Result<Vec<NamedTensor>, RecordError> {
    let (counts, mut rest): (Vec<_>, Vec<_>) =
        tensors.into_iter().partition(|tensor| leaf(&tensor.name) == TORCH_BATCHES);
    // The normalisation that stands directly in the features has the shortest name, and gives the features' name.
    if let Some(count) = counts.into_iter().min_by_key(|tensor| tensor.name.len()) {
        let mut parts: Vec<&str> = count.name.split('.').collect();
        parts.truncate(parts.len().saturating_sub(2));
        parts.push(BATCHES);
        let name = parts.join(".");
        let data = bridge::into_data(count).map_err(RecordError::damaged)?;
        let count = data.iter::<f64>().next().unwrap_or(0.0) as f32;
        rest.push(bridge::from_data(TensorData::from([count]), name, None));
    }
    Ok(rest)
}

/// A scalar of 64 bits, as PyTorch keeps its counts.
fn whole_number(value: i64, name: String) -> NamedTensor {
    let bytes = Bytes::from_bytes_vec(value.to_ne_bytes().to_vec());
    NamedTensor::new(name, DType::I64, Shape::from(Vec::<usize>::new()), None, bytes)
}

/// The last part of a dotted name.
fn leaf(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Decoder, DecoderConfig};

    fn decoder() -> (Decoder, Vec<NamedTensor>) {
        let decoder = DecoderConfig::new().with_hidden(4).with_blocks(1).init(&Device::flex());
        let tensors = collect(&decoder).unwrap();
        (decoder, tensors)
    }

    fn refusal(change: impl FnOnce(&mut Vec<NamedTensor>)) -> String {
        let (decoder, mut tensors) = decoder();
        change(&mut tensors);
        fill(decoder, tensors, &Device::flex()).map(|_| ()).unwrap_err().to_string()
    }

    #[test]
    fn tensors_that_do_not_fit_are_named() {
        let (decoder, tensors) = decoder();
        assert!(fill(decoder, tensors, &Device::flex()).is_ok());
        let unknown = refusal(|tensors| {
            let mut tensor = tensors[0].clone();
            tensor.name = "fc_z.weight".into();
            tensors.push(tensor);
        });
        assert!(unknown.contains("\"fc_z.weight\" has no place"), "{unknown}");
        let missing = refusal(|tensors| tensors.retain(|tensor| tensor.name != "fc_out.bias"));
        assert!(missing.contains("\"fc_out.bias\" is missing"), "{missing}");
        let shape = refusal(|tensors| {
            let bias = tensors.iter_mut().find(|tensor| tensor.name == "fc_out.bias").unwrap();
            *bias = bridge::from_data(TensorData::from([1.0f32; 5]), bias.name.clone(), None);
        });
        assert!(shape.contains("[5]") && shape.contains("[4]"), "{shape}");
    }
}
