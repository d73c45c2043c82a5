//! DVR's network, started from the visual hull: minutes a scene.

use dvr_core::Supervision;
use dvr_model::{Decoder, save_safetensors};

use crate::config::TrainConfig;
use crate::error::Error;
use crate::methods::field_method::FieldMethod;
use crate::methods::memory_estimate::scene_step_bytes;

/// The method with its defaults.
pub fn network(supervision: Supervision) -> FieldMethod<Decoder> {
    decoder_method("network", TrainConfig::new(supervision))
}

/// A method that trains a decoder, of any name and configuration.
pub(crate) fn decoder_method(name: &str, config: TrainConfig) -> FieldMethod<Decoder> {
    FieldMethod::new(name, config, |config, device| config.model.init(device))
        .with_decoder_settings()
        .with_memory_estimate(scene_step_bytes)
        .saved_by(|config, decoder, path| {
            save_safetensors(path, decoder, &config.model).map_err(|e| Error::NotSaved { problem: e.to_string() })
        })
}
