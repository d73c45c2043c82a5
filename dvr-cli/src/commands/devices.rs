//! `dvr devices`: the devices of `--backend` and `--devices`.

use std::process::ExitCode;

use anyhow::Result;

/// Lists the devices, one per line.
pub fn run() -> Result<ExitCode> {
    println!("cpu     {} threads", rayon::current_num_threads());
    #[cfg(feature = "gpu")]
    {
        for adapter in dvr_gpu::adapters() {
            println!("{}", crate::gpu::describe(adapter));
        }
        if dvr_gpu::adapters().is_empty() {
            eprintln!(
                "note: no GPU was found: no Vulkan, Metal or DirectX 12 driver has one. On Linux, install the Vulkan loader (libvulkan1) \
                 and the GPU's driver; mesa-vulkan-drivers has drivers for AMD, Intel and a software adapter"
            );
        }
    }
    #[cfg(feature = "cuda")]
    (0..dvr_gpu::cuda_devices()).for_each(|index| println!("cuda:{index}  an NVIDIA GPU through CUDA"));
    #[cfg(not(feature = "gpu"))]
    eprintln!("note: this dvr was built without the feature `gpu`");
    Ok(ExitCode::SUCCESS)
}
