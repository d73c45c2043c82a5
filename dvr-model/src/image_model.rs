//! The model of many objects: an encoder that makes codes and the decoder that they condition.

use burn::module::Module;
use burn::tensor::{Device, Int, Tensor};
use serde::{Deserialize, Serialize};

use crate::conditioned::Conditioned;
use crate::decoder::{Decoder, DecoderConfig};
use crate::encoder::{Convolutional, Encoder, EncoderConfig};

/// Configuration of an [`ImageModel`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageModelConfig {
    /// What makes the codes.
    pub encoder: EncoderConfig,
    /// What they condition; its `code_dim` is the codes' length for both.
    pub decoder: DecoderConfig,
}

impl Default for ImageModelConfig {
    /// The paper's: a ResNet-18, codes of length 256 and a decoder of width 512.
    fn default() -> Self {
        Self { encoder: EncoderConfig::default(), decoder: DecoderConfig::new().with_code_dim(256).with_hidden(512) }
    }
}

/// A configuration value that no model can have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key} is {value}; it must be {range}")]
pub struct OutOfRange {
    /// The key, with dots, below the model's own configuration.
    pub key: &'static str,
    /// What it says.
    pub value: usize,
    /// What it may say.
    pub range: &'static str,
}

/// Side of the smallest image that a ResNet-18 is given: it halves five times.
const SMALLEST_RESNET_IMAGE: usize = 16;

/// Side of the largest image; memory grows with its square.
const LARGEST_IMAGE: usize = 4096;

impl ImageModelConfig {
    /// Checks that a model can be made of it.
    ///
    /// # Errors
    /// Names the first value that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let check = |ok: bool, key, value, range| if ok { Ok(()) } else { Err(OutOfRange { key, value, range }) };
        let decoder = &self.decoder;
        check(decoder.code_dim > 0, "decoder.code_dim", decoder.code_dim, "at least 1 (the paper's is 256)")?;
        check(decoder.hidden > 0, "decoder.hidden", decoder.hidden, "at least 1")?;
        check(decoder.octaves <= 16, "decoder.octaves", decoder.octaves, "at most 16")?;
        match self.encoder {
            EncoderConfig::Resnet18 { image_size } => {
                let fits = (SMALLEST_RESNET_IMAGE..=LARGEST_IMAGE).contains(&image_size);
                check(fits, "encoder.image_size", image_size, "between 16 and 4096 pixels")
            }
            EncoderConfig::Convolutional { image_size, width } => {
                let fits = (Convolutional::SMALLEST_IMAGE..=LARGEST_IMAGE).contains(&image_size);
                check(fits, "encoder.image_size", image_size, "between 63 and 4096 pixels")?;
                check((1..=1024).contains(&width), "encoder.width", width, "between 1 and 1024")
            }
            EncoderConfig::Codes { .. } => Ok(()),
        }
    }

    /// A model with fresh parameters.
    pub fn init(&self, device: &Device) -> ImageModel {
        ImageModel { encoder: self.encoder.init(self.decoder.code_dim, device), decoder: self.decoder.init(device) }
    }
}

/// An encoder and a decoder, with the parameter names of the checkpoints of DVR's reference code.
#[derive(Module, Debug)]
pub struct ImageModel {
    /// Makes the codes.
    pub encoder: Encoder,
    /// Makes occupancy and colour of a point and a code.
    pub decoder: Decoder,
}

impl ImageModel {
    /// Codes `[b, code_dim]` of a batch of objects; see [`Encoder::forward`].
    pub fn codes(&self, images: Tensor<4>, objects: Tensor<1, Int>) -> Tensor<2> {
        self.encoder.forward(images, objects)
    }

    /// The field of objects with these codes, `[b, code_dim]`; a query's object index picks the row.
    pub fn field(&self, codes: Tensor<2>) -> Conditioned {
        self.decoder.with_codes(codes)
    }
}
