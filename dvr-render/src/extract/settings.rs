//! What can be turned in an extraction.

use dvr_core::UnitCube;

use super::error::{ExtractError, Result};

/// The most cells per edge. Beyond it, a single-precision vertex cannot be distinguished from the grid's node beside it.
const MAX_RESOLUTION: usize = 2048;

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
        }
    }
}

impl ExtractSettings {
    /// Cells along an edge of the coarse grid; the settings must have been checked.
    pub(super) fn coarse_resolution(&self) -> usize {
        self.resolution.div_ceil(1 << self.upsampling_steps)
    }

    pub(super) fn check(&self) -> Result<()> {
        let refuse = |name, value: String, remedy| Err(ExtractError::Setting { name, value, remedy });
        if !(1..=MAX_RESOLUTION).contains(&self.resolution) {
            return refuse("resolution", self.resolution.to_string(), "It must be between 1 and 2048 cells.");
        }
        if self.upsampling_steps > self.resolution.ilog2() as usize {
            let remedy =
                "The coarse grid would have less than one cell: 2^upsampling_steps must not exceed resolution.";
            return refuse("upsampling_steps", self.upsampling_steps.to_string(), remedy);
        }
        if !(self.cube.padding > -1.0 && self.cube.padding.is_finite()) {
            return refuse("cube.padding", self.cube.padding.to_string(), "It must be above -1; 0.1 is usual.");
        }
        if !self.level.is_finite() {
            return refuse("level", self.level.to_string(), "It must be a finite logit; 0 is usual.");
        }
        if !(0.0..=1.0).contains(&self.min_component_share) {
            let remedy = "It must lie between 0 (keep all) and 1 (keep the largest).";
            return refuse("min_component_share", self.min_component_share.to_string(), remedy);
        }
        if self.max_points == 0 {
            return refuse("max_points", "0".to_owned(), "It must be at least 1; 65536 is usual.");
        }
        Ok(())
    }
}
