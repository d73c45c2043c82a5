//! The outlines of all masks as distances, and the hull that they have in common at the nodes of a grid.

use dvr_core::Cancellation;
use dvr_core::hull::{MaskDistance, hull_distances};
use dvr_core::voxel::VoxelGrid;
use glam::Vec3;
use rayon::prelude::*;

#[cfg(feature = "gpu")]
use super::gpu::GpuMasks;
use crate::accelerator::Accelerator;
use crate::error::{Error, Result};

/// Distances are known up to this, object units.
pub(super) const REACH: f32 = 0.1;

/// Points that a task measures.
const CHUNK: usize = 1 << 10;

/// The distances of the masks' outlines, in the order of views.
pub(crate) struct MaskDistances {
    masks: Vec<MaskDistance>,
    /// The same on a device.
    #[cfg(feature = "gpu")]
    on_gpu: Option<GpuMasks>,
}

/// Nodes of a grid.
#[derive(Clone, Copy)]
pub(super) enum Nodes<'a> {
    All,
    Some(&'a [usize]),
}

impl Nodes<'_> {
    /// How many they are.
    pub fn count(self, grid: &VoxelGrid) -> usize {
        match self {
            Self::All => grid.len(),
            Self::Some(nodes) => nodes.len(),
        }
    }

    /// One of them.
    pub fn at(self, index: usize) -> usize {
        match self {
            Self::All => index,
            Self::Some(nodes) => nodes[index],
        }
    }
}

impl MaskDistances {
    /// Brings masks to the accelerator, if it has room.
    ///
    /// # Errors
    /// When a GPU fails.
    pub fn new(masks: Vec<MaskDistance>, accelerator: &mut Accelerator) -> Result<Self> {
        let _ = accelerator;
        Ok(Self {
            #[cfg(feature = "gpu")]
            on_gpu: accelerator.run("the visual hull", |gpu| GpuMasks::new(gpu, &masks))?,
            masks,
        })
    }

    /// The masks.
    pub fn all(&self) -> &[MaskDistance] {
        &self.masks
    }

    /// Distances to the hull at nodes of a grid, positive inside; the `disagreeing` most pessimistic views are not believed. They are
    /// made where they are needed: a dense grid has too many to be kept.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] where somebody wants it to end, and when a GPU fails.
    pub(super) fn hull(
        &self,
        grid: &VoxelGrid,
        nodes: Nodes,
        disagreeing: usize,
        cancellation: &Cancellation,
    ) -> Result<Vec<f32>> {
        #[cfg(feature = "gpu")]
        if let Some(masks) = &self.on_gpu
            && let Some(found) = masks.hull(grid, nodes, disagreeing, cancellation)?
        {
            return Ok(found);
        }
        let mut distances = vec![0.0; nodes.count(grid)];
        distances.par_chunks_mut(CHUNK).enumerate().try_for_each(|(chunk, distances)| {
            cancellation.check()?;
            let points: Vec<Vec3> = (0..distances.len()).map(|i| grid.position(nodes.at(chunk * CHUNK + i))).collect();
            distances.copy_from_slice(&hull_distances(&self.masks, &points, REACH, disagreeing));
            Ok::<(), Error>(())
        })?;
        Ok(distances)
    }
}
