//! What can be turned in an extraction.

use dvr_core::number_range::{NumberRange, OutOfRange, above, check_config, real, whole};
use dvr_core::{Cancellation, UnitCube};

use super::error::Result;

/// The most cells per edge. Beyond it, a single-precision vertex cannot be distinguished from the grid's node beside it.
const MAX_RESOLUTION: u64 = 2048;

/// Bytes of a cell on the surface: in the grid, as vertices and faces, and while it is simplified (about 320), coloured and
/// written.
const CELL_BYTES: u64 = 600;

/// Bytes of a node of the coarse grid.
const NODE_BYTES: u64 = 16;

/// How the crossed edges of the grid become triangles. Both give closed, oriented manifolds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Contour {
    /// Marching cubes: vertices on the grid's edges. Corners and creases of the surface are cut off by up to a cell;
    /// triangles of different cells never meet but at their borders.
    #[default]
    MarchingCubes,
    /// Dual contouring (Ju et al. 2002): vertices in the grid's cells, where the tangent planes of the crossings around
    /// them meet. Corners and creases are kept; the field's gradient is asked for at each crossing.
    ///
    /// The mesh may intersect itself, which marching cubes' does not: where the surface is finer than the grid, and now
    /// and then at creases of a noisy field (none to three of 80 000 edges on trained scenes). It is a closed manifold
    /// all the same.
    Dual,
}

/// Where vertex normals come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NormalSource {
    /// The gradient of the field at the vertex; of dual contouring, the mean of those at the crossings around it. Costs
    /// one evaluation with gradient, or six without.
    #[default]
    Field,
    /// The mean of the adjacent faces' normals. Costs nothing.
    Faces,
}

/// How finely, where and how a level set is extracted.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExtractSettings {
    /// Cells along an edge of the cube, at most 2048. Rounded up to a multiple of `2^upsampling_steps`.
    pub resolution: usize,
    /// How often the coarse grid, of `resolution / 2^upsampling_steps` cells per edge, is refined along the surface.
    /// 0 evaluates the whole grid. Each step makes it about four times cheaper, and doubles what may be missed.
    pub upsampling_steps: usize,
    /// The cube in which the surface is sought.
    pub cube: UnitCube,
    /// The logit at the surface; 0 is an occupancy of one half.
    pub level: f32,
    /// How crossed edges become triangles.
    pub contour: Contour,
    /// The most evaluations per crossing to move it from where linear interpolation puts it to the true one; 0 for none.
    pub refinement_steps: usize,
    /// Where vertex normals come from.
    pub normals: NormalSource,
    /// Connected components whose area is below this share of the largest one's are dropped. 0 keeps all.
    pub min_component_share: f64,
    /// The most points the field is evaluated at in one batch.
    pub max_points: usize,
    /// Ends the extraction early, with [`ExtractError::Cancelled`](super::ExtractError::Cancelled).
    #[serde(skip)]
    pub cancellation: Cancellation,
}

impl Default for ExtractSettings {
    /// The grid of the configurations of DVR's reference code, 32 cells refined three times to 256, over the whole padded cube.
    fn default() -> Self {
        Self {
            resolution: 256,
            upsampling_steps: 3,
            cube: UnitCube::default(),
            level: 0.0,
            contour: Contour::default(),
            refinement_steps: 2,
            normals: NormalSource::default(),
            min_component_share: 0.0,
            max_points: 65_536,
            cancellation: Cancellation::default(),
        }
    }
}

impl ExtractSettings {
    /// Cells along an edge of the coarse grid; the settings must have been checked.
    pub(super) fn coarse_resolution(&self) -> usize {
        self.resolution.div_ceil(1 << self.upsampling_steps.min(usize::BITS as usize - 1))
    }

    /// The range of every number.
    pub const RANGES: &[NumberRange] = &[
        whole("resolution", 1, MAX_RESOLUTION),
        whole("upsampling_steps", 0, MAX_RESOLUTION.ilog2() as u64),
        above("cube.padding", -1.0, 10.0),
        real("level", -1e6, 1e6),
        whole("refinement_steps", 0, 1000),
        real("min_component_share", 0.0, 1.0),
        whole("max_points", 1, u64::MAX),
    ];

    /// Bytes that an extraction takes at most, about: of a surface that is as large as that of the cube, with twice as
    /// many faces as cells, and of the coarse grid.
    pub fn memory_estimate(&self) -> u64 {
        let cells = 6 * (self.resolution as u64).saturating_pow(2);
        let coarse = (self.coarse_resolution() as u64 + 3).saturating_pow(3);
        cells.saturating_mul(CELL_BYTES).saturating_add(coarse.saturating_mul(NODE_BYTES))
    }

    pub(super) fn check(&self) -> Result<()> {
        check_config(self, Self::RANGES)?;
        if self.upsampling_steps > self.resolution.ilog2() as usize {
            let range = "such that 2^upsampling_steps does not exceed resolution: the coarse grid would have no cell";
            return Err(OutOfRange::new("upsampling_steps", self.upsampling_steps, range).into());
        }
        Ok(())
    }
}
