//! A model of many objects that makes whole shapes: an encoder and a shape decoder.

use burn::module::Module;
use burn::tensor::{Device, Int, Tensor};
use dvr_core::Camera;
use dvr_core::number_range::{NumberRange, OutOfRange, check_config, nested, whole};
use serde::{Deserialize, Serialize};

use super::{Deformed, ShapeDecoder, ShapeDecoderConfig};
use crate::encoder::{Encoder, EncoderConfig};

/// Configuration of a [`ShapeModel`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShapeModelConfig {
    /// What makes the codes.
    pub encoder: EncoderConfig,
    /// Length of the codes.
    pub code_dim: usize,
    /// What makes shapes of them.
    pub decoder: ShapeDecoderConfig,
}

impl ShapeModelConfig {
    /// The range of every number.
    pub fn ranges() -> Vec<NumberRange> {
        let code = vec![whole("code_dim", 1, 4096)];
        [nested("encoder", EncoderConfig::RANGES), nested("decoder", ShapeDecoderConfig::RANGES), code].concat()
    }

    /// Checks that a model can be made of it.
    ///
    /// # Errors
    /// Names the first value that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        check_config(self, &Self::ranges())?;
        let takes_places = matches!(self.decoder, ShapeDecoderConfig::Graph { .. });
        let kind = match self.encoder {
            EncoderConfig::Local { .. } => "local",
            EncoderConfig::LocalBn { .. } => "local-bn",
            EncoderConfig::Resnet18 { .. } => "resnet18",
            EncoderConfig::Convolutional { .. } => "convolutional",
            EncoderConfig::ConvolutionalBn { .. } => "convolutional-bn",
            EncoderConfig::Codes { .. } => "codes",
        };
        if takes_places != self.encoder.local_channels().is_some() {
            let range = if takes_places {
                "`local` or `local-bn` for the decoder of kind `graph`"
            } else {
                "`local` and `local-bn` for the decoder of kind `graph` alone"
            };
            return Err(OutOfRange::new("encoder.kind", kind, range));
        }
        self.encoder.check_image_size()
    }

    /// How many numbers the model has at least.
    pub fn parameters(&self) -> u64 {
        self.decoder.parameters(self.code_dim).saturating_add(self.encoder.parameters(self.code_dim))
    }

    /// A model with fresh parameters.
    pub fn init(&self, device: &Device) -> ShapeModel {
        let encoder = self.encoder.init(self.code_dim, device);
        let channels = self.encoder.local_channels().unwrap_or(0);
        ShapeModel { encoder, decoder: self.decoder.init(self.code_dim, channels, device) }
    }
}

/// An encoder and a shape decoder.
#[derive(Module, Debug)]
pub struct ShapeModel {
    /// Makes the codes.
    pub encoder: Encoder,
    /// Makes shapes of them.
    pub decoder: ShapeDecoder,
}

impl ShapeModel {
    /// Codes `[b, code_dim]` of a batch of objects; see [`Encoder::forward`].
    pub fn codes(&self, images: Tensor<4>, objects: Tensor<1, Int>) -> Tensor<2> {
        self.encoder.forward(images, objects)
    }

    /// The meshes of the stages of a [`GraphDecoder`](super::GraphDecoder), and how far the cameras that the encoder guesses are
    /// from those that are known, `[1]`. `cameras` are those of the images, in object space; without them, they are guessed.
    /// `None` where the model has none of these.
    pub fn deformed(
        &self,
        images: Tensor<4>,
        cameras: Option<&[Camera]>,
    ) -> Option<(Vec<Deformed>, Option<Tensor<1>>)> {
        let (Encoder::Local(local), ShapeDecoder::Graph(decoder)) = (&self.encoder, &self.decoder) else { return None };
        let (objects, device) = (images.dims()[0], images.device());
        let (aligned, _, error) = local.aligned(images, cameras);
        Some((decoder.forward(&aligned, objects, &device), error))
    }
}
