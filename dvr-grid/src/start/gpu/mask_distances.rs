//! Distances to the visual hull, as a kernel: the counterpart of [`super::super::mask_distances`] and of
//! `dvr_core::hull::hull_distances`.

#![allow(missing_docs)]

use burn::tensor::{Device, IntDType};
use cubecl::prelude::*;
use dvr_core::Cancellation;
use dvr_core::hull::{MAX_DISAGREEING, MaskDistance};
use dvr_core::voxel::VoxelGrid;
use dvr_gpu::{Buffer, Buffers, DeviceError};

use super::super::mask_distances::{Nodes, REACH};
use crate::error::Result;
use crate::gpu::launch::{groups, units};
use crate::gpu::voxel::{Point, grid, held, lerp};

/// Numbers of a mask in the table: the columns of `K R`, `K t`, and from cells to object units.
const NUMBERS: usize = 13;

/// Words of a mask: columns, rows, and where its cells begin.
const WORDS: usize = 3;

/// Nodes that are measured at once.
const AT_ONCE: usize = 1 << 20;

/// Farther than any outline.
const FAR: f32 = 1.0e30;

/// Masks on a device.
pub(in super::super) struct GpuMasks {
    buffers: Buffers,
    numbers: Buffer,
    words: Buffer,
    cells: Buffer,
    count: usize,
}

impl GpuMasks {
    /// Brings masks to a device.
    ///
    /// # Errors
    /// When it is no GPU, or they are too large for it.
    pub fn new(device: &Device, masks: &[MaskDistance]) -> Result<Self> {
        let buffers = Buffers::on(device)?;
        let (mut numbers, mut words, mut cells) = (Vec::new(), Vec::new(), Vec::new());
        for mask in masks {
            let (projection, offset) = mask.projection();
            numbers.extend(projection.to_cols_array().into_iter().chain(offset.to_array()).chain([mask.scale()]));
            let ([width, height], distances) = mask.cells();
            words.extend([width, height, cells.len()].map(|word| word as u32));
            cells.extend_from_slice(distances);
        }
        Ok(Self {
            numbers: buffers.floats("the masks", numbers)?,
            words: buffers.words("the masks", words)?,
            cells: buffers.floats("the masks", cells)?,
            count: masks.len(),
            buffers,
        })
    }

    /// Distances to the hull at nodes of a grid; `None` where there is no room for them.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] where somebody wants it to end, and when the device fails.
    pub fn hull(
        &self,
        grid: &VoxelGrid,
        nodes: Nodes,
        disagreeing: usize,
        cancellation: &Cancellation,
    ) -> Result<Option<Vec<f32>>> {
        let count = nodes.count(grid);
        let mut found = Vec::with_capacity(count);
        while found.len() < count {
            cancellation.check()?;
            let some = found.len()..count.min(found.len() + AT_ONCE);
            match self.some_of_hull(grid, nodes, some, disagreeing) {
                Ok(more) => found.extend(more),
                Err(DeviceError::OverLimit { .. } | DeviceError::TooLarge { .. }) => return Ok(None),
                Err(failed) => return Err(failed.into()),
            }
        }
        Ok(Some(found))
    }

    fn some_of_hull(
        &self,
        grid: &VoxelGrid,
        nodes: Nodes,
        some: std::ops::Range<usize>,
        disagreeing: usize,
    ) -> std::result::Result<impl Iterator<Item = f32>, DeviceError> {
        let (buffers, count) = (&self.buffers, some.len());
        let distances = buffers.zeros("distances to the hull", count, IntDType::U32)?;
        let (first, listed) = match nodes {
            Nodes::All => (some.start as u32, Vec::new()),
            Nodes::Some(nodes) => (0, nodes[some].iter().map(|&node| node as u32).collect()),
        };
        hull::launch(
            &buffers.client,
            groups(&buffers.client, count),
            units(),
            self.numbers.clone().into_buffer_arg(),
            self.words.clone().into_buffer_arg(),
            self.cells.clone().into_buffer_arg(),
            buffers.words("nodes", listed)?.into_buffer_arg(),
            distances.clone().into_buffer_arg(),
            grid.nodes() as u32,
            grid.half_extent(),
            first,
            count as u32,
            self.count as u32,
            matches!(nodes, Nodes::Some(_)),
            disagreeing.min(MAX_DISAGREEING),
        );
        Ok(buffers.read(&[&distances])?.remove(0).into_iter().take(count).map(f32::from_bits))
    }
}

/// Bilinear between cell centres, constant beyond the outermost.
#[cube]
fn sample(cells: &[f32], first: u32, width: u32, height: u32, x: f32, y: f32) -> f32 {
    let (x, y) = (held(x, f32::cast_from(width - 1u32)), held(y, f32::cast_from(height - 1u32)));
    let (left, top) = (u32::cast_from(x), u32::cast_from(y));
    let (right, below) = (min(left + 1u32, width - 1u32), min(top + 1u32, height - 1u32));
    let (s, t) = (x - f32::cast_from(left), y - f32::cast_from(top));
    let a = cells[(first + top * width + left) as usize];
    let b = cells[(first + top * width + right) as usize];
    let c = cells[(first + below * width + left) as usize];
    let d = cells[(first + below * width + right) as usize];
    lerp(lerp(a, b, s), lerp(c, d, s), t)
}

/// Distances at `count` nodes as the words of their floats: those that are listed, or those from `first` on. The `rank` most
/// pessimistic views are not believed.
#[cube(launch)]
fn hull(
    numbers: &[f32],
    words: &[u32],
    cells: &[f32],
    listed: &[u32],
    distances: &mut [u32],
    nodes: u32,
    half_extent: f32,
    first: u32,
    count: u32,
    masks: u32,
    #[comptime] is_listed: bool,
    #[comptime] rank: usize,
) {
    let index = ABSOLUTE_POS as u32;
    if index < count {
        let mut node = first + index;
        if comptime!(is_listed) {
            node = listed[index as usize];
        }
        let grid = grid(nodes, half_extent);
        let (x, y, z) = (node % nodes, node / nodes % nodes, node / (nodes * nodes));
        let at = Point::new(
            f32::cast_from(x) * grid.spacing - half_extent,
            f32::cast_from(y) * grid.spacing - half_extent,
            f32::cast_from(z) * grid.spacing - half_extent,
        );
        // The least distances, rising, and how many views know the point.
        let mut least = Array::<f32>::new(comptime!(rank + 1));
        #[unroll]
        for i in 0..comptime!(rank + 1) {
            least[i] = f32::new(FAR);
        }
        let mut known = 0u32;
        let mut mask = 0u32;
        while mask < masks && least[rank] > -REACH {
            let of_mask = mask as usize * NUMBERS;
            let q = Point::read(numbers, of_mask)
                .times(at.x)
                .plus(&Point::read(numbers, of_mask + 3).times(at.y))
                .plus(&Point::read(numbers, of_mask + 6).times(at.z))
                .plus(&Point::read(numbers, of_mask + 9));
            let sizes = mask as usize * WORDS;
            let (width, height) = (words[sizes], words[sizes + 1]);
            let (u, v) = (q.x / q.z, q.y / q.z);
            let is_seen =
                q.z > 0.0f32 && u >= 0.0f32 && v >= 0.0f32 && u < f32::cast_from(width) && v < f32::cast_from(height);
            if is_seen {
                let found = sample(cells, words[sizes + 2], width, height, u - 0.5f32, v - 0.5f32);
                let mut value = found * numbers[of_mask + 12] * q.z;
                known += 1u32;
                #[unroll]
                for i in 0..comptime!(rank + 1) {
                    let lesser = least[i].min(value);
                    value = least[i].max(value);
                    least[i] = lesser;
                }
            }
            mask += 1u32;
        }
        let mut distance = -f32::new(REACH);
        if known > comptime!(rank as u32) {
            distance = least[rank].clamp(-f32::new(REACH), f32::new(REACH));
        }
        distances[index as usize] = u32::reinterpret(distance);
    }
}

#[cfg(test)]
mod tests {
    use dvr_test_support::test_with;

    use super::*;
    use crate::accelerator::Accelerator;
    use crate::start::mask_distances::MaskDistances;
    use crate::step::suite::speckled_arc;

    #[test_with(gpu)]
    fn distances_are_those_of_the_cpu_but_for_rounding() {
        let gpu = dvr_test_support::gpu(dvr_gpu::open(0)).device;
        let masks: Vec<MaskDistance> = (speckled_arc(8).iter().filter_map(|view| view.training_pair()))
            .map(|(camera, mask)| MaskDistance::new(camera, mask))
            .collect();
        let [on_gpu, on_cpu] = [Accelerator::emulated(&gpu), Accelerator::default()]
            .map(|mut accelerator| MaskDistances::new(masks.clone(), &mut accelerator).unwrap());
        let grid = VoxelGrid::new(41, 0.55);
        let some: Vec<usize> = (0..grid.len()).filter(|node| node % 7 == 3).collect();
        let cancellation = Cancellation::default();
        for disagreeing in [0, 3, 40] {
            for nodes in [Nodes::All, Nodes::Some(&some), Nodes::Some(&[])] {
                let [found, expected] =
                    [&on_gpu, &on_cpu].map(|masks| masks.hull(&grid, nodes, disagreeing, &cancellation).unwrap());
                assert_eq!(found.len(), nodes.count(&grid));
                assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-5), "{disagreeing}");
                let inside = expected.iter().filter(|&&distance| distance > 0.0).count();
                assert!(inside > 100 || disagreeing == 40 || found.is_empty(), "{inside} nodes inside");
            }
        }
        cancellation.cancel();
        assert!(on_gpu.hull(&grid, Nodes::All, 0, &cancellation).is_err());
    }
}
