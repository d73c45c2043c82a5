//! From an image, or an object's number, to the latent code that conditions the decoder.

mod codes;
mod convolution;
mod convolutional;
mod convolutional_bn;
mod convolved;
mod local;
mod normalised_convolutions;
mod pooling;
mod resnet18;
#[cfg(test)]
mod tests;

use burn::module::Module;
use burn::tensor::{Device, Int, Tensor};
use dvr_core::number_range::{NumberRange, OutOfRange, whole};
use serde::{Deserialize, Serialize};

pub use codes::Codes;
pub use convolutional::Convolutional;
pub use convolutional_bn::{ConvolutionalBn, NormalisedConvolution};
pub use local::{Convolutions, Local, LocalFeatures};
pub use resnet18::{BasicBlock, Resnet18, Resnet18Features};

/// Configuration of an [`Encoder`]; in JSON its `kind` says which, and what is left out has its default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum EncoderConfig {
    /// The paper's encoder, see [`Resnet18`].
    Resnet18 {
        /// Side that images are resized to, pixels.
        #[serde(default = "image_size")]
        image_size: usize,
    },
    /// A fifth of its cost, see [`Convolutional`].
    Convolutional {
        /// Side that images are resized to, pixels.
        #[serde(default = "image_size")]
        image_size: usize,
        /// Channels of the first layer; each further layer has twice as many.
        #[serde(default = "width")]
        width: usize,
    },
    /// As large, with batch normalisation, see [`ConvolutionalBn`].
    ConvolutionalBn {
        /// Side that images are resized to, pixels.
        #[serde(default = "small_image_size")]
        image_size: usize,
        /// Channels of the first layer; each further layer has twice as many.
        #[serde(default = "width")]
        width: usize,
    },
    /// The convolutional one, whose features a decoder finds where a point lies in the picture, see [`Local`].
    Local {
        /// Side that images are resized to, pixels.
        #[serde(default = "small_image_size")]
        image_size: usize,
        /// Channels of the first layer; each further layer has twice as many.
        #[serde(default = "width")]
        width: usize,
        /// Features of a place in the picture.
        #[serde(default = "channels")]
        channels: usize,
    },
    /// The same with batch normalisation.
    LocalBn {
        /// Side that images are resized to, pixels.
        #[serde(default = "small_image_size")]
        image_size: usize,
        /// Channels of the first layer; each further layer has twice as many.
        #[serde(default = "width")]
        width: usize,
        /// Features of a place in the picture.
        #[serde(default = "channels")]
        channels: usize,
    },
    /// A learned code for each training object and no image, see [`Codes`].
    Codes {
        /// How many objects; training fills it in.
        #[serde(default)]
        objects: usize,
    },
}

/// The side of images that DVR's reference code and ImageNet's classifiers take.
fn image_size() -> usize {
    224
}

/// The side of the images of the default, which features of places are made for.
fn small_image_size() -> usize {
    64
}

fn channels() -> usize {
    64
}

/// Channels of the first convolution in DVR's reference code.
fn width() -> usize {
    32
}

impl EncoderConfig {
    /// The range of every number of any kind.
    pub const RANGES: &[NumberRange] = &[
        whole("image_size", 16, 4096),
        whole("width", 1, 1024),
        whole("channels", 1, 4096),
        whole("objects", 0, 10_000_000),
    ];
}

impl Default for EncoderConfig {
    /// The paper's.
    fn default() -> Self {
        Self::Resnet18 { image_size: image_size() }
    }
}

impl EncoderConfig {
    /// Side that images are resized to, pixels; `None` where there are no images.
    pub fn image_size(&self) -> Option<usize> {
        match self {
            Self::Resnet18 { image_size }
            | Self::Convolutional { image_size, .. }
            | Self::ConvolutionalBn { image_size, .. }
            | Self::Local { image_size, .. }
            | Self::LocalBn { image_size, .. } => Some(*image_size),
            Self::Codes { .. } => None,
        }
    }

    /// Features of each place in a picture, where there are any: decoders then look them up, by the picture's camera.
    pub fn local_channels(&self) -> Option<usize> {
        match self {
            Self::Local { channels, .. } | Self::LocalBn { channels, .. } => Some(*channels),
            Self::Resnet18 { .. } | Self::Convolutional { .. } | Self::ConvolutionalBn { .. } | Self::Codes { .. } => {
                None
            }
        }
    }

    /// Checks that images are large enough for the layers.
    ///
    /// # Errors
    /// Names the size and the least that there must be.
    pub fn check_image_size(&self) -> Result<(), OutOfRange> {
        match *self {
            Self::Convolutional { image_size, .. } | Self::Local { image_size, .. }
                if image_size < Convolutional::SMALLEST_IMAGE =>
            {
                let range = format!("at least {} for the convolutional encoder", Convolutional::SMALLEST_IMAGE);
                Err(OutOfRange::new("encoder.image_size", image_size, range))
            }
            _ => Ok(()),
        }
    }

    /// How many numbers the encoder has at least: its largest layers.
    pub fn parameters(&self, code_dim: usize) -> u64 {
        let code_dim = code_dim as u64;
        match *self {
            Self::Resnet18 { .. } => code_dim.saturating_mul(512),
            Self::Convolutional { width, .. } => convolutional_parameters(width, code_dim),
            Self::ConvolutionalBn { width, .. } => convolutional_parameters(width, code_dim.saturating_mul(4)),
            Self::Local { width, channels, .. } => {
                convolutional_parameters(width, code_dim).saturating_add(smooth_parameters(channels))
            }
            Self::LocalBn { width, channels, .. } => {
                let convolutional = convolutional_parameters(width, code_dim.saturating_mul(4));
                convolutional.saturating_add(smooth_parameters(channels))
            }
            Self::Codes { objects } => (objects as u64).saturating_mul(code_dim),
        }
    }

    /// An encoder with fresh parameters that makes codes of length `code_dim`.
    pub fn init(&self, code_dim: usize, device: &Device) -> Encoder {
        match *self {
            Self::Resnet18 { .. } => Encoder::Resnet18(Resnet18::new(code_dim, device)),
            Self::Convolutional { width, .. } => Encoder::Convolutional(Convolutional::new(width, code_dim, device)),
            Self::ConvolutionalBn { width, .. } => {
                Encoder::ConvolutionalBn(ConvolutionalBn::new(width, code_dim, device))
            }
            Self::Local { width, channels, .. } => {
                let convolutions = Convolutions::Plain(Convolutional::new(width, code_dim, device));
                Encoder::Local(Local::new(convolutions, width, channels, device))
            }
            Self::LocalBn { width, channels, .. } => {
                let convolutions = Convolutions::Normalised(ConvolutionalBn::new(width, code_dim, device));
                Encoder::Local(Local::new(convolutions, width, channels, device))
            }
            Self::Codes { objects } => Encoder::Codes(Codes::new(objects, code_dim, device)),
        }
    }
}

fn convolutional_parameters(width: usize, code_dim: u64) -> u64 {
    let width = width.max(1) as u64;
    let last = width.saturating_mul(width).saturating_mul(8 * 16 * 9);
    last.saturating_add(code_dim.saturating_mul(width.saturating_mul(16)))
}

fn smooth_parameters(channels: usize) -> u64 {
    (channels as u64).saturating_mul(channels as u64).saturating_mul(9)
}

/// Makes the latent codes of objects (`c` in DVR, section 3.1).
#[derive(Module, Debug)]
#[allow(clippy::large_enum_variant)] // there is one per model, and burn's modules take no box
pub enum Encoder {
    /// From an image, by a ResNet-18.
    Resnet18(Resnet18),
    /// From an image, by five convolutions.
    Convolutional(Convolutional),
    /// From an image, by five convolutions with batch normalisation.
    ConvolutionalBn(ConvolutionalBn),
    /// From an image, by five convolutions, with batch normalisation or without, whose features stay where they are.
    Local(Local),
    /// From the object's number.
    Codes(Codes),
}

impl Encoder {
    /// Codes `[b, code_dim]` of a batch of objects.
    ///
    /// `images` is `[b, 3, height, width]`, sRGB in `[0, 1]`, and `objects` the row of each in the table of codes,
    /// `[b]`. Each kind uses one of the two.
    pub fn forward(&self, images: Tensor<4>, objects: Tensor<1, Int>) -> Tensor<2> {
        match self {
            Self::Resnet18(encoder) => encoder.forward(images),
            Self::Convolutional(encoder) => encoder.forward(images),
            Self::ConvolutionalBn(encoder) => encoder.forward(images),
            Self::Local(encoder) => encoder.codes(images),
            Self::Codes(codes) => codes.forward(objects),
        }
    }
}
