//! Networks on disk: safetensors with the configuration and a format version in the header.
//!
//! Tensors carry the names and the layout (`[out, in]`) of the PyTorch modules of DVR's reference code, so that the files
//! go both ways: `torch.nn.Module.load_state_dict` takes what is written here, and what the reference code exported is
//! read.

use std::collections::HashMap;
use std::path::Path;

use burn::module::Module;
use burn::tensor::{Bytes, DType, Device, Shape};
use burn_store::ModuleSnapshot;
use burn_store::burn_pack::Tensor as NamedTensor;
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::decoder::{Decoder, DecoderConfig};
use crate::error::RecordError;
use crate::image_model::{ImageModel, ImageModelConfig};
use crate::shapes::{ShapeModel, ShapeModelConfig};
use crate::tensors::{collect, fill};

/// Version of the header that [`to_safetensors`] writes.
pub const FORMAT_VERSION: u32 = 1;

/// The configuration of a network that can be stored: what its file says about it, and how to make it again.
pub trait NetworkConfig: Serialize + DeserializeOwned {
    /// The network.
    type Network: Module + ModuleSnapshot;

    /// What the header calls it.
    const FORMAT: &'static str;

    /// How many numbers the network has at least. A file that holds fewer is refused before a network is made.
    fn parameters(&self) -> u64;

    /// A network with fresh parameters.
    fn fresh(&self, device: &Device) -> Self::Network;

    /// The configuration that a header without one of ours describes: that of the reference code's bare state dicts.
    ///
    /// # Errors
    /// When keys are missing.
    fn from_keys(header: &HashMap<String, String>) -> Result<Self, RecordError>;
}

impl NetworkConfig for DecoderConfig {
    type Network = Decoder;
    const FORMAT: &'static str = "dvr-decoder";

    fn parameters(&self) -> u64 {
        Self::parameters(self)
    }

    fn fresh(&self, device: &Device) -> Decoder {
        self.init(device)
    }

    /// Reads `c_dim`, `hidden_size`, `n_blocks` and `leaky`.
    fn from_keys(header: &HashMap<String, String>) -> Result<Self, RecordError> {
        let get = |key: &'static str| header.get(key).ok_or(RecordError::MissingKey { key });
        let number = |key: &'static str| -> Result<usize, RecordError> {
            let value = get(key)?;
            value.parse().map_err(|_| configuration(key, value, &"expected a whole number"))
        };
        Ok(Self::new()
            .with_code_dim(number("c_dim")?)
            .with_hidden(number("hidden_size")?)
            .with_blocks(number("n_blocks")?)
            .with_leaky(get("leaky")?.eq_ignore_ascii_case("true")))
    }
}

impl NetworkConfig for ImageModelConfig {
    type Network = ImageModel;
    const FORMAT: &'static str = "dvr-image-model";

    fn parameters(&self) -> u64 {
        Self::parameters(self)
    }

    fn fresh(&self, device: &Device) -> ImageModel {
        self.init(device)
    }

    fn from_keys(_: &HashMap<String, String>) -> Result<Self, RecordError> {
        Err(RecordError::MissingKey { key: "config" })
    }
}

impl NetworkConfig for ShapeModelConfig {
    type Network = ShapeModel;
    const FORMAT: &'static str = "dvr-shape-model";

    fn parameters(&self) -> u64 {
        Self::parameters(self)
    }

    fn fresh(&self, device: &Device) -> ShapeModel {
        self.init(device)
    }

    fn from_keys(_: &HashMap<String, String>) -> Result<Self, RecordError> {
        Err(RecordError::MissingKey { key: "config" })
    }
}

/// A network as the bytes of a safetensors file.
///
/// # Errors
/// Only where memory runs out or a tensor cannot be read back from its device.
pub fn to_safetensors<C: NetworkConfig>(network: &C::Network, config: &C) -> Result<Vec<u8>, RecordError> {
    let json = serde_json::to_string(config).map_err(|e| configuration("config", C::FORMAT, &e))?;
    let header = [("format", C::FORMAT.to_owned()), ("version", FORMAT_VERSION.to_string()), ("config", json)];
    let header = header.map(|(key, value)| (key.to_owned(), value)).into();
    let parts = collect(network)?.into_iter().map(|tensor| tensor.into_parts().map_err(RecordError::damaged));
    let parts = parts.collect::<Result<Vec<_>, _>>()?;
    let views = parts.iter().map(|(name, dtype, shape, _, bytes)| {
        let dtype = match dtype {
            DType::F32 => Dtype::F32,
            DType::F64 => Dtype::F64,
            DType::F16 => Dtype::F16,
            DType::BF16 => Dtype::BF16,
            DType::I64 => Dtype::I64,
            other => return Err(number_type(name, &other)),
        };
        let view = TensorView::new(dtype, shape.iter().copied().collect(), bytes);
        Ok((name, view.map_err(RecordError::damaged)?))
    });
    serialize(views.collect::<Result<Vec<_>, _>>()?, Some(header)).map_err(RecordError::damaged)
}

/// A network from the bytes of a safetensors file: one of ours, or a bare `state_dict` of the reference code's decoder with
/// `c_dim`, `hidden_size`, `n_blocks` and `leaky` in its header.
///
/// # Errors
/// When the bytes are not a safetensors file, the header does not describe this kind of network, or the tensors do not
/// fit it.
pub fn from_safetensors<C: NetworkConfig>(bytes: &[u8], device: &Device) -> Result<(C, C::Network), RecordError> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(RecordError::damaged)?;
    let config: C = read_header(metadata.metadata().as_ref().unwrap_or(&HashMap::new()))?;
    let file = SafeTensors::deserialize(bytes).map_err(RecordError::damaged)?;
    let found = file.iter().map(|(_, tensor)| tensor.shape().iter().product::<usize>() as u64).sum();
    if config.parameters() > found {
        return Err(RecordError::TooFewNumbers { found, expected: config.parameters() });
    }
    let tensors = file.iter().map(|(name, tensor)| {
        let dtype = match tensor.dtype() {
            Dtype::F32 => DType::F32,
            Dtype::F64 => DType::F64,
            Dtype::F16 => DType::F16,
            Dtype::BF16 => DType::BF16,
            Dtype::I64 => DType::I64,
            other => return Err(number_type(name, &other)),
        };
        let bytes = Bytes::from_bytes_vec(tensor.data().to_vec());
        Ok(NamedTensor::new(name.to_owned(), dtype, Shape::from(tensor.shape().to_vec()), None, bytes))
    });
    let network = fill(config.fresh(device), tensors.collect::<Result<_, _>>()?, device)?;
    Ok((config, network))
}

/// Writes a network to a file.
///
/// # Errors
/// When the file cannot be written.
pub fn save_safetensors<C: NetworkConfig>(path: &Path, network: &C::Network, config: &C) -> Result<(), RecordError> {
    let bytes = to_safetensors(network, config)?;
    Ok(dvr_core::files::write_bytes_atomically(path, &bytes)?)
}

/// Reads a network from a file; see [`from_safetensors`].
///
/// # Errors
/// When the file cannot be read or does not hold this kind of network.
pub fn load_safetensors<C: NetworkConfig>(path: &Path, device: &Device) -> Result<(C, C::Network), RecordError> {
    let bytes = dvr_core::files::read_bytes(path)?;
    from_safetensors(&bytes, device)
}

fn read_header<C: NetworkConfig>(header: &HashMap<String, String>) -> Result<C, RecordError> {
    let Some(json) = header.get("config") else { return C::from_keys(header) };
    if let Some(format) = header.get("format").filter(|format| *format != C::FORMAT) {
        return Err(RecordError::Kind { found: format.clone(), expected: C::FORMAT });
    }
    let version = header.get("version").ok_or(RecordError::MissingKey { key: "version" })?;
    if *version != FORMAT_VERSION.to_string() {
        return Err(RecordError::Version { found: version.clone(), expected: FORMAT_VERSION });
    }
    serde_json::from_str(json).map_err(|e| configuration("config", json, &e))
}

fn configuration(key: &str, value: &str, reason: &dyn std::fmt::Display) -> RecordError {
    RecordError::Configuration { key: key.to_owned(), value: value.to_owned(), reason: reason.to_string() }
}

fn number_type(name: &str, dtype: &dyn std::fmt::Debug) -> RecordError {
    RecordError::NumberType { name: name.to_owned(), dtype: format!("{dtype:?}") }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Distribution, Tensor};

    use super::*;
    use crate::EncoderConfig;

    fn bytes(config: &DecoderConfig) -> (Decoder, Vec<u8>) {
        let decoder = config.init(&Device::flex());
        let bytes = to_safetensors(&decoder, config).unwrap();
        (decoder, bytes)
    }

    #[test]
    fn a_decoder_comes_back_from_its_file_with_the_same_values() {
        let config = DecoderConfig::new().with_code_dim(3).with_hidden(16).with_blocks(2).with_octaves(2);
        let (decoder, bytes) = bytes(&config);
        let (read_config, read): (DecoderConfig, _) = from_safetensors(&bytes, &Device::flex()).unwrap();
        assert_eq!(read_config, config);
        assert_eq!(read.num_params(), decoder.num_params());
        let points = Tensor::<2>::random([5, 3], Distribution::Default, &Device::flex());
        let code = Tensor::<2>::random([5, 3], Distribution::Default, &Device::flex());
        let (a, b) = (decoder.forward(points.clone(), Some(code.clone())), read.forward(points, Some(code)));
        assert_eq!(a.into_data(), b.into_data());
    }

    #[test]
    fn tensors_have_the_reference_code_s_names_and_layout() {
        let (_, bytes) = bytes(&DecoderConfig::new().with_hidden(8).with_blocks(1));
        let file = SafeTensors::deserialize(&bytes).unwrap();
        assert_eq!(file.tensor("fc_p.weight").unwrap().shape(), [8, 3]);
        assert_eq!(file.tensor("blocks.0.fc_1.bias").unwrap().shape(), [8]);
        assert_eq!(file.tensor("fc_out.weight").unwrap().shape(), [4, 8]);
    }

    #[test]
    fn an_image_model_has_the_reference_code_s_names_and_pytorch_s_counts_of_batches() {
        let decoder = DecoderConfig::new().with_code_dim(4).with_hidden(8).with_blocks(1);
        let config = ImageModelConfig { encoder: EncoderConfig::default(), decoder };
        let model = config.init(&Device::flex().autodiff());
        model.codes(
            Tensor::from_inner(Tensor::ones([1, 3, 32, 32], &Device::flex())),
            Tensor::from_ints([0], &Device::flex()),
        );
        let bytes = to_safetensors(&model, &config).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        assert_eq!(file.tensor("encoder.features.layer2.0.downsample.1.running_var").unwrap().shape(), [128]);
        assert_eq!(file.tensor("encoder.features.layer1.1.bn2.weight").unwrap().shape(), [64]);
        assert_eq!(file.tensor("encoder.fc.weight").unwrap().shape(), [4, 512]);
        assert_eq!(file.tensor("decoder.fc_c.0.weight").unwrap().shape(), [8, 4]);
        let counts = file.iter().filter(|(name, _)| name.ends_with("num_batches_tracked"));
        let counts: Vec<_> = counts.map(|(_, count)| (count.shape().len(), count.data()[0])).collect();
        assert_eq!(counts, vec![(0, 1); 20]);
        let (read_config, read): (ImageModelConfig, _) = from_safetensors(&bytes, &Device::flex()).unwrap();
        assert_eq!(read_config, config);
        let again = to_safetensors(&read, &config).unwrap();
        let again = SafeTensors::deserialize(&again).unwrap();
        assert_eq!(again.len(), file.len());
        assert!(file.iter().all(|(name, tensor)| again.tensor(name).unwrap() == tensor));
        assert!(matches!(from_safetensors::<DecoderConfig>(&bytes, &Device::flex()), Err(RecordError::Kind { .. })));
    }

    #[test]
    fn broken_files_are_refused_with_their_reason() {
        let (decoder, good) = bytes(&DecoderConfig::new().with_hidden(8).with_blocks(1));
        let device = Device::flex();
        assert!(matches!(
            from_safetensors::<DecoderConfig>(&good[..good.len() / 2], &device),
            Err(RecordError::Damaged { .. })
        ));
        assert!(matches!(from_safetensors::<DecoderConfig>(b"", &device), Err(RecordError::Damaged { .. })));
        let less = to_safetensors(&decoder, &DecoderConfig::new().with_hidden(7).with_blocks(1)).unwrap();
        assert!(matches!(from_safetensors::<DecoderConfig>(&less, &device), Err(RecordError::Shape { .. })));
        let more = to_safetensors(&decoder, &DecoderConfig::new().with_hidden(9).with_blocks(1)).unwrap();
        assert!(matches!(from_safetensors::<DecoderConfig>(&more, &device), Err(RecordError::TooFewNumbers { .. })));
        let fewer = to_safetensors(&decoder, &DecoderConfig::new().with_hidden(8).with_blocks(0)).unwrap();
        assert!(matches!(from_safetensors::<DecoderConfig>(&fewer, &device), Err(RecordError::UnknownTensors { .. })));
    }

    #[test]
    fn another_version_is_refused() {
        let json = serde_json::to_string(&DecoderConfig::new()).unwrap();
        let header = |version: &str| {
            let entries = [("format", "dvr-decoder"), ("version", version), ("config", json.as_str())];
            entries.map(|(key, value)| (key.to_owned(), value.to_owned())).into()
        };
        let refused = read_header::<DecoderConfig>(&header("7")).unwrap_err();
        assert_eq!(refused.to_string(), "the file has format version \"7\", expected 1");
        assert!(matches!(read_header::<DecoderConfig>(&header("")), Err(RecordError::Version { .. })));
        assert!(read_header::<DecoderConfig>(&header("1")).is_ok());
    }
}
