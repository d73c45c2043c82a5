//! Training of a field on grids: rays, ray_gradients, gradients, Adam and the map of empty cells as kernels; and looking at
//! what was learned.
//!
//! What is learned stays on the device from step to step. A step is given its rays, some words each, and tells nothing
//! unless it is asked. Its results do not depend on the order in which work-items run: the same device gives the same
//! bits.

mod cubic;
mod gather;
mod levels;
mod look;
mod occupancy;
mod patch;
mod photo;
mod photo_consistency;
mod pyramid;
pub(crate) mod rays;
mod space;
mod stage;
mod trainer;
mod viewer;
mod walk;
mod weights;

pub use rays::RAY_GRADIENT_COLUMNS;
pub use trainer::GpuStep;
pub use viewer::{GpuGridView, NodeValues};

/// A photograph, and the camera that took it. Matrices are column by column.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// Where the camera stands.
    pub center: [f32; 3],
    /// Pixel coordinates (and 1) to a ray direction of unit z-depth.
    pub to_direction: [f32; 9],
    /// From a point to pixel coordinates times z-depth, and z-depth: this times the point, and `offset`.
    pub projection: [f32; 9],
    /// See `projection`.
    pub offset: [f32; 3],
    /// Pixels a row, and rows.
    pub size: [u32; 2],
}

/// All photographs.
#[derive(Clone, Debug, Default)]
pub struct Photographs {
    /// One after the other.
    pub views: Vec<Photograph>,
    /// Their pixels, row by row: red, green and blue from the lowest byte on, and 1 in the highest where the object is
    /// shown.
    pub pixels: Vec<u32>,
    /// Their pixels' z-depths, `f32::MAX` where nothing was measured (devices need not know what is not finite); empty
    /// without depth maps.
    pub z_depths: Vec<f32>,
}

/// Nested grids with parameters at their active nodes; each has half the cells of the next.
#[derive(Clone, Debug)]
pub struct GpuLevels {
    /// Coarse to fine: nodes along an edge, and the active ones in rising order.
    pub levels: Vec<(usize, Vec<u32>)>,
    /// Steps of Adam done, then for each level its parameters, their first and their second moments, in one row.
    pub state: Vec<f32>,
    /// What is added to the sum of the levels at the active nodes of the finest.
    pub base: Vec<f32>,
    /// The values at all nodes of the finest, active or not.
    pub values: Vec<f32>,
}

/// Weights of the losses; the words are those of the training's configuration.
#[derive(Clone, Copy, Debug)]
pub struct GpuLosses {
    pub color: f32,
    pub texture: f32,
    pub photo_consistency: f32,
    pub photo_consistency_limit: f32,
    pub patch_ncc: f32,
    pub patch_ncc_min: f32,
    pub patch_stride: u32,
    pub depth: f32,
    pub mask: f32,
    pub sharpness: f32,
    pub smoothness_knee: f32,
    /// Cosine between ray and surface at which the gradient of the depth is damped.
    pub grazing: f32,
}

/// What a step is told.
#[derive(Clone, Debug)]
pub struct GpuStepInput<'a> {
    /// The first ray among those that [`GpuStep::draw`] was given.
    pub first: usize,
    /// Rays.
    pub rays: usize,
    /// Step sizes of the levels of the shape and of the colour, coarse to fine.
    pub rates: [&'a [f32]; 2],
    /// Weight of the mean smoothness.
    pub smoothness: f32,
    /// The colour that nodes tend to, and how strongly.
    pub rest: ([f32; 3], f32),
}

/// What a step's losses were.
#[derive(Clone, Debug)]
pub struct GpuLossSums {
    /// The rays' ray_gradients, [`RAY_GRADIENT_COLUMNS`] numbers each: the point, the gradients by the shape's value and by the
    /// colour; then the losses by colour, cross-view colour, structure, depth and mask, and whether the ray hits and
    /// shows the object, and does either.
    pub ray_gradients: Vec<f32>,
    /// Mean smoothness of the nodes near the surface.
    pub smoothness: f32,
}

#[cfg(test)]
mod tests;
