//! Training of a field on lattices: rays, lessons, gradients, Adam and the map of empty cells as kernels; and looking at
//! what was learned.
//!
//! What is learned stays on the device from step to step. A step is given its rays, some words each, and tells nothing
//! unless it is asked. Its results do not depend on the order in which work-items run: the same device gives the same
//! bits.

mod buffer;
mod cross_view;
mod cubic;
mod gather;
mod levels;
mod look;
mod marks;
mod patch;
mod photo;
mod pyramid;
mod rays;
mod stage;
mod trainer;
mod viewer;
mod walk;
mod weights;

pub use look::{RAY_COLUMNS, SHADED_COLUMNS};
pub use rays::LESSON_COLUMNS;
pub use trainer::LatticeTrainer;
pub use viewer::{LatticeViewer, NodeValues};

/// Why training on a device cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum FastError {
    /// It is no graphics processor.
    #[error("this device is no graphics processor")]
    NoGpu,
    /// Something is larger than the device's largest piece of memory.
    #[error("{what} would take {mebibytes} MiB in one piece, and this graphics processor has at most {most}")]
    TooLarge {
        /// What it is.
        what: &'static str,
        /// How large it would be.
        mebibytes: u64,
        /// How large it may be.
        most: u64,
    },
    /// There is no room for something within what [`crate::limit_memory`] allows.
    #[error("{what} would take {bytes} bytes beside the {held} that tensors hold, and {allowed} are allowed")]
    OverLimit {
        /// What it is.
        what: &'static str,
        /// How large it would be.
        bytes: u64,
        /// How much is in use.
        held: u64,
        /// How much may be.
        allowed: u64,
    },
    /// Its kernels are given too few pieces of memory.
    #[error("this graphics processor gives a kernel {bindings} pieces of memory, and 11 are needed")]
    TooFewBindings {
        /// How many it gives.
        bindings: u32,
    },
    /// The driver gave up.
    #[error("the graphics processor failed: {0}")]
    Device(String),
}

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

/// Nested lattices with parameters at their active nodes; each has half the cells of the next.
#[derive(Clone, Debug)]
pub struct LatticeLevels {
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
#[expect(missing_docs, reason = "they are those of `dvr_train::FastLosses`, which explains them")]
pub struct LatticeLosses {
    pub color: f32,
    pub texture: f32,
    pub cross_view: f32,
    pub cross_view_limit: f32,
    pub structure: f32,
    pub structure_limit: f32,
    pub structure_stride: u32,
    pub depth: f32,
    pub mask: f32,
    pub sharpness: f32,
    pub roughness_knee: f32,
    /// Cosine between ray and surface at which the gradient of the depth is damped.
    pub grazing: f32,
}

/// What a step is told.
#[derive(Clone, Debug)]
pub struct LatticeStep<'a> {
    /// The first ray among those that [`LatticeTrainer::draw`] was given.
    pub first: usize,
    /// Rays.
    pub rays: usize,
    /// Step sizes of the levels of the shape and of the colour, coarse to fine.
    pub rates: [&'a [f32]; 2],
    /// Weight of the mean roughness.
    pub roughness: f32,
    /// The colour that nodes tend to, and how strongly.
    pub rest: ([f32; 3], f32),
}

/// What a step's losses were.
#[derive(Clone, Debug)]
pub struct LatticeSums {
    /// The rays' lessons, [`LESSON_COLUMNS`] numbers each: the point, the gradients by the shape's value and by the
    /// colour; then the losses by colour, cross-view colour, structure, depth and mask, and whether the ray hits and
    /// shows the object, and does either.
    pub lessons: Vec<f32>,
    /// Mean roughness of the nodes near the surface.
    pub roughness: f32,
}
