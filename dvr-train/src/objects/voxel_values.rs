//! Numbers in the voxels of the padded cube, as a function of space.

use dvr_core::UnitCube;
use dvr_core::mesh::Mesh;
use dvr_render::extract::{ExtractSettings, extract_mesh};
use glam::{IVec3, Vec3};

/// Numbers in the voxels of the padded cube; positive is inside.
pub(crate) struct VoxelValues {
    /// Voxels along an edge.
    pub voxels: usize,
    /// `voxels^3` of them, x fastest.
    pub values: Vec<f32>,
}

impl VoxelValues {
    /// Trilinear between the centres of voxels; beyond the outermost of them, their values.
    pub fn at(&self, point: Vec3) -> f32 {
        let place = (in_voxels(point, self.voxels) - 0.5).clamp(Vec3::ZERO, Vec3::splat((self.voxels - 1) as f32));
        let (low, share) = (place.floor(), place - place.floor());
        (0..8)
            .map(|corner| {
                let step = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
                let weight = Vec3::select(step.cmpeq(IVec3::ONE), share, 1.0 - share);
                let voxel = (low.as_ivec3() + step).min(IVec3::splat(self.voxels as i32 - 1));
                weight.element_product() * self.values[index(voxel, self.voxels)]
            })
            .sum()
    }

    /// The surface where the function is zero; empty where there is none.
    pub fn surface(&self, extraction: &ExtractSettings) -> Mesh {
        let values = |points: &[Vec3]| points.iter().map(|&point| self.at(point)).collect();
        // The level set of a coarse grid needs no refinement of its own.
        let extraction = ExtractSettings { upsampling_steps: 0, ..extraction.clone() };
        extract_mesh(&values, &extraction, &[]).map(|extracted| extracted.mesh).unwrap_or_default()
    }
}

/// The voxel that a point lies in, by its place among all; none outside of the cube.
pub(crate) fn voxel_of(point: Vec3, voxels: usize) -> Option<usize> {
    let voxel = in_voxels(point, voxels).floor().as_ivec3();
    let is_inside = voxel.cmpge(IVec3::ZERO).all() && voxel.cmplt(IVec3::splat(voxels as i32)).all();
    is_inside.then(|| index(voxel, voxels))
}

/// A position in units of voxels from the cube's lowest corner.
fn in_voxels(point: Vec3, voxels: usize) -> Vec3 {
    let half = UnitCube::default().half_extent() as f32;
    (point + half) * (voxels as f32 / (2.0 * half))
}

fn index(voxel: IVec3, voxels: usize) -> usize {
    let [x, y, z] = voxel.to_array().map(|i| i as usize);
    x + voxels * (y + voxels * z)
}
