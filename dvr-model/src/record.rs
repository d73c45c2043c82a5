//! Decoders on disk: safetensors with the configuration and a format version in the header.
//!
//! Tensors carry the names and the layout (`[out, in]`) of the original's PyTorch modules, so that the files go both
//! ways: `torch.nn.Module.load_state_dict` takes what is written here, and what the original exported is read.

use std::collections::HashMap;
use std::path::Path;

use burn::tensor::Device;
use burn_store::{BurnToPyTorchAdapter, ModuleSnapshot, ModuleStore, PyTorchToBurnAdapter, SafetensorsStore};
use safetensors::SafeTensors;

use crate::decoder::{Decoder, DecoderConfig};

/// Version of the header that [`to_safetensors`] writes.
pub const FORMAT_VERSION: u32 = 1;

/// Value of the header's `format` key.
const FORMAT: &str = "dvr-decoder";

/// Why a decoder cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file itself.
    #[error(transparent)]
    File(#[from] dvr_core::Error),
    /// Not a safetensors file, or a broken one.
    #[error("not a readable safetensors file: {0}")]
    Container(String),
    /// The header lacks the configuration, or it cannot be understood.
    #[error("the header does not describe a decoder: {0}")]
    Header(String),
    /// Written by a newer program.
    #[error("format version {found} is newer than {FORMAT_VERSION}, the newest this program reads; update dvr")]
    Version {
        /// The version in the file.
        found: u32,
    },
    /// Tensors do not fit the configuration.
    #[error("the tensors do not fit the decoder that the header describes: {0}")]
    Shape(String),
}

/// A decoder as the bytes of a safetensors file.
///
/// # Errors
/// Only where memory runs out or a tensor cannot be read back from its device.
pub fn to_safetensors(decoder: &Decoder, config: &DecoderConfig) -> Result<Vec<u8>, RecordError> {
    let json = serde_json::to_string(config).map_err(|e| RecordError::Header(e.to_string()))?;
    let mut store = SafetensorsStore::from_bytes(None)
        .with_to_adapter(BurnToPyTorchAdapter)
        .metadata("format", FORMAT)
        .metadata("version", FORMAT_VERSION.to_string())
        .metadata("config", json);
    store.collect_from(decoder).map_err(|e| RecordError::Container(e.to_string()))?;
    store.get_bytes().map_err(|e| RecordError::Container(e.to_string()))
}

/// A decoder from the bytes of a safetensors file: one of ours, or a bare `state_dict` of the original with `c_dim`,
/// `hidden_size`, `n_blocks` and `leaky` in its header.
///
/// # Errors
/// When the bytes are no safetensors file, the header does not describe a decoder, or the tensors do not fit it.
pub fn from_safetensors(bytes: &[u8], device: &Device) -> Result<(DecoderConfig, Decoder), RecordError> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| RecordError::Container(e.to_string()))?;
    let config = read_header(metadata.metadata().as_ref().unwrap_or(&HashMap::new()))?;
    let mut decoder = config.init(device);
    let mut store = SafetensorsStore::from_bytes(Some(bytes.to_vec())).with_from_adapter(PyTorchToBurnAdapter);
    let applied = decoder.load_from(&mut store).map_err(|e| RecordError::Shape(e.to_string()))?;
    if let Some(unused) = applied.unused.first() {
        return Err(RecordError::Shape(format!("tensor {unused:?} has no place in it")));
    }
    Ok((config, decoder))
}

/// Writes a decoder to a file.
///
/// # Errors
/// When the file cannot be written.
pub fn save_safetensors(path: &Path, decoder: &Decoder, config: &DecoderConfig) -> Result<(), RecordError> {
    let bytes = to_safetensors(decoder, config)?;
    Ok(dvr_core::files::write_bytes_atomically(path, &bytes)?)
}

/// Reads a decoder from a file; see [`from_safetensors`].
///
/// # Errors
/// When the file cannot be read or does not hold a decoder.
pub fn load_safetensors(path: &Path, device: &Device) -> Result<(DecoderConfig, Decoder), RecordError> {
    let bytes = std::fs::read(path).map_err(|e| dvr_core::Error::io(path, e))?;
    from_safetensors(&bytes, device)
}

fn read_header(header: &HashMap<String, String>) -> Result<DecoderConfig, RecordError> {
    if let Some(json) = header.get("config") {
        let version = header.get("version").and_then(|v| v.parse().ok()).unwrap_or(0);
        if version > FORMAT_VERSION {
            return Err(RecordError::Version { found: version });
        }
        return serde_json::from_str(json).map_err(|e| RecordError::Header(e.to_string()));
    }
    let get = |key: &str| header.get(key).ok_or_else(|| RecordError::Header(format!("key {key:?} is missing")));
    let number = |key: &str| -> Result<usize, RecordError> {
        let value = get(key)?;
        value.parse().map_err(|_| RecordError::Header(format!("{key} is {value:?}, not a number")))
    };
    Ok(DecoderConfig::new()
        .with_code_dim(number("c_dim")?)
        .with_hidden(number("hidden_size")?)
        .with_blocks(number("n_blocks")?)
        .with_leaky(get("leaky")?.eq_ignore_ascii_case("true")))
}

#[cfg(test)]
mod tests {
    use burn::module::Module;
    use burn::tensor::{Distribution, Tensor};

    use super::*;

    fn bytes(config: &DecoderConfig) -> (Decoder, Vec<u8>) {
        let decoder = config.init(&Device::flex());
        let bytes = to_safetensors(&decoder, config).unwrap();
        (decoder, bytes)
    }

    #[test]
    fn a_decoder_comes_back_from_its_file_with_the_same_values() {
        let config = DecoderConfig::new().with_code_dim(3).with_hidden(16).with_blocks(2).with_octaves(2);
        let (decoder, bytes) = bytes(&config);
        let (read_config, read) = from_safetensors(&bytes, &Device::flex()).unwrap();
        assert_eq!(read_config, config);
        assert_eq!(read.num_params(), decoder.num_params());
        let points = Tensor::<2>::random([5, 3], Distribution::Default, &Device::flex());
        let code = Tensor::<2>::random([5, 3], Distribution::Default, &Device::flex());
        let (a, b) = (decoder.forward(points.clone(), Some(code.clone())), read.forward(points, Some(code)));
        assert_eq!(a.into_data(), b.into_data());
    }

    #[test]
    fn tensors_have_the_originals_names_and_layout() {
        let (_, bytes) = bytes(&DecoderConfig::new().with_hidden(8).with_blocks(1));
        let file = SafeTensors::deserialize(&bytes).unwrap();
        assert_eq!(file.tensor("fc_p.weight").unwrap().shape(), [8, 3]);
        assert_eq!(file.tensor("blocks.0.fc_1.bias").unwrap().shape(), [8]);
        assert_eq!(file.tensor("fc_out.weight").unwrap().shape(), [4, 8]);
    }

    #[test]
    fn broken_files_are_refused_with_their_reason() {
        let (decoder, good) = bytes(&DecoderConfig::new().with_hidden(8).with_blocks(1));
        let device = Device::flex();
        assert!(matches!(from_safetensors(&good[..good.len() / 2], &device), Err(RecordError::Container(_))));
        assert!(matches!(from_safetensors(b"", &device), Err(RecordError::Container(_))));
        let wrong = to_safetensors(&decoder, &DecoderConfig::new().with_hidden(9).with_blocks(1)).unwrap();
        assert!(matches!(from_safetensors(&wrong, &device), Err(RecordError::Shape(_))));
        let fewer = to_safetensors(&decoder, &DecoderConfig::new().with_hidden(8).with_blocks(0)).unwrap();
        assert!(matches!(from_safetensors(&fewer, &device), Err(RecordError::Shape(_))));
    }
}
