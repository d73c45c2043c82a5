//! The model of many objects: an encoder that makes codes and the decoder that they condition.

use burn::module::Module;
use burn::tensor::{Device, Int, Tensor};
use dvr_core::number_range::{NumberRange, OutOfRange, check_config, nested};
use serde::{Deserialize, Serialize};

use crate::conditioned::Conditioned;
use crate::decoder::{Decoder, DecoderConfig};
use crate::encoder::{Encoder, EncoderConfig};

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

impl ImageModelConfig {
    /// The range of every number.
    pub fn ranges() -> Vec<NumberRange> {
        [nested("encoder", EncoderConfig::RANGES), nested("decoder", DecoderConfig::RANGES)].concat()
    }

    /// Checks that a model can be made of it.
    ///
    /// # Errors
    /// Names the first value that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        check_config(self, &Self::ranges())?;
        let code_dim = self.decoder.code_dim;
        if code_dim == 0 {
            return Err(OutOfRange::new("decoder.code_dim", code_dim, "at least 1 (the paper's is 256)"));
        }
        self.encoder.check_image_size()
    }

    /// How many numbers the model has at least.
    pub fn parameters(&self) -> u64 {
        self.decoder.parameters().saturating_add(self.encoder.parameters(self.decoder.code_dim))
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
