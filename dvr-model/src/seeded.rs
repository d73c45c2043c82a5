//! Fresh parameters that are the same for a seed, whatever else draws numbers meanwhile.

use std::sync::{Mutex, PoisonError};

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Tensor};

/// A module with fresh parameters, which are the same for a seed on a backend.
///
/// Burn keeps one random generator for each backend and process, and a fresh parameter draws its numbers when it is first
/// looked at. Here a module's numbers are drawn at once, and modules that several threads make take turns. What draws
/// numbers on another thread without this function (`Tensor::random`, or a module's own `init`) may still come in between.
///
/// ```
/// use burn::tensor::Device;
/// use dvr_model::{DecoderConfig, seeded};
///
/// let (device, config) = (Device::flex(), DecoderConfig::new().with_hidden(8));
/// let weights = |seed| seeded(&device, seed, || config.init(&device)).fc_p.weight.val().into_data();
/// assert_eq!(weights(7), weights(7));
/// assert_ne!(weights(7), weights(8));
/// ```
pub fn seeded<M: Module>(device: &Device, seed: u64, make: impl FnOnce() -> M) -> M {
    static TURN: Mutex<()> = Mutex::new(());
    // Where a thread panicked while it had its turn, nothing is left half done.
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    device.seed(seed);
    let module = make();
    module.visit(&mut DrawnNow);
    module
}

/// Looks at every parameter.
struct DrawnNow;

impl ModuleVisitor for DrawnNow {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        param.val();
    }
}
