//! Colour that depends on the direction that a surface is seen from.
//!
//! A field and a textured mesh have one colour for each point. What photographs show beside it, highlights and the sheen of
//! what is seen at a slant, changes slowly along the surface: so it is kept apart, as spherical harmonics of degree 2
//! in the viewing direction at the nodes of a coarse grid near the surface,
//!
//! `c(x, d) = c(x) + sum over corners n of the cell of x, and terms k, of w_n(x) Y_k(d) a_nk`.
//!
//! It is fitted when the surface is known ([`ViewColor::fit`]): where colour may change with the direction while the
//! surface is learned, it explains dents away. Spherical harmonics per point are those of Plenoxels (Fridovich-Keil et
//! al. 2022) and of Gaussian splatting (Kerbl et al. 2023); the fit is linear. What photographs show beside that is blended
//! from those that were taken from nearby directions ([`ViewColor::with_photographs`]).

mod file;
mod fit;
mod harmonics;
mod lumigraph;
mod lumigraph_fit;

use dvr_core::voxel::VoxelGrid;
use dvr_core::{Cancellation, Cancelled, Ray, View};
use glam::Vec3;
use rayon::prelude::*;

pub use file::ViewColorError;

use crate::shade::{Shaded, Shader};
use harmonics::{TERMS, harmonics};
use lumigraph::Lumigraph;

/// Where a node has no coefficients.
const NONE: u32 = u32::MAX;

/// What is added to the colour of a surface for the direction that it is seen from.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewColor {
    grid: VoxelGrid,
    /// The nodes with coefficients, rising.
    nodes: Vec<u32>,
    /// Which of them each node of the grid is; [`NONE`] for others.
    slots: Vec<u32>,
    coefficients: Vec<[Vec3; TERMS]>,
    lumigraph: Lumigraph,
}

impl ViewColor {
    /// With these coefficients at these nodes, which rise.
    fn new(grid: VoxelGrid, nodes: Vec<u32>, coefficients: Vec<[Vec3; TERMS]>) -> Self {
        let mut slots = vec![NONE; grid.len()];
        (0..).zip(&nodes).for_each(|(slot, &node)| slots[node as usize] = slot);
        Self { grid, nodes, slots, coefficients, lumigraph: Lumigraph::default() }
    }

    /// Colours that do not depend on the direction.
    pub fn none() -> Self {
        Self::new(fit::grid(), Vec::new(), Vec::new())
    }

    /// The same with photographs, which show `shader`'s surface beside it. `None` where they do not show the surface.
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn with_photographs(
        &self,
        shader: &dyn Shader,
        views: &[&View],
        cancellation: &Cancellation,
    ) -> Result<Option<Self>, Cancelled> {
        let lumigraph = lumigraph_fit::lumigraph(shader, views, cancellation)?;
        Ok((!lumigraph.is_empty()).then(|| Self { lumigraph, ..self.clone() }))
    }

    /// The colour, sRGB in `[0, 1]`, of a point of the surface, in object space, that is seen along `direction`, from the camera
    /// on, where it is `color` from everywhere. The same far from where photographs showed the surface.
    pub fn at(&self, point: Vec3, direction: Vec3, color: Vec3) -> Vec3 {
        let direction = direction.normalize_or_zero();
        let coefficients = self.coefficients_at(point);
        let along = |direction: Vec3| {
            let terms = harmonics(direction).into_iter().zip(coefficients);
            (color + terms.map(|(term, by)| term * by).sum::<Vec3>()).clamp(Vec3::ZERO, Vec3::ONE)
        };
        (along(direction) + self.lumigraph.beside(point, direction, along)).clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// What the harmonics of a point are multiplied by.
    fn coefficients_at(&self, point: Vec3) -> [Vec3; TERMS] {
        let cell = self.grid.locate(point);
        let mut sums = [Vec3::ZERO; TERMS];
        for (offset, weight) in self.grid.corner_offsets().into_iter().zip(cell.weights()) {
            if let Some(coefficients) = self.coefficients.get(self.slots[cell.node + offset] as usize) {
                sums.iter_mut().zip(coefficients).for_each(|(sum, by)| *sum += weight * *by);
            }
        }
        sums
    }

    /// What `shader` shows, with colours for the directions of the rays.
    pub fn on<'a>(&'a self, shader: &'a dyn Shader) -> impl Shader + 'a {
        OnShader { shader, color: self }
    }

    /// Whether colours are the same for all directions.
    pub fn is_none(&self) -> bool {
        self.nodes.is_empty() && self.lumigraph.is_empty()
    }
}

struct OnShader<'a> {
    shader: &'a dyn Shader,
    color: &'a ViewColor,
}

impl Shader for OnShader<'_> {
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
        let mut shaded = self.shader.shade(rays);
        shaded.par_iter_mut().zip(rays).with_min_len(256).for_each(|(shaded, ray)| {
            let Some(shaded) = shaded else { return };
            let point = ray.at(f64::from(shaded.depth)).as_vec3();
            shaded.color = self.color.at(point, ray.direction.as_vec3(), shaded.color.into()).to_array();
        });
        shaded
    }
}
