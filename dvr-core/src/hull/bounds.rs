//! Axis-aligned boxes.

use glam::DVec3;

use crate::camera::Similarity;
use crate::ray::UnitCube;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min: DVec3,
    /// Largest coordinates.
    pub max: DVec3,
}

impl Bounds {
    /// The cube in which objects live, `[-0.5, 0.5]^3`.
    pub const UNIT_CUBE: Self = Self { min: DVec3::splat(-0.5), max: DVec3::splat(0.5) };

    /// A cube by its centre and half its edge length.
    pub fn cube(center: DVec3, half: f64) -> Self {
        Self { min: center - half, max: center + half }
    }

    /// The middle.
    pub fn center(&self) -> DVec3 {
        0.5 * (self.min + self.max)
    }

    /// What lies in both boxes; `None` where nothing does.
    pub fn intersection(&self, other: &Self) -> Option<Self> {
        let both = Self { min: self.min.max(other.min), max: self.max.min(other.max) };
        both.min.cmplt(both.max).all().then_some(both)
    }

    /// The box where a similarity that does not turn takes it.
    pub(crate) fn moved(&self, similarity: &Similarity) -> Self {
        Self { min: similarity.transform_point(self.min), max: similarity.transform_point(self.max) }
    }

    /// Edge lengths.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }
}

/// The cube that objects live in.
impl From<UnitCube> for Bounds {
    fn from(cube: UnitCube) -> Self {
        Self::cube(DVec3::ZERO, cube.half_extent())
    }
}
