//! Points on a surface, and points in a volume with their occupancy.

use glam::Vec3;

/// Points, most often sampled from a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions.
    pub points: Vec<Vec3>,
    /// Outward unit normals, one per point.
    pub normals: Option<Vec<Vec3>>,
    /// sRGB colours in `[0, 1]`, one per point.
    pub colors: Option<Vec<[f32; 3]>>,
}

/// Points of the cube, and whether each lies inside the object.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OccupancySamples {
    /// Positions.
    pub points: Vec<Vec3>,
    /// One a point.
    pub inside: Vec<bool>,
}
