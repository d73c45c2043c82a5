//! What it takes to be part of a visual hull.

/// What it takes to be part of a [`VisualHull`](super::VisualHull).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HullSettings {
    /// How many views may see background where there is hull. 0, the default, is the visual hull proper; more makes it
    /// robust against as many wrong masks or cameras, at the price of a fatter hull.
    pub max_disagreeing: usize,
    /// How many views must see the object at a point of the hull. 1 by default: a point out of every frame is outside.
    pub min_seeing: usize,
    /// Whether a voxel counts when its *projection touches* the mask, the default, so that a rod or a plate that is
    /// thinner than a voxel or a pixel is kept; otherwise the voxel's centre decides, which does not overestimate.
    pub conservative: bool,
    /// Pixels by which every mask may be wrong; 0.5 by default, since a mask is known at the centres of its pixels:
    /// with 0, a third of a surface seen at 64x64 pixels is carved away. Rods thinner than a pixel, which masks show in
    /// pieces, need 1 and some views that may disagree.
    pub margin: f64,
}

impl Default for HullSettings {
    fn default() -> Self {
        Self { max_disagreeing: 0, min_seeing: 1, conservative: true, margin: 0.5 }
    }
}
