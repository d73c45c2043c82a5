//! GPUs: which there are, how to open one, and the hot loops of volumetric rendering as CubeCL kernels.
//!
//! Kernels are written once, and compiled when they are first needed for whatever the device speaks: Vulkan, Metal or
//! DirectX 12 through wgpu, or CUDA (feature `cuda`). They take and return burn tensors that stay on the device.
//!
//! ```
//! use burn::tensor::Tensor;
//!
//! for adapter in dvr_gpu::adapters() {
//!     println!("gpu:{} {} ({}, {})", adapter.index, adapter.name, adapter.kind, adapter.api);
//! }
//! match dvr_gpu::open(0) {
//!     Ok(gpu) => {
//!         let sum = Tensor::<1>::from_floats([1.0, 2.0], &gpu.device).sum().into_scalar::<f32>();
//!         assert_eq!(sum, 3.0);
//!     }
//!     Err(problem) => println!("{problem}"),
//! }
//! ```

#![warn(missing_docs)]

mod adapter;
mod buffer;
mod march;
mod memory;
mod open;

pub use adapter::{Adapter, AdapterKind, adapters};
pub use buffer::{Buffer, Buffers, DeviceError};
pub use march::{MarchOp, MarchPlan, PackedDecoder, RaySearch, Root, march_decoder};
pub use memory::{CubeDevice, MemoryExcess, limit_memory, memory_excess, memory_held, points_at_once, rows_at_once};
pub use open::{Gpu, GpuError, is_gpu, is_software, open};
#[cfg(feature = "cuda")]
pub use open::{cuda_devices, open_cuda};
