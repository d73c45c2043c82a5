//! What a run takes of main memory, estimated before it starts, and refused where there is less.

use dvr_core::{Scene, Split, View, available_memory};
use dvr_render::extract::ExtractSettings;

use crate::error::{Error, Result};
use crate::methods::method::Method;

/// Bytes that the program itself takes, with its threads and libraries: about 95 MB in the profile of tests, some less
/// in release.
const PROGRAM: u64 = 120_000_000;

/// What a run takes of main memory at most, about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostMemory {
    /// Bytes of photographs and masks that are in memory, and could lie in a scratch file.
    pub photographs: u64,
    /// Bytes of everything else.
    pub rest: u64,
}

impl HostMemory {
    /// Of a run of `method` on a scene, from its start to its mesh.
    pub fn of_run(method: &dyn Method, scene: &Scene, mesh: &ExtractSettings) -> Self {
        let train: Vec<&View> = scene.views_of(Split::Train).collect();
        // The mesh is made when training is over.
        let work = method.host_memory(&train).max(mesh.memory_estimate());
        Self { photographs: scene.photograph_bytes(), rest: PROGRAM + depth_bytes(scene) + work }
    }

    /// Both together.
    pub fn total(&self) -> u64 {
        self.photographs + self.rest
    }

    /// How many bytes of photographs may stay in memory, of `allowed` bytes for the process; of what the machine has, where
    /// nothing is said.
    ///
    /// # Errors
    /// [`Error::HostMemory`] where there is not enough for everything else.
    pub fn photographs_within(&self, allowed: Option<u64>) -> Result<u64> {
        // What is read already is not available any more.
        let machine = available_memory().map(|bytes| bytes.saturating_add(self.photographs + PROGRAM));
        let allowed = allowed.or(machine).unwrap_or(u64::MAX);
        let left = allowed.checked_sub(self.rest);
        left.ok_or(Error::HostMemory { bytes: self.rest, allowed })
    }
}

/// Refuses work that takes this many bytes beside the program, with `allowed` bytes for the process, or what the machine
/// has.
///
/// # Errors
/// [`Error::HostMemory`] where there are less.
pub fn check_host_memory(bytes: u64, allowed: Option<u64>) -> Result<()> {
    HostMemory { photographs: 0, rest: PROGRAM + bytes }.photographs_within(allowed).map(|_| ())
}

/// Bytes of depth maps, which always stay in memory.
fn depth_bytes(scene: &Scene) -> u64 {
    scene.views.iter().filter_map(|view| view.depth.as_ref()).map(|depth| 4 * depth.z_depth.len() as u64).sum()
}
