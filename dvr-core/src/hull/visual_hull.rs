//! The visual hull as an occupancy grid.

use glam::DVec3;

use super::bounds::Bounds;
use super::carve::Carver;
use super::settings::HullSettings;
use super::silhouette::Silhouette;
use crate::camera::Camera;
use crate::error::Result;
use crate::number_range::OutOfRange;
use crate::raster::Mask;

/// An occupancy grid of what no mask rules out.
#[derive(Clone, Debug, PartialEq)]
pub struct VisualHull {
    pub(super) bounds: Bounds,
    pub(super) resolution: usize,
    /// x fastest, then y, then z.
    pub(super) occupied: Vec<bool>,
}

impl VisualHull {
    /// Most voxels per edge: an eighth of a gigabyte.
    pub const MAX_RESOLUTION: usize = 512;

    /// Carves `resolution`^3 voxels of `bounds` by the masks. Cameras and bounds share one space, of any units.
    ///
    /// A view knows nothing of what lies out of its frame or behind its camera, so it rules out nothing there: an
    /// object may leave the picture. That nothing is left is not an error, see [`VisualHull::is_empty`].
    ///
    /// # Errors
    /// When a mask has another size than its camera's image, or the box is empty or not finite.
    pub fn carve(
        views: &[(&Camera, &Mask)],
        bounds: Bounds,
        resolution: usize,
        settings: &HullSettings,
    ) -> Result<Self> {
        let silhouettes = Silhouette::all(views)?;
        Self::carve_silhouettes(&silhouettes, bounds, resolution, settings)
    }

    pub(super) fn carve_silhouettes(
        silhouettes: &[Silhouette],
        bounds: Bounds,
        resolution: usize,
        settings: &HullSettings,
    ) -> Result<Self> {
        let size = bounds.size();
        if !(1..=Self::MAX_RESOLUTION).contains(&resolution)
            || !bounds.min.is_finite()
            || !size.is_finite()
            || size.min_element() <= 0.0
        {
            let value = format!("{resolution} voxels per edge between {} and {}", bounds.min, bounds.max);
            let range = format!("1 to {} voxels per edge of a box with a positive finite size", Self::MAX_RESOLUTION);
            return Err(OutOfRange::new("the grid of a visual hull", value, range).into());
        }
        let mut hull = Self { bounds, resolution, occupied: vec![false; resolution.pow(3)] };
        let carver = Carver { silhouettes, settings, bounds, resolution };
        carver.carve(&mut hull.occupied);
        Ok(hull)
    }

    /// The box that was carved.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Voxels along each edge of the box.
    pub fn resolution(&self) -> usize {
        self.resolution
    }

    /// Edge lengths of a voxel.
    pub fn voxel_size(&self) -> DVec3 {
        self.bounds.size() / self.resolution as f64
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        !self.occupied.contains(&true)
    }

    /// How many voxels are left.
    pub fn occupied_voxels(&self) -> usize {
        self.occupied.iter().filter(|&&voxel| voxel).count()
    }

    /// Volume of the voxels that are left, in the units of the box.
    pub fn volume(&self) -> f64 {
        self.occupied_voxels() as f64 * self.voxel_size().element_product()
    }

    /// Whether voxel `(x, y, z)` is part of the hull; voxels off the grid are not.
    pub fn voxel(&self, [x, y, z]: [usize; 3]) -> bool {
        let n = self.resolution;
        x < n && y < n && z < n && self.occupied[(z * n + y) * n + x]
    }

    /// Whether a point lies in a voxel of the hull; points out of the box do not.
    pub fn contains(&self, point: DVec3) -> bool {
        let cell = (point - self.bounds.min) / self.voxel_size();
        // NaN and negative coordinates fail here; the upper side is `voxel`'s to check.
        cell.cmpge(DVec3::ZERO).all() && self.voxel([cell.x as usize, cell.y as usize, cell.z as usize])
    }

    /// Centres of the hull's voxels, x fastest, then y, then z.
    pub fn centers(&self) -> impl Iterator<Item = DVec3> + '_ {
        (0..self.occupied.len()).filter(|&i| self.occupied[i]).map(|i| self.center_of(i))
    }

    /// The smallest box around the hull's voxels, or `None` for an empty hull.
    pub fn bounding_box(&self) -> Option<Bounds> {
        let half = 0.5 * self.voxel_size();
        let mut centers = self.centers();
        let first = centers.next()?;
        let (low, high) = centers.fold((first, first), |(low, high), p| (low.min(p), high.max(p)));
        Some(Bounds { min: low - half, max: high + half })
    }

    fn coordinates(&self, index: usize) -> [usize; 3] {
        let n = self.resolution;
        [index % n, index / n % n, index / (n * n)]
    }

    pub(super) fn center_of(&self, index: usize) -> DVec3 {
        let [x, y, z] = self.coordinates(index).map(|i| i as f64 + 0.5);
        self.bounds.min + DVec3::new(x, y, z) * self.voxel_size()
    }

    /// Centres of the voxels that have a neighbour (or the border of the grid) beside them that is not hull.
    pub(super) fn surface_centers(&self) -> Vec<DVec3> {
        let is_surface = |&index: &usize| {
            let at = self.coordinates(index);
            let neighbour = |axis: usize, step: usize| {
                let mut beside = at;
                beside[axis] = beside[axis].wrapping_add(step);
                self.voxel(beside)
            };
            self.occupied[index] && !(0..3).all(|axis| neighbour(axis, 1) && neighbour(axis, usize::MAX))
        };
        (0..self.occupied.len()).filter(is_surface).map(|index| self.center_of(index)).collect()
    }
}
