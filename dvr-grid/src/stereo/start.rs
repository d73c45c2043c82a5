//! From views to a fused distance.

use dvr_core::metrics::depth_maps::StereoDepth;
use dvr_core::voxel::VoxelGrid;
use dvr_core::{Cancellation, Cancelled};
use rayon::prelude::*;

use super::consistency::consistent;
use super::depth_map::DepthMap;
use super::fusion::FusedDistance;
use super::hull::Hull;
use super::picture::Picture;
use super::sweep::depth_map;
use super::view_selection::neighbours;
use crate::accelerator::Accelerator;
use crate::error::Result;
use crate::occupancy::OccupancyBitmask;
use crate::views::TrainingView;

/// Side of the pixels that are matched, in cells of the fused field.
const PIXEL: f32 = 0.5;

/// How far a depth may be wrong: the larger of cells of the fused field and pixels at the object.
const DOUBT_CELLS: f32 = 2.5;
const DOUBT_PIXELS: f32 = 3.0;

/// What stereo says of the surface before training.
#[derive(Default)]
pub(crate) struct Stereo {
    /// The depths that other views confirm, of each view.
    pub depths: Vec<StereoDepth>,
    /// All of them as one distance; `None` where nothing matches.
    pub fused: Option<FusedDistance>,
}

impl Stereo {
    /// Matches views of these names through the hull, whose distance at the nodes of `grid` is `hull`, positive inside,
    /// and fuses the depths on `cells` cells along an edge. Views are matched on the
    /// accelerator, if it has room for them.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] where somebody wants it to end, and when a GPU fails.
    pub fn of_views(
        names: &[&str],
        views: &[TrainingView],
        grid: &VoxelGrid,
        hull: &[f32],
        cells: usize,
        accelerator: &mut Accelerator,
        cancellation: &Cancellation,
    ) -> Result<Self> {
        let fine = VoxelGrid::new(cells + 1, grid.half_extent());
        let hull = Hull { bitmask: OccupancyBitmask::new(grid, hull), values: hull };
        let pictures: Vec<Picture> = views.par_iter().map(|view| Picture::new(view, PIXEL * fine.spacing())).collect();
        let neighbours = neighbours(&pictures);
        let maps = depth_maps(&pictures, &neighbours, &hull, accelerator, cancellation)?;
        let mut maps = consistent(&pictures, &neighbours, &maps);
        let of_view = |view: usize| maps[view].of_view(names[view], &pictures[view], &neighbours[view]);
        let depths = (0..views.len()).map(of_view).collect();
        for (map, picture) in maps.iter_mut().zip(&pictures) {
            map.trust_hull((DOUBT_CELLS * fine.spacing()).max(DOUBT_PIXELS * picture.camera.footprint()));
        }
        cancellation.check()?;
        Ok(Self { depths, fused: FusedDistance::new(&pictures, &maps, &fine, &hull) })
    }
}

/// The depths of every view; see [`Stereo::of_views`].
fn depth_maps(
    pictures: &[Picture],
    neighbours: &[Vec<usize>],
    hull: &Hull,
    accelerator: &mut Accelerator,
    cancellation: &Cancellation,
) -> Result<Vec<DepthMap>> {
    #[cfg(feature = "gpu")]
    if let Some(found) =
        accelerator.run("stereo", |gpu| super::gpu::depth_maps(gpu, pictures, neighbours, hull, cancellation))?
    {
        return Ok(found);
    }
    let _ = accelerator;
    let sweep = |view: usize| {
        cancellation.check()?;
        Ok(depth_map(pictures, view, &neighbours[view], hull))
    };
    let maps = (0..pictures.len()).into_par_iter().map(sweep).collect::<std::result::Result<_, Cancelled>>()?;
    Ok(maps)
}

#[cfg(test)]
mod tests {
    use dvr_core::dataset::{ReadOptions, read_scene};
    use dvr_core::hull::{MaskDistance, hull_distance};
    use dvr_stress::{axes, write_scene};
    use glam::{EulerRot, Quat, Vec3};

    use super::*;

    /// Fused distance at a height on the axis of a bowl half as deep as wide, from 80 views.
    fn bowl(contrast: f64) -> [f32; 2] {
        let mut case = axes()
            .into_iter()
            .find(|found| found.name == "texture-contrast")
            .and_then(|axis| axis.case(contrast))
            .unwrap();
        case.config.views = 80;
        let folder = tempfile::tempdir().unwrap();
        let scene = write_scene(&case, "bowl", 0, folder.path()).unwrap();
        let scene = read_scene(&scene, &ReadOptions::default()).unwrap();
        let views: Vec<_> = scene.views.iter().collect();
        let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        let masks: Vec<MaskDistance> = (views.iter().filter_map(|view| view.training_pair()))
            .map(|(camera, mask)| MaskDistance::new(camera, mask))
            .collect();
        let grid = VoxelGrid::new(33, 0.55);
        let distance = |point| hull_distance(&masks, point, 0.1, 4);
        let hull: Vec<f32> = (0..grid.len()).map(|node| distance(grid.position(node))).collect();
        let views = TrainingView::pack(&views, 6, 1);
        let fused =
            Stereo::of_views(&names, &views, &grid, &hull, 64, &mut Accelerator::default(), &Cancellation::default())
                .unwrap()
                .fused;
        // The bowl's axis is y, turned like this; its rim is at .18, its floor between -.18 and -.1.
        let turn = Quat::from_euler(EulerRot::XYZ, 0.5, 0.3, 0.2);
        [0.06, -0.15].map(|height| {
            let point = turn * Vec3::new(0.0, height, 0.0);
            let hull = distance(point);
            fused.as_ref().map_or(hull, |fused| fused.at(point, hull))
        })
    }

    #[test]
    fn stereo_sees_into_a_textured_bowl_that_the_hull_closes_and_never_through_its_floor() {
        let [hollow, floor] = bowl(1.0);
        assert!(hollow < 0.0 && floor > 0.0, "{hollow} in the hollow, {floor} in the floor");
        // Without texture, shading is all that there is to match.
        let [_, floor] = bowl(0.0);
        assert!(floor > 0.0, "without texture: {floor} in the floor");
    }
}
