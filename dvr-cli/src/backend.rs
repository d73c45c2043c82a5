//! Where the computation runs.

use std::fmt;
use std::str::FromStr;

use anyhow::{Result, bail};
use burn::tensor::Device;
use dvr_train::{Hardware, Method};

/// What `--backend` says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// burn-flex: pure Rust, all cores.
    Cpu,
    /// A graphics processor, by its place in `dvr devices`.
    Gpu(usize),
    /// An NVIDIA card through CUDA, by its place there.
    Cuda(usize),
    /// burn-ndarray: the older CPU backend, as a second opinion.
    Ndarray,
}

/// For `--help`.
pub const HELP: &str = "Where to compute: cpu; gpu or gpu:N (Vulkan, Metal, DirectX 12; `dvr devices` lists them); cuda or cuda:N \
    and ndarray (another CPU backend, as a second opinion), where built in";

impl Backend {
    /// The device, without autodiff.
    ///
    /// # Errors
    /// When this program was built without the backend, or the device is not there or cannot be opened.
    // Upstream deprecates burn-ndarray; here it is a second opinion behind a feature.
    #[cfg_attr(feature = "ndarray", allow(deprecated))]
    pub fn device(self) -> Result<Device> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            #[cfg(feature = "gpu")]
            Self::Gpu(index) => crate::gpu::open(index),
            #[cfg(feature = "cuda")]
            Self::Cuda(index) => crate::gpu::open_cuda(index),
            #[cfg(feature = "ndarray")]
            Self::Ndarray => Ok(Device::ndarray()),
            #[allow(unreachable_patterns)]
            _ => {
                let feature = self.to_string();
                let feature = feature.split(':').next().unwrap_or_default();
                bail!("this dvr was built without --backend {feature}: build it with `--features {feature}`")
            }
        }
    }

    /// The device on which a method is to train. The visual hull has no steps to train, and a second CPU backend is
    /// nothing to fields on grids: where something else was asked for, that is said.
    ///
    /// # Errors
    /// As [`Backend::device`].
    pub fn training_device(self, method: &dyn Method) -> Result<Device> {
        match (method.hardware(), self) {
            (Hardware::Cpu, Self::Gpu(_) | Self::Cuda(_)) | (Hardware::Cpu | Hardware::OwnKernels, Self::Ndarray) => {
                let name = method.name();
                eprintln!("note: --method {name} is computed on the CPU, and --backend {self} changes nothing");
                Ok(Device::flex())
            }
            _ => self.device(),
        }
    }

    /// The device for what a method has trained. A second CPU backend is nothing to fields on grids: where it was
    /// asked for, that is said.
    ///
    /// # Errors
    /// As [`Backend::device`].
    pub fn device_for(self, method: &dyn Method) -> Result<Device> {
        if method.hardware() != Hardware::Tensors && self == Self::Ndarray {
            eprintln!(
                "note: what --method grid and hull make is no tensors on the CPU, and --backend {self} changes nothing"
            );
            return Ok(Device::flex());
        }
        self.device()
    }
}

impl fmt::Display for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => write!(f, "cpu"),
            Self::Gpu(index) => write!(f, "gpu:{index}"),
            Self::Cuda(index) => write!(f, "cuda:{index}"),
            Self::Ndarray => write!(f, "ndarray"),
        }
    }
}

impl FromStr for Backend {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, number) = text.split_once(':').map_or((text, None), |(name, number)| (name, Some(number)));
        let index = number.map_or(Ok(0), str::parse::<usize>);
        let index = index.map_err(|_| format!("after `{name}:` comes a number, counted from 0; see `dvr devices`"));
        match (name, number) {
            ("cpu", None) => Ok(Self::Cpu),
            ("gpu", _) => Ok(Self::Gpu(index?)),
            ("cuda", _) => Ok(Self::Cuda(index?)),
            ("ndarray", None) => Ok(Self::Ndarray),
            _ => Err("it is cpu, gpu, gpu:N, cuda, cuda:N or ndarray".into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_graphics_processor_is_chosen_by_its_number() {
        assert_eq!("gpu".parse(), Ok(Backend::Gpu(0)));
        assert_eq!("gpu:3".parse(), Ok(Backend::Gpu(3)));
        assert_eq!("cuda:1".parse(), Ok(Backend::Cuda(1)));
        assert_eq!(Backend::Gpu(3).to_string(), "gpu:3");
    }

    #[test]
    fn what_is_no_backend_is_refused_with_the_names_of_those_there_are() {
        for text in ["", "tpu", "cpu:1", "GPU", "ndarray:0"] {
            assert!(text.parse::<Backend>().is_err_and(|problem| problem.contains("gpu:N")), "{text}");
        }
        assert!("gpu:first".parse::<Backend>().is_err_and(|problem| problem.contains("dvr devices")));
    }

    #[test]
    #[cfg(not(feature = "cuda"))]
    fn a_backend_that_is_not_built_in_says_how_to_build_it() {
        let problem = Backend::Cuda(1).device().err().map(|e| e.to_string());
        assert!(problem.is_some_and(|problem| problem.contains("--features cuda")));
    }
}
