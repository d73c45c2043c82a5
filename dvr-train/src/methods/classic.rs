//! DVR's network with the paper's settings: for comparison, and for long runs.

use dvr_core::Supervision;
use dvr_model::Decoder;

use crate::config::TrainConfig;
use crate::methods::field_method::FieldMethod;
use crate::methods::network::decoder_method;

/// The method with its defaults.
pub fn classic(supervision: Supervision) -> FieldMethod<Decoder> {
    decoder_method("classic", TrainConfig::classic(supervision))
}
