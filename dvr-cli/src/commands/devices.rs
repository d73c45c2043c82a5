//! `dvr devices`: where `--backend` can compute.

use std::process::ExitCode;

use anyhow::Result;

/// Lists the processors that `--backend` can choose, each on a line.
pub fn run() -> Result<ExitCode> {
    println!("cpu     this machine's processor, {} threads", rayon::current_num_threads());
    #[cfg(feature = "gpu")]
    {
        for adapter in dvr_gpu::adapters() {
            println!("{}", crate::gpu::describe(adapter));
        }
        if dvr_gpu::adapters().is_empty() {
            eprintln!(
                "note: no Vulkan, Metal or DirectX 12 driver offers a graphics processor. On Linux the loader (libvulkan1) and the \
                 card's Vulkan driver are needed; mesa-vulkan-drivers has those of AMD, Intel and a software adapter"
            );
        }
    }
    #[cfg(feature = "cuda")]
    (0..dvr_gpu::cuda_devices()).for_each(|index| println!("cuda:{index}  an NVIDIA card through CUDA"));
    #[cfg(not(feature = "gpu"))]
    eprintln!("note: this dvr was built without the feature `gpu`");
    Ok(ExitCode::SUCCESS)
}
