//! A GPU that takes over what it has room for.

use burn::tensor::Device;

/// Where work may run beside the CPU.
#[derive(Default)]
pub(crate) struct Accelerator<'a> {
    device: Option<&'a Device>,
    /// What stayed on the CPU, and why.
    pub notes: Vec<String>,
}

impl<'a> Accelerator<'a> {
    /// A device, as far as it is a GPU. A program that emulates one is slower than the CPU, and is left out.
    pub fn new(device: Option<&'a Device>) -> Self {
        #[cfg(feature = "gpu")]
        let device = device.filter(|device| dvr_render::is_gpu(device) && !dvr_gpu::is_software(device));
        Self { device, notes: Vec::new() }
    }

    /// A GPU, even one that a program emulates, for tests.
    #[cfg(all(test, feature = "gpu"))]
    pub fn emulated(device: &'a Device) -> Self {
        Self { device: Some(device), notes: Vec::new() }
    }

    /// The GPU.
    pub fn gpu(&self) -> Option<&'a Device> {
        self.device
    }

    /// Does some work on the GPU; `None` where there is none, and where it has no room for it, which is noted.
    ///
    /// # Errors
    /// Those of the work, but for too little room.
    #[cfg(feature = "gpu")]
    pub fn run<T>(
        &mut self,
        what: &str,
        work: impl FnOnce(&Device) -> crate::error::Result<T>,
    ) -> crate::error::Result<Option<T>> {
        use crate::error::Error;
        use dvr_gpu::DeviceError::{OverLimit, TooLarge};
        let Some(device) = self.device else { return Ok(None) };
        match work(device) {
            Err(Error::Device(why @ (OverLimit { .. } | TooLarge { .. }))) => {
                self.notes.push(format!("{what} runs on the CPU: {why}"));
                Ok(None)
            }
            done => done.map(Some),
        }
    }
}

#[cfg(all(test, feature = "gpu"))]
mod tests {
    use dvr_gpu::DeviceError;
    use dvr_test_support::test_with;

    use super::*;
    use crate::error::Error;

    #[test_with(gpu)]
    fn work_without_room_is_left_to_the_cpu_and_other_errors_are_not_hidden() {
        let gpu = dvr_test_support::gpu(dvr_gpu::open(0)).device;
        let mut accelerator = Accelerator::emulated(&gpu);
        assert_eq!(accelerator.run("stereo", |_| Ok(3)).unwrap(), Some(3));
        let too_large = || Error::Device(DeviceError::TooLarge { what: "a volume", mebibytes: 9, most: 8 });
        assert_eq!(accelerator.run("stereo", |_| Err::<i32, _>(too_large())).unwrap(), None);
        assert_eq!(
            accelerator.notes,
            ["stereo runs on the CPU: a volume would take 9 MiB in one piece, and this GPU has at most 8"]
        );
        let broken = || Error::Device(DeviceError::Device("lost".into()));
        assert!(accelerator.run("stereo", |_| Err::<i32, _>(broken())).is_err());
    }

    #[test_with(gpu)]
    fn neither_the_cpu_nor_a_program_that_emulates_a_gpu_is_asked() {
        let gpu = dvr_test_support::gpu(dvr_gpu::open(0));
        let is_software = gpu.adapter.kind == dvr_gpu::AdapterKind::Software;
        let emulated = Some(&gpu.device).filter(|_| is_software);
        for device in [None, Some(&Device::flex()), emulated] {
            let mut accelerator = Accelerator::new(device);
            assert!(accelerator.run("stereo", |_| -> crate::error::Result<()> { panic!("asked") }).unwrap().is_none());
            assert!(accelerator.notes.is_empty());
        }
    }
}
