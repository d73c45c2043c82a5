//! The GPUs of this machine.

use std::fmt;
use std::sync::OnceLock;

use cubecl::future::block_on;
use cubecl::wgpu::wgpu::{Backend, DeviceType, Instance, InstanceDescriptor};
use cubecl::wgpu::{WgpuBackend, WgpuDevice, WgpuDeviceKind};

/// A GPU that can be opened, or a program that emulates one.
#[derive(Clone, Debug)]
pub struct Adapter {
    /// Its place among [`adapters`], counted from 0.
    pub index: usize,
    /// Its name, as the driver gives it.
    pub name: String,
    /// What it is.
    pub kind: AdapterKind,
    /// The interface through which it is reached: Vulkan, Metal or DirectX 12.
    pub api: &'static str,
    /// The driver's name and version; empty where it gives none.
    pub driver: String,
    /// The largest piece of memory that a kernel can be given, in bytes. A tensor cannot be larger.
    pub max_buffer_bytes: u64,
    /// Memory that the work-items of a group share, in bytes.
    pub shared_memory_bytes: u32,
    /// How cubecl calls it.
    pub(crate) selector: WgpuDevice,
}

/// What an adapter is. The order is that in which they are preferred.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AdapterKind {
    /// A card with memory of its own.
    Discrete,
    /// A part of the CPU's chip, with which it shares memory.
    Integrated,
    /// A part of a card that a virtual machine was given.
    Virtual,
    /// A GPU that does not say more.
    Other,
    /// A program on the CPU that emulates one (llvmpipe, SwiftShader, WARP): good for tests alone.
    Software,
}

impl fmt::Display for AdapterKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Other => "other",
            Self::Software => "software",
        })
    }
}

/// The interfaces to ask, best first. Each machine has one or two of them.
const APIS: [(Backend, WgpuBackend, &str); 3] = [
    (Backend::Vulkan, WgpuBackend::Vulkan, "Vulkan"),
    (Backend::Metal, WgpuBackend::Metal, "Metal"),
    (Backend::Dx12, WgpuBackend::Dx12, "DirectX 12"),
];

/// All adapters of this machine, the preferred ones first; none where there is no driver. They are looked for once per
/// process.
///
/// A card that is reached through two interfaces is listed once: those of the first interface that has a graphics
/// processor are taken, or if none has, the software adapters of the first interface that has any.
pub fn adapters() -> &'static [Adapter] {
    static ADAPTERS: OnceLock<Vec<Adapter>> = OnceLock::new();
    ADAPTERS.get_or_init(|| {
        let mut software_only = Vec::new();
        for (backend, selector, api) in APIS {
            let found = adapters_of(backend, selector, api);
            if found.iter().any(|adapter| adapter.kind != AdapterKind::Software) {
                return found;
            }
            if software_only.is_empty() {
                software_only = found;
            }
        }
        software_only
    })
}

/// The adapters of one interface, the preferred ones first.
fn adapters_of(backend: Backend, selector: WgpuBackend, api: &'static str) -> Vec<Adapter> {
    let instance = Instance::new(InstanceDescriptor {
        backends: backend.into(),
        ..InstanceDescriptor::new_without_display_handle()
    });
    let mut counts = [0; 5];
    let mut adapters: Vec<Adapter> = block_on(instance.enumerate_adapters(backend.into()))
        .into_iter()
        .map(|adapter| {
            let (info, limits) = (adapter.get_info(), adapter.limits());
            let kind = match info.device_type {
                DeviceType::DiscreteGpu => AdapterKind::Discrete,
                DeviceType::IntegratedGpu => AdapterKind::Integrated,
                DeviceType::VirtualGpu => AdapterKind::Virtual,
                DeviceType::Other => AdapterKind::Other,
                DeviceType::Cpu => AdapterKind::Software,
            };
            let of_its_kind = counts[kind as usize];
            counts[kind as usize] += 1;
            let kind_selector = match kind {
                AdapterKind::Discrete => WgpuDeviceKind::DiscreteGpu(of_its_kind),
                AdapterKind::Integrated => WgpuDeviceKind::IntegratedGpu(of_its_kind),
                AdapterKind::Virtual => WgpuDeviceKind::VirtualGpu(of_its_kind),
                AdapterKind::Other => WgpuDeviceKind::Other(of_its_kind),
                AdapterKind::Software => WgpuDeviceKind::Cpu,
            };
            Adapter {
                index: 0,
                name: info.name,
                kind,
                api,
                driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
                max_buffer_bytes: limits.max_buffer_size.min(limits.max_storage_buffer_binding_size),
                shared_memory_bytes: limits.max_compute_workgroup_storage_size,
                selector: WgpuDevice::new(kind_selector).on(selector),
            }
        })
        .collect();
    adapters.sort_by_key(|adapter| adapter.kind);
    // cubecl knows one software adapter an interface, the first.
    let mut seen_software = false;
    adapters.retain(|adapter| adapter.kind != AdapterKind::Software || !std::mem::replace(&mut seen_software, true));
    for (index, adapter) in adapters.iter_mut().enumerate() {
        adapter.index = index;
    }
    adapters
}
