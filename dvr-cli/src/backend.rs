//! Where the computation runs.

use burn::tensor::Device;
use clap::ValueEnum;

/// The backends that this binary was built with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Backend {
    /// burn-flex: pure Rust, all cores
    Cpu,
    /// burn-ndarray: the older CPU backend, as a second opinion
    #[cfg(feature = "ndarray")]
    Ndarray,
}

impl Backend {
    /// The device, without autodiff.
    // Upstream deprecates burn-ndarray; here it is a second opinion behind a feature.
    #[cfg_attr(feature = "ndarray", allow(deprecated))]
    pub fn device(self) -> Device {
        match self {
            Self::Cpu => Device::flex(),
            #[cfg(feature = "ndarray")]
            Self::Ndarray => Device::ndarray(),
        }
    }
}
