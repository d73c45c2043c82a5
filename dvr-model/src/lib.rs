//! Burn modules for differentiable volumetric rendering.
#![warn(missing_docs)]

mod decoder;
mod encoding;
mod record;

pub use decoder::{Conditioned, Decoder, DecoderConfig, ResnetBlock};
pub use record::{
    FORMAT_VERSION, RecordError, from_safetensors, load_safetensors, save_safetensors, to_safetensors,
};
