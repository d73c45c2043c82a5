//! What the systems that DVR is compared with learn by: one file per loss, with its source.

pub(super) mod chamfer;
pub(super) mod deformation;
pub(super) mod mesh_shape;
pub(super) mod ray_consistency;
pub(super) mod soft_silhouette;
pub(super) mod surrogate;
pub(super) mod voxel_cross_entropy;
