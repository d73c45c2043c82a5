//! The systems that DVR is compared with on single pictures (section 4.2): the same encoders, views and evaluation, with
//! the decoder and the loss of each paper.
//!
//! | name | paper | shape | learns from |
//! |---|---|---|---|
//! | `drc` | Tulsiani et al. 2017 | voxels | silhouettes, or depth maps |
//! | `softras` | Liu et al. 2019 | a deformed sphere | silhouettes |
//! | `r2n2` | Choy et al. 2016 | voxels | 3D |
//! | `psgn` | Fan et al. 2017 | points | 3D |
//! | `pixel2mesh` | Wang et al. 2018 | a ball, deformed by features of the picture | 3D |
//! | `atlasnet` | Groueix et al. 2018 | pieces of surface | 3D |
//!
//! Occupancy Networks (Mescheder et al. 2019) have DVR's decoder, and are `occupancy` supervision of
//! [`ObjectsConfig`](super::ObjectsConfig).

pub(crate) mod config;
mod losses;
pub(crate) mod model;
mod targets;
pub(crate) mod task;
#[cfg(test)]
mod tests;
