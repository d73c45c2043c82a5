//! The depths of all views, by the kernels.

use burn::tensor::Device;
use cubecl::prelude::*;
use dvr_core::Cancellation;
use dvr_gpu::{Buffer, Buffers};
use rayon::prelude::*;

use super::super::cost_volume::VolumeLayout;
use super::super::depth_map::DepthMap;
use super::super::hull::Hull;
use super::super::picture::Picture;
use super::super::semi_global::DIRECTIONS;
use super::ranges::{self, DEPTHS};
use super::semi_global::{self, FOUND, paths};
use super::sweep::{self, DepthsLaunch, TILE_UNITS, carried, tiles};
use crate::error::Result;
use crate::gpu::launch::{UNITS, groups, units};
use crate::gpu::occupancy;
use crate::gpu::traversal::RegionLaunch;
use crate::gpu::views::{ViewRecord, table};

/// The depths of every view, each matched with these others. Views follow each other on the device; it is waited for where the hull is
/// known, and at the end.
///
/// # Errors
/// When the device is no GPU, has no room, or fails; [`crate::Error::Cancelled`] where somebody wants it to end.
pub(in super::super) fn depth_maps(
    device: &Device,
    pictures: &[Picture],
    neighbours: &[Vec<usize>],
    hull: &Hull,
    cancellation: &Cancellation,
) -> Result<Vec<DepthMap>> {
    let photographs = Photographs::new(Buffers::on(device)?, pictures)?;
    let depths = photographs.ranges(pictures, hull)?;
    let layouts: Vec<Option<VolumeLayout>> = (0..pictures.len())
        .into_par_iter()
        .map(|view| VolumeLayout::new(pictures, view, &neighbours[view], &depths[view]))
        .collect();
    let mut found = Vec::new();
    for (view, layout) in layouts.iter().enumerate() {
        cancellation.check()?;
        if let Some(layout) = layout {
            found.push(photographs.matched(pictures, view, layout, &neighbours[view])?);
        }
    }
    let mut found = photographs.buffers.read(&found.iter().collect::<Vec<_>>())?.into_iter();
    let map = |(view, layout): (usize, &Option<VolumeLayout>)| {
        let picture = &pictures[view];
        let mut map = DepthMap::unknown(picture.width * picture.height);
        let Some(layout) = layout else { return map };
        let found = found.next().unwrap_or_default();
        for (pixel, &[depth, confidence]) in found.as_chunks::<FOUND>().0.iter().enumerate() {
            let [depth, confidence] = [depth, confidence].map(f32::from_bits);
            if depth > 0.0 {
                let at = layout.part.pixel(pixel, picture);
                (map.z_depth[at], map.confidence[at], map.hull[at]) = (depth, confidence, depths[view][at][0]);
            }
        }
        map
    };
    Ok(layouts.iter().enumerate().map(map).collect())
}

/// Photographs on a device.
struct Photographs {
    buffers: Buffers,
    views: Buffer,
    /// Brightness of all, below zero off the object.
    grey: Buffer,
}

impl Photographs {
    fn new(buffers: Buffers, pictures: &[Picture]) -> Result<Self> {
        let record = |picture: &Picture| {
            ViewRecord::of_camera(&picture.camera, [picture.width, picture.height].map(|side| side as u32))
        };
        let grey = pictures.iter().flat_map(|picture| &picture.grey);
        let grey = grey.map(|grey| if grey.is_nan() { -1.0 } else { *grey }).collect();
        Ok(Self {
            views: table(&buffers, pictures.iter().map(record).collect())?,
            grey: buffers.floats("photographs in grey", grey)?,
            buffers,
        })
    }

    /// The z-depths at which the rays of each picture's pixels enter and leave the hull.
    fn ranges(&self, pictures: &[Picture], hull: &Hull) -> Result<Vec<Vec<[f32; DEPTHS]>>> {
        let (buffers, client) = (&self.buffers, &self.buffers.client);
        let grid = hull.bitmask.grid();
        let nodes = grid.nodes();
        let values = buffers.floats("the hull", hull.values.to_vec())?;
        let inside = occupancy::signs_of(buffers, &values, nodes)?;
        let marks = occupancy::marks_of(buffers, nodes)?;
        occupancy::update(buffers, &inside, &marks, nodes);
        let pixels = pictures.iter().map(|picture| picture.grey.len());
        let found = buffers.zero_floats("depths of the hull", DEPTHS * pixels.clone().sum::<usize>())?;
        for (view, count) in pixels.clone().enumerate() {
            ranges::ranges::launch(
                client,
                groups(client, count),
                units(),
                self.views.clone().into_buffer_arg(),
                self.grey.clone().into_buffer_arg(),
                values.clone().into_buffer_arg(),
                marks.clone().into_buffer_arg(),
                found.clone().into_buffer_arg(),
                RegionLaunch::of(nodes as u32, grid.half_extent(), [[0; 3], [grid.cells() as u32; 3]]),
                view as u32,
                count as u32,
            );
        }
        let words = buffers.read(&[&found])?.remove(0);
        let mut words = words.as_chunks::<DEPTHS>().0;
        let of_picture = |count: usize| {
            let (first, rest) = words.split_at(count);
            words = rest;
            first.iter().map(|depths| depths.map(f32::from_bits)).collect()
        };
        Ok(pixels.map(of_picture).collect())
    }

    /// The depth of each pixel of a view's part and how sure it is, as the device will know them.
    fn matched(
        &self,
        pictures: &[Picture],
        view: usize,
        layout: &VolumeLayout,
        neighbours: &[usize],
    ) -> Result<Buffer> {
        let (buffers, client) = (&self.buffers, &self.buffers.client);
        let pixels = layout.pixels();
        let of_pixel = (0..pixels).flat_map(|pixel| {
            let planes = layout.planes_of(pixel).0;
            [planes.start as u32, planes.end as u32]
        });
        let ranges = buffers.words("ranges of depths", of_pixel.collect())?;
        let starts = buffers.words("ranges of depths", layout.starts.iter().map(|&start| start as u32).collect())?;
        let costs = buffers.zero_floats("costs of a view's depths", layout.len())?;
        let sums = buffers.zero_floats("costs of a view's depths", layout.len())?;
        let carried = neighbours.iter().map(|&other| carried(&pictures[view].camera, &pictures[other].camera));
        let tiles = tiles(layout);
        let count = tiles.len() / 3;
        sweep::match_tiles::launch(
            client,
            groups_of(client, count, TILE_UNITS),
            CubeDim::new_1d(TILE_UNITS as u32),
            buffers.words("tiles of a view", tiles)?.into_buffer_arg(),
            self.views.clone().into_buffer_arg(),
            self.grey.clone().into_buffer_arg(),
            buffers.words("neighbours", neighbours.iter().map(|&other| other as u32).collect())?.into_buffer_arg(),
            buffers.floats("neighbours", carried.flatten().collect())?.into_buffer_arg(),
            ranges.clone().into_buffer_arg(),
            starts.clone().into_buffer_arg(),
            costs.clone().into_buffer_arg(),
            DepthsLaunch::of(layout),
            view as u32,
            neighbours.len() as u32,
            count as u32,
        );
        for direction in DIRECTIONS {
            let paths = paths(layout, direction);
            let count = paths.len() / 3;
            let [dx, dy] = direction.map(|step| step as u32);
            semi_global::add_along::launch(
                client,
                groups_of(client, count, UNITS),
                units(),
                buffers.words("paths", paths)?.into_buffer_arg(),
                self.views.clone().into_buffer_arg(),
                self.grey.clone().into_buffer_arg(),
                ranges.clone().into_buffer_arg(),
                starts.clone().into_buffer_arg(),
                costs.clone().into_buffer_arg(),
                sums.clone().into_buffer_arg(),
                DepthsLaunch::of(layout),
                view as u32,
                dx,
                dy,
                count as u32,
            );
        }
        let found = buffers.zero_floats("depths of a view", FOUND * pixels)?;
        semi_global::best::launch(
            client,
            groups(client, pixels),
            units(),
            ranges.into_buffer_arg(),
            starts.into_buffer_arg(),
            costs.into_buffer_arg(),
            sums.into_buffer_arg(),
            found.clone().into_buffer_arg(),
            DepthsLaunch::of(layout),
            pixels as u32,
        );
        Ok(found)
    }
}

/// This many groups of so many work-items.
fn groups_of(client: &Client, count: usize, units: usize) -> CubeCount {
    cubecl::calculate_cube_count_elemwise(client, count.max(1) * units, CubeDim::new_1d(units as u32))
}

#[cfg(test)]
mod tests {
    use dvr_core::View;
    use dvr_core::hull::{MaskDistance, hull_distance};
    use dvr_core::voxel::VoxelGrid;
    use dvr_test_support::test_with;

    use super::super::super::sweep::depth_map;
    use super::super::super::view_selection::neighbours;
    use super::*;
    use crate::error::Error;
    use crate::occupancy::OccupancyBitmask;
    use crate::step::suite::speckled_arc;
    use crate::views::TrainingView;

    /// Checks something of photographs, whom they are matched with, and the hull.
    fn with_photographs<T>(views: &[View], check: impl FnOnce(&[Picture], &[Vec<usize>], &Hull) -> T) -> T {
        let masks: Vec<MaskDistance> = (views.iter().filter_map(|view| view.training_pair()))
            .map(|(camera, mask)| MaskDistance::new(camera, mask))
            .collect();
        let grid = VoxelGrid::new(25, 0.55);
        let values: Vec<f32> = (0..grid.len()).map(|node| hull_distance(&masks, grid.position(node), 0.1, 4)).collect();
        let hull = Hull { bitmask: OccupancyBitmask::new(&grid, &values), values: &values };
        let views: Vec<&View> = views.iter().collect();
        let views = TrainingView::pack(&views, 6, 1);
        let pictures: Vec<Picture> = views.iter().map(|view| Picture::new(view, 0.01)).collect();
        check(&pictures, &neighbours(&pictures), &hull)
    }

    fn gpu() -> Device {
        dvr_test_support::gpu(dvr_gpu::open(0)).device
    }

    #[test_with(gpu)]
    fn depths_are_those_of_the_cpu_but_for_rounding() {
        let (device, cancellation) = (gpu(), Cancellation::default());
        with_photographs(&speckled_arc(6), |pictures, neighbours, hull| {
            let found = depth_maps(&device, pictures, neighbours, hull, &cancellation).unwrap();
            let [mut known, mut odd, mut far] = [0; 3];
            for (view, found) in found.iter().enumerate() {
                let expected = depth_map(pictures, view, &neighbours[view], hull);
                assert_eq!(found.z_depth.len(), expected.z_depth.len());
                for pixel in 0..found.z_depth.len() {
                    let [a, b] =
                        [found, &expected].map(|map| [map.z_depth[pixel], map.confidence[pixel], map.hull[pixel]]);
                    known += usize::from(!b[0].is_nan());
                    let same = (0..3).all(|i| (a[i] - b[i]).abs() < 1e-4 || a[i].is_nan() && b[i].is_nan());
                    odd += usize::from(!same);
                    far += usize::from(!same && ((a[0] - b[0]).abs() > 0.02 || a[0].is_nan() != b[0].is_nan()));
                }
            }
            println!("{odd} of {known} depths differ, {far} by more than a pixel");
            assert!(known > 1000 && 1000 * odd < known, "{odd} of {known} depths differ, {far} by more than a pixel");
        });
    }

    #[test_with(gpu)]
    fn views_without_two_to_be_matched_with_have_no_depth_and_work_can_be_ended() {
        let device = gpu();
        with_photographs(&speckled_arc(6)[..2], |pictures, neighbours, hull| {
            let found = depth_maps(&device, pictures, neighbours, hull, &Cancellation::default()).unwrap();
            assert!(found.len() == 2 && found.iter().all(|map| map.z_depth.iter().all(|depth| depth.is_nan())));
        });
        let cancellation = Cancellation::default();
        cancellation.cancel();
        let ended = with_photographs(&speckled_arc(6), |pictures, neighbours, hull| {
            depth_maps(&device, pictures, neighbours, hull, &cancellation)
        });
        assert!(matches!(ended, Err(Error::Cancelled(_))));
    }
}
