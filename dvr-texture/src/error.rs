//! What can go wrong.

use dvr_core::Cancelled;

/// Why a mesh gets no texture.
#[derive(Debug, thiserror::Error)]
pub enum TextureError {
    /// There is no surface to colour.
    #[error("the mesh has no faces: there is no surface to colour")]
    NoFaces,
    /// The surface is closed, and its faces wind clockwise seen from outside: photographs would see its inside.
    #[error("the mesh is turned inside out: its faces wind clockwise seen from outside")]
    InsideOut,
    /// Photographs show nothing of the surface, or next to nothing.
    #[error("the {views} photographs see {:.1} % of the surface", 100.0 * seen)]
    Hidden {
        /// How many photographs were looked at.
        views: usize,
        /// Share of the surface's texels that one of them shows.
        seen: f64,
    },
    /// The texture is too small.
    #[error("the surface falls into {charts} charts, which a texture of {size} texels has no room for")]
    TooManyCharts {
        /// How many charts.
        charts: usize,
        /// The texture's edge in texels.
        size: u32,
    },
    /// The size is not one that is made.
    #[error("a texture has from {least} to {most} texels along its edge, and {size} were asked for")]
    Size {
        /// What was asked for.
        size: u32,
        /// The least.
        least: u32,
        /// The most.
        most: u32,
    },
    /// The texture takes more memory than there is for it, or than is allowed.
    #[error(
        "a texture of {size} texels along its edge takes about {} MB of memory to make, and {} MB are left for it",
        needed / 1_000_000, allowed / 1_000_000
    )]
    Memory {
        /// The texture's edge in texels.
        size: u32,
        /// Bytes that it takes.
        needed: u64,
        /// Bytes that it may.
        allowed: u64,
    },
    /// Somebody wants it to end.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
