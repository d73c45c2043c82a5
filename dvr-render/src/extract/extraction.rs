//! What extraction returns: a mesh, what it cost, and what the user should know about it.

use dvr_core::mesh::Mesh;

/// A mesh and how it came about.
#[derive(Clone, Debug)]
pub struct Extraction {
    /// The level set, in object space, with normals, and with colours if the field has any. Never empty.
    pub mesh: Mesh,
    /// Cells along an edge of the final grid.
    pub resolution: usize,
    /// What it cost.
    pub evaluations: Evaluations,
    /// Connected components of the mesh.
    pub components: usize,
    /// Components that were too small to stay.
    pub dropped_components: usize,
    /// What the user should know about this mesh.
    pub warnings: Vec<ExtractWarning>,
}

/// How many points the field was evaluated at, by purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Evaluations {
    /// At the nodes of the grids.
    pub grid: usize,
    /// On edges, to refine the crossings.
    pub refinement: usize,
    /// For the normals: one per vertex (of dual contouring: a crossing) if the field has gradients, else six.
    pub normals: usize,
}

impl Evaluations {
    /// All together.
    pub fn total(&self) -> usize {
        self.grid + self.refinement + self.normals
    }
}

/// A reason to look at a mesh twice.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExtractWarning {
    /// The object sticks out of the cube.
    #[error(
        "the surface is cut by the border of the cube ({vertices} vertices lie there): \
         raise `padding`, or check the scene's bounds"
    )]
    CutByCube {
        /// Vertices on the border.
        vertices: usize,
    },
    /// The coarse grid, and the seeds, saw nothing.
    #[error("the surface was only seen on a grid of {resolution}^3 cells: use fewer upsampling steps")]
    TooCoarse {
        /// Cells an edge of the coarsest grid that met the surface.
        resolution: usize,
    },
}
