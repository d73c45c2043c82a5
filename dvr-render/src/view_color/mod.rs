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
//! al. 2022) and of Gaussian splatting (Kerbl et al. 2023); the fit is linear. What photographs show beside that is kept view
//! by view, and blended for other directions ([`ViewColor::with_residuals`]).

mod file;
mod fit;
mod harmonics;
mod residual_fit;
mod residual_views;

use dvr_core::voxel::VoxelGrid;
use dvr_core::{Cancellation, Cancelled, Ray, View};
use glam::Vec3;
use rayon::prelude::*;

pub use file::ViewColorError;

use crate::shade::{Shaded, Shader};
use harmonics::{TERMS, harmonics};
use residual_views::ResidualViews;

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
    residuals: ResidualViews,
}

impl ViewColor {
    /// With these coefficients at these nodes, which rise.
    fn new(grid: VoxelGrid, nodes: Vec<u32>, coefficients: Vec<[Vec3; TERMS]>) -> Self {
        let mut slots = vec![NONE; grid.len()];
        (0..).zip(&nodes).for_each(|(slot, &node)| slots[node as usize] = slot);
        Self { grid, nodes, slots, coefficients, residuals: ResidualViews::default() }
    }

    /// Colours that do not depend on the direction.
    pub fn none() -> Self {
        Self::new(fit::grid(), Vec::new(), Vec::new())
    }

    /// The same with what photographs show beside it of `shader`'s surface. `None` where they do not show the surface.
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn with_residuals(
        &self,
        shader: &dyn Shader,
        views: &[&View],
        cancellation: &Cancellation,
    ) -> Result<Option<Self>, Cancelled> {
        let bare = Self { residuals: ResidualViews::default(), ..self.clone() };
        let residuals = residual_fit::residual_views(&bare.on(shader), views, cancellation)?;
        Ok((residuals.numbers() > 0).then_some(Self { residuals, ..bare }))
    }

    /// What is added to the colour, sRGB, of a point of the surface, in object space, that is seen along `direction`, from
    /// the camera on. Zero far from where photographs showed the surface.
    pub fn at(&self, point: Vec3, direction: Vec3) -> Vec3 {
        let direction = direction.normalize_or_zero();
        self.harmonics_at(point, direction) + self.residuals.at(point, direction)
    }

    /// The part of the harmonics, along a unit vector.
    fn harmonics_at(&self, point: Vec3, direction: Vec3) -> Vec3 {
        let (cell, terms) = (self.grid.locate(point), harmonics(direction));
        let mut sum = Vec3::ZERO;
        for (offset, weight) in self.grid.corner_offsets().into_iter().zip(cell.weights()) {
            if let Some(coefficients) = self.coefficients.get(self.slots[cell.node + offset] as usize) {
                sum += weight * terms.iter().zip(coefficients).map(|(term, by)| *term * *by).sum::<Vec3>();
            }
        }
        sum
    }

    /// What `shader` shows, with colours for the directions of the rays.
    pub fn on<'a>(&'a self, shader: &'a dyn Shader) -> impl Shader + 'a {
        OnShader { shader, color: self }
    }

    /// How many numbers it consists of.
    pub fn numbers(&self) -> usize {
        3 * TERMS * self.nodes.len() + self.residuals.numbers()
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
            let direction = ray.direction.as_vec3().normalize_or_zero();
            let color = Vec3::from(shaded.color) + self.color.harmonics_at(point, direction);
            // Residuals are what photographs show beside what can be seen of that.
            let color = color.clamp(Vec3::ZERO, Vec3::ONE) + self.color.residuals.at(point, direction);
            shaded.color = color.clamp(Vec3::ZERO, Vec3::ONE).to_array();
        });
        shaded
    }
}
