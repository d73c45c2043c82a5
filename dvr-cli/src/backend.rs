//! `--backend` and `--devices`: where a command computes.

use std::fmt;
use std::str::FromStr;

use anyhow::{Result, bail};
use burn::tensor::Device;
use dvr_train::Method;

/// A backend with its device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// burn-flex: the CPU, all cores.
    Cpu,
    /// A GPU, by its number in `dvr devices`.
    Gpu(usize),
    /// An NVIDIA GPU through CUDA, by its number there.
    Cuda(usize),
}

/// For `--help`.
pub const HELP: &str = "Where to compute: cpu; gpu or gpu:N (Vulkan, Metal, DirectX 12; `dvr devices` lists them); where built in, \
    also cuda or cuda:N";

impl Backend {
    /// The device, without autodiff.
    ///
    /// # Errors
    /// When this program was built without the backend, or the device does not exist or cannot be opened.
    pub fn device(self) -> Result<Device> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            #[cfg(feature = "gpu")]
            Self::Gpu(index) => crate::gpu::open(index),
            #[cfg(feature = "cuda")]
            Self::Cuda(index) => crate::gpu::open_cuda(index),
            #[allow(unreachable_patterns)]
            _ => {
                let feature = self.to_string();
                let feature = feature.split(':').next().unwrap_or_default();
                bail!(
                    "this dvr was built without --backend {feature}: build it with `cargo build --features {feature}`"
                )
            }
        }
    }

    /// The device on which a method trains. The visual hull has no steps to train: a note says so where a GPU
    /// was asked for.
    ///
    /// # Errors
    /// As [`Backend::device`].
    pub fn training_device(self, method: &dyn Method) -> Result<Device> {
        if self != Self::Cpu && !method.trains_on_gpu() {
            let name = method.name();
            eprintln!("note: --method {name} is computed on the CPU; --backend {self} has no effect");
            return Ok(Device::flex());
        }
        self.device()
    }
}

impl Backend {
    /// What computes, with the name of the GPU: for keys of results.
    pub fn described(self) -> String {
        #[cfg(feature = "gpu")]
        if let Self::Gpu(index) = self
            && let Some(adapter) = dvr_gpu::adapters().get(index)
        {
            return format!("{self}, {} ({})", adapter.name, adapter.api);
        }
        self.to_string()
    }
}

impl fmt::Display for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => write!(f, "cpu"),
            Self::Gpu(index) => write!(f, "gpu:{index}"),
            Self::Cuda(index) => write!(f, "cuda:{index}"),
        }
    }
}

impl FromStr for Backend {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, number) = text.split_once(':').map_or((text, None), |(name, number)| (name, Some(number)));
        let index = number.map_or(Ok(0), str::parse::<usize>);
        let index =
            index.map_err(|_| format!("after `{name}:` a number is expected, counted from 0; see `dvr devices`"));
        match (name, number) {
            ("cpu", None) => Ok(Self::Cpu),
            ("gpu", _) => Ok(Self::Gpu(index?)),
            ("cuda", _) => Ok(Self::Cuda(index?)),
            _ => Err("expected cpu, gpu, gpu:N, cuda or cuda:N".into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gpu_is_chosen_by_its_number() {
        assert_eq!("gpu".parse(), Ok(Backend::Gpu(0)));
        assert_eq!("gpu:3".parse(), Ok(Backend::Gpu(3)));
        assert_eq!("cuda:1".parse(), Ok(Backend::Cuda(1)));
        assert_eq!(Backend::Gpu(3).to_string(), "gpu:3");
    }

    #[test]
    fn an_unknown_backend_is_refused_with_the_names_of_all() {
        for text in ["", "tpu", "cpu:1", "GPU", "cuda0"] {
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
