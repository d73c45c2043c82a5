//! What a run takes of main memory, estimated before it starts, and refused where there is less.

use dvr_core::{Scene, Split, View, available_memory};
use dvr_texture::{TextureError, TextureSettings, TextureSize};

use crate::error::{Error, Result};
use crate::export::mesh::MeshOptions;
use crate::methods::method::Method;

/// Bytes that the program itself takes, with its threads and libraries: about 95 MB in the profile of tests, some less
/// in release. While other tests ran beside it, the peak of the same run was up to 18 MB higher.
const PROGRAM: u64 = 140_000_000;

/// Bytes of a face of a mesh that gets a texture, as an extraction counts them: as it is read, in charts, and as it is
/// written.
const FACE: u64 = 300;

/// What a run takes of main memory at most, about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostMemory {
    /// Bytes of photographs and masks that are in memory, and could lie in a scratch file.
    pub photographs: u64,
    /// Bytes of everything else but the texture.
    pub rest: u64,
    /// Bytes of the texture, which is made last.
    pub texture: u64,
    /// Bytes of the rest that are in use while it is made: the program, depth maps and the mesh.
    beside_texture: u64,
    /// The texture's size, where it was asked for.
    texture_size: Option<u32>,
}

/// What photographs and texture may take of memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryShares {
    /// Bytes of photographs and masks that may stay in memory.
    pub photographs: u64,
    /// Bytes that the texture may take: see [`TextureSettings::max_bytes`].
    pub texture: u64,
}

impl HostMemory {
    /// Of a run of `method` on a scene, from its start to its mesh and texture.
    pub fn of_run(method: &dyn Method, scene: &Scene, mesh: &MeshOptions) -> Self {
        let train: Vec<&View> = scene.views_of(Split::Train).collect();
        let of_mesh = Self::of_mesh(scene, &mesh.clone().following(method.most_cells()));
        // The mesh is made when training is over.
        let training = PROGRAM + depth_bytes(scene) + method.host_memory(&train);
        Self { rest: of_mesh.rest.max(training), ..of_mesh }
    }

    /// Of a mesh with its texture, from a field and the scene that it was trained on.
    pub fn of_mesh(scene: &Scene, mesh: &MeshOptions) -> Self {
        let train: Vec<&View> = scene.views_of(Split::Train).collect();
        let texture = mesh.texture_from(&train);
        Self::new(scene, mesh.extraction.memory_estimate(), texture.as_ref(), &train)
    }

    /// Of a texture from these views of a scene, for a mesh with so many faces.
    pub fn of_texture(scene: &Scene, views: &[&View], faces: usize, texture: &TextureSettings) -> Self {
        Self::new(scene, FACE * faces as u64, Some(texture), views)
    }

    /// Of work on the photographs of a scene that takes this many bytes beside them.
    pub fn of_work(scene: &Scene, bytes: u64) -> Self {
        Self::new(scene, bytes, None, &[])
    }

    fn new(scene: &Scene, mesh: u64, texture: Option<&TextureSettings>, views: &[&View]) -> Self {
        let rest = PROGRAM + depth_bytes(scene) + mesh;
        Self {
            photographs: scene.photograph_bytes(),
            rest,
            texture: texture.map_or(0, |texture| texture.memory_estimate(views)),
            beside_texture: rest,
            texture_size: texture.and_then(|texture| match texture.size {
                TextureSize::Texels(size) => Some(size),
                TextureSize::Auto => None,
            }),
        }
    }

    /// All together.
    pub fn total(&self) -> u64 {
        self.photographs + self.rest.max(self.beside_texture + self.texture)
    }

    /// What photographs and texture may take of `allowed` bytes for the process; of what the machine has, where nothing is
    /// said. Photographs leave memory before a texture of automatic size gets smaller.
    ///
    /// # Errors
    /// [`Error::HostMemory`] where there is not enough for everything else, [`Error::Texture`] where there is not for a
    /// texture of the size that was asked for.
    pub fn within(&self, allowed: Option<u64>) -> Result<MemoryShares> {
        // What is read already is not available any more.
        let machine = available_memory().map(|bytes| bytes.saturating_add(self.photographs + PROGRAM));
        let allowed = allowed.or(machine).unwrap_or(u64::MAX);
        if self.rest > allowed {
            return Err(Error::HostMemory { bytes: self.rest, allowed });
        }
        let most = self.rest.max(self.beside_texture + self.texture);
        let photographs = self.photographs.min(allowed.saturating_sub(most));
        let texture = allowed - photographs - self.beside_texture;
        match self.texture_size {
            Some(size) if self.texture > texture => {
                Err(Error::Texture(TextureError::Memory { size, needed: self.texture, allowed: texture }))
            }
            _ => Ok(MemoryShares { photographs, texture }),
        }
    }

    /// The same where photographs and texture take no more than their shares.
    pub fn bounded(self, shares: MemoryShares) -> Self {
        let (photographs, texture) = (self.photographs.min(shares.photographs), self.texture.min(shares.texture));
        Self { photographs, texture, ..self }
    }
}

/// Refuses work that takes this many bytes beside the program, with `allowed` bytes for the process, or what the machine
/// has.
///
/// # Errors
/// [`Error::HostMemory`] where there are less.
pub fn check_host_memory(bytes: u64, allowed: Option<u64>) -> Result<()> {
    let rest = PROGRAM + bytes;
    let needed = HostMemory { photographs: 0, rest, texture: 0, beside_texture: rest, texture_size: None };
    needed.within(allowed).map(|_| ())
}

/// Bytes of depth maps, which always stay in memory.
fn depth_bytes(scene: &Scene) -> u64 {
    scene.views.iter().filter_map(|view| view.depth.as_ref()).map(|depth| 4 * depth.z_depth.len() as u64).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RUN: HostMemory =
        HostMemory { photographs: 400, rest: 1000, texture: 900, beside_texture: 300, texture_size: None };

    fn shares(photographs: u64, texture: u64) -> MemoryShares {
        MemoryShares { photographs, texture }
    }

    #[test]
    fn photographs_leave_memory_before_an_automatic_texture_gets_smaller() {
        assert_eq!(RUN.total(), 1600);
        assert_eq!(RUN.within(Some(1600)).unwrap(), shares(400, 900));
        assert_eq!(RUN.within(Some(5000)).unwrap(), shares(400, 4300));
        assert_eq!(RUN.within(Some(1300)).unwrap(), shares(100, 900));
        assert_eq!(RUN.within(Some(1200)).unwrap(), shares(0, 900));
        let scarce = RUN.within(Some(1000)).unwrap();
        assert_eq!(scarce, shares(0, 700));
        assert_eq!(RUN.bounded(scarce).total(), 1000);
        assert!(matches!(RUN.within(Some(999)), Err(Error::HostMemory { bytes: 1000, allowed: 999 })));
    }

    #[test]
    fn a_texture_of_a_size_that_does_not_fit_is_refused() {
        let asked = HostMemory { texture_size: Some(4096), ..RUN };
        assert_eq!(asked.within(Some(1200)).unwrap(), shares(0, 900));
        let Err(Error::Texture(TextureError::Memory { size, needed, allowed })) = asked.within(Some(1199)) else {
            panic!("it fits");
        };
        assert_eq!((size, needed, allowed), (4096, 900, 899));
    }
}
