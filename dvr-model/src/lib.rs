//! Networks for differentiable volumetric rendering, as burn modules: the decoder of DVR (Niemeyer et al. 2020), the
//! encoders that make its latent codes from pictures, their files, and the checkpoints of DVR's reference code.
//!
//! A [`Decoder`] is a [`dvr_render::Field`]: it is differentiated by forward mode, evaluated on the CPU in fused tiles, and
//! marched by a kernel on a GPU.
//!
//! ```
//! use burn::tensor::{Device, Tensor};
//! use dvr_model::{DecoderConfig, from_safetensors, to_safetensors};
//! use dvr_render::{Differentiable, Query};
//!
//! // A network for one scene, asked at two points for value and slope along x in one forward-mode pass.
//! let device = Device::flex();
//! let config = DecoderConfig::new().with_hidden(32).with_octaves(4);
//! let decoder = config.init(&device);
//! let points = Query::new(Tensor::from_floats([[0.0, 0.1, 0.2], [0.3, 0.0, -0.1]], &device));
//! let along_x = Tensor::from_floats([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], &device);
//! let jet = decoder.jet(&points, along_x);
//! println!("logits {} slopes {}", jet.value.occupancy_logit, jet.derivative.occupancy_logit);
//!
//! // To safetensors, with PyTorch's names and layout, and back.
//! let bytes = to_safetensors(&decoder, &config)?;
//! let (read_config, _): (DecoderConfig, _) = from_safetensors(&bytes, &device)?;
//! assert_eq!(read_config, config);
//! # Ok::<(), dvr_model::RecordError>(())
//! ```
//!
//! One network for many objects: pictures become codes, and codes fields.
//!
//! ```
//! use burn::tensor::{Device, Tensor};
//! use dvr_model::{DecoderConfig, EncoderConfig, ImageModelConfig};
//! use dvr_render::{Field, Query};
//!
//! let device = Device::flex();
//! let encoder = EncoderConfig::Convolutional { image_size: 64, width: 4 };
//! let decoder = DecoderConfig::new().with_code_dim(16).with_hidden(32);
//! let model = ImageModelConfig { encoder, decoder }.init(&device);
//! let pictures = Tensor::ones([2, 3, 64, 64], &device);
//! let field = model.see(pictures, Tensor::from_ints([0, 1], &device), None).field;
//! // A point of each object.
//! let points = Tensor::from_floats([[0.0, 0.1, 0.2], [0.3, 0.0, -0.1]], &device);
//! let query = Query { object: Some(Tensor::from_ints([0, 1], &device)), ..Query::new(points) };
//! assert_eq!(field.evaluate(&query).color.dims(), [2, 3]);
//! ```

#![warn(missing_docs)]

mod aligned_features;
mod conditioned;
mod decoder;
mod decoder_at_points;
mod encoder;
mod encoding;
mod error;
mod fused;
#[cfg(feature = "gpu")]
mod gpu_march;
mod host_function;
mod image_model;
mod matrices;
mod mlp;
mod object_field;
mod picture_camera;
mod pixel_aligned;
mod pytorch;
mod record;
mod seeded;
mod shapes;
mod tensors;

pub use conditioned::Conditioned;
pub use decoder::{Decoder, DecoderConfig, ResnetBlock};
pub use encoder::{
    BasicBlock, Codes, Convolutional, ConvolutionalBn, Convolutions, Encoder, EncoderConfig, Local, LocalFeatures,
    NormalisedConvolution, Resnet18, Resnet18Features,
};
pub use error::RecordError;
pub use fused::FusedDecoder;
pub use image_model::{AlignedLayer, ImageModel, ImageModelConfig, Seen};
pub use object_field::ObjectField;
pub use pytorch::{AdamMoments, Imported, ImportedNetwork, PytorchCheckpoint, load_pretrained, read_pytorch};
pub use record::{FORMAT_VERSION, NetworkConfig, from_safetensors, load_safetensors, save_safetensors, to_safetensors};
pub use seeded::seeded;
pub use shapes::{
    Deformed, GraphDecoder, PatchDecoder, PointDecoder, ShapeDecoder, ShapeDecoderConfig, ShapeModel, ShapeModelConfig,
    SphereDecoder, VoxelDecoder,
};
