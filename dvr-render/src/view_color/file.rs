//! View-dependent colour as bytes: safetensors, with the cells of the grid among the metadata.

use std::collections::HashMap;

use dvr_core::UnitCube;
use dvr_core::voxel::VoxelGrid;
use glam::{Mat3, Vec3, Vec4};
use half::f16;
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensorError, SafeTensors, serialize};

use super::ViewColor;
use super::harmonics::TERMS;
use super::residual_views::{ResidualView, ResidualViews};

/// Names of the tensors: indices of nodes, x fastest, `[n]`; and the coefficients of each, by term and channel.
const NODES: &str = "nodes";
const COEFFICIENTS: &str = "coefficients";

/// Names of the tensors of residual views: what takes points of object space to homogeneous pixels, row by row, `[v, 3, 4]`;
/// width and height, `[v, 2]`; and z-depth and change of all pixels of all views, one after the other, `[p]` and `[p, 3]`.
/// Files without them have none.
const PROJECTIONS: &str = "residual_projections";
const SIZES: &str = "residual_sizes";
const DEPTHS: &str = "residual_depths";
const CHANGES: &str = "residual_changes";

/// Key of the cells along an edge of the grid, over the padded cube.
const CELLS: &str = "cells";

/// Name of the tensor of what is said of the surface: bytes of UTF-8. (Not among the metadata, which are written in an order of
/// chance where there are several.)
const SURFACE: &str = "surface";

/// Most cells along an edge that a file may claim to have.
const MAX_CELLS: usize = 128;

/// Why bytes cannot be read, or written, as view-dependent colour.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("this is no view-dependent colour: {problem}")]
pub struct ViewColorError {
    /// What is wrong with them.
    pub problem: String,
}

fn broken(problem: impl std::fmt::Display) -> ViewColorError {
    ViewColorError { problem: problem.to_string() }
}

impl ViewColor {
    /// As bytes: indices of nodes in 32 bits, coefficients in 16, changes in 8. `surface` is what it was fitted to, in the
    /// caller's words.
    ///
    /// # Errors
    /// When the container cannot hold them.
    pub fn to_bytes(&self, surface: &str) -> Result<Vec<u8>, ViewColorError> {
        let nodes: Vec<u8> = self.nodes.iter().flat_map(|node| node.to_le_bytes()).collect();
        let numbers = self.coefficients.as_flattened().iter().flat_map(|by_channel| by_channel.to_array());
        let numbers: Vec<u8> = numbers.flat_map(|number| f16::from_f32(number).to_le_bytes()).collect();
        let count = self.nodes.len();
        let residuals = ResidualTensors::of(&self.residuals);
        let mut tensors = vec![
            (NODES, TensorView::new(Dtype::U32, vec![count], &nodes).map_err(broken)?),
            (COEFFICIENTS, TensorView::new(Dtype::F16, vec![count, TERMS, 3], &numbers).map_err(broken)?),
            (SURFACE, TensorView::new(Dtype::U8, vec![surface.len()], surface.as_bytes()).map_err(broken)?),
        ];
        if !self.residuals.0.is_empty() {
            tensors.extend(residuals.tensors().map_err(broken)?);
        }
        let metadata = HashMap::from([(CELLS.to_owned(), self.grid.cells().to_string())]);
        serialize(tensors, Some(metadata)).map_err(broken)
    }

    /// What was said of the surface when these bytes were made; `None` where nothing was.
    ///
    /// # Errors
    /// When they are something else, or are cut short.
    pub fn surface_of(bytes: &[u8]) -> Result<Option<String>, ViewColorError> {
        let tensors = SafeTensors::deserialize(bytes).map_err(broken)?;
        let Ok(surface) = tensors.tensor(SURFACE) else { return Ok(None) };
        String::from_utf8(surface.data().to_vec()).map(Some).map_err(broken)
    }

    /// From bytes.
    ///
    /// # Errors
    /// When they are something else, are cut short, or do not fit together.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ViewColorError> {
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(broken)?;
        let cells = metadata.metadata().as_ref().and_then(|metadata| metadata.get(CELLS));
        let cells: usize = cells.and_then(|cells| cells.parse().ok()).ok_or_else(|| broken("it has no cells"))?;
        if !(1..=MAX_CELLS).contains(&cells) {
            return Err(broken(format!("{cells} cells along an edge, expected 1 to {MAX_CELLS}")));
        }
        let grid = VoxelGrid::new(cells + 1, UnitCube::default().half_extent() as f32);
        let tensors = SafeTensors::deserialize(bytes).map_err(broken)?;
        let tensor = |name: &str, dtype: Dtype| {
            let tensor = tensors.tensor(name).map_err(broken)?;
            if tensor.dtype() != dtype {
                return Err(broken(format!("{name} has numbers of type {:?}, expected {dtype:?}", tensor.dtype())));
            }
            Ok(tensor)
        };
        let (nodes, numbers) = (tensor(NODES, Dtype::U32)?, tensor(COEFFICIENTS, Dtype::F16)?);
        let nodes: Vec<u32> = nodes.data().as_chunks().0.iter().map(|&bytes| u32::from_le_bytes(bytes)).collect();
        if numbers.shape() != [nodes.len(), TERMS, 3] {
            return Err(broken(format!("{} nodes and coefficients of shape {:?}", nodes.len(), numbers.shape())));
        }
        if !nodes.is_sorted_by(|a, b| a < b) || nodes.last().is_some_and(|&last| last as usize >= grid.len()) {
            return Err(broken("its nodes are not those of its grid, in order"));
        }
        let numbers: Vec<f32> =
            numbers.data().as_chunks().0.iter().map(|&bytes| f16::from_le_bytes(bytes).to_f32()).collect();
        if !numbers.iter().all(|number| number.is_finite()) {
            return Err(broken("not all of its coefficients are numbers"));
        }
        let by_channel: Vec<Vec3> = numbers.as_chunks().0.iter().map(|&channels: &[f32; 3]| channels.into()).collect();
        let residuals = if tensors.names().contains(&PROJECTIONS) {
            // Any number of what has these parts.
            let bytes = |name, dtype, parts: &[usize]| {
                let found = tensor(name, dtype)?;
                match found.shape() {
                    [_, rest @ ..] if rest == parts => Ok(found.data().to_vec()),
                    shape => Err(broken(format!("{name} has shape {shape:?}"))),
                }
            };
            ResidualTensors {
                projections: bytes(PROJECTIONS, Dtype::F32, &[3, 4])?,
                sizes: bytes(SIZES, Dtype::U32, &[2])?,
                depths: bytes(DEPTHS, Dtype::F16, &[])?,
                changes: bytes(CHANGES, Dtype::I8, &[3])?,
            }
            .views()?
        } else {
            ResidualViews::default()
        };
        Ok(Self { residuals, ..Self::new(grid, nodes, by_channel.as_chunks().0.to_vec()) })
    }
}

/// Residual views as the bytes of their tensors.
struct ResidualTensors {
    projections: Vec<u8>,
    sizes: Vec<u8>,
    depths: Vec<u8>,
    changes: Vec<u8>,
}

impl ResidualTensors {
    fn of(ResidualViews(views): &ResidualViews) -> Self {
        let rows = |view: &ResidualView| {
            let (columns, offset) = (view.projection.transpose(), view.offset);
            (0..3).flat_map(move |row| [columns.col(row).to_array().to_vec(), vec![offset[row]]].concat())
        };
        Self {
            projections: views.iter().flat_map(rows).flat_map(f32::to_le_bytes).collect(),
            sizes: views.iter().flat_map(|view| [view.width, view.height]).flat_map(u32::to_le_bytes).collect(),
            depths: views.iter().flat_map(|view| &view.depths).flat_map(|depth| depth.to_le_bytes()).collect(),
            changes: views.iter().flat_map(|view| view.changes.as_flattened()).flat_map(|c| c.to_le_bytes()).collect(),
        }
    }

    fn tensors(&self) -> Result<[(&'static str, TensorView<'_>); 4], SafeTensorError> {
        let (views, pixels) = (self.sizes.len() / 8, self.depths.len() / 2);
        Ok([
            (PROJECTIONS, TensorView::new(Dtype::F32, vec![views, 3, 4], &self.projections)?),
            (SIZES, TensorView::new(Dtype::U32, vec![views, 2], &self.sizes)?),
            (DEPTHS, TensorView::new(Dtype::F16, vec![pixels], &self.depths)?),
            (CHANGES, TensorView::new(Dtype::I8, vec![pixels, 3], &self.changes)?),
        ])
    }

    fn views(&self) -> Result<ResidualViews, ViewColorError> {
        let numbers: Vec<f32> = self.projections.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
        let sizes: Vec<u32> = self.sizes.as_chunks().0.iter().map(|&bytes| u32::from_le_bytes(bytes)).collect();
        let depths: Vec<f16> = self.depths.as_chunks().0.iter().map(|&bytes| f16::from_le_bytes(bytes)).collect();
        let changes: Vec<[i8; 3]> =
            self.changes.as_chunks().0.iter().map(|c: &[u8; 3]| c.map(u8::cast_signed)).collect();
        let (projections, sizes) = (numbers.as_chunks::<12>().0, sizes.as_chunks::<2>().0);
        if projections.len() != sizes.len() {
            return Err(broken(format!("{} cameras of residual views and {} sizes", projections.len(), sizes.len())));
        }
        let (mut depths, mut changes) = (&depths[..], &changes[..]);
        let mut views = Vec::with_capacity(sizes.len());
        for (numbers, &[width, height]) in projections.iter().zip(sizes) {
            let pixels = usize::try_from(u64::from(width) * u64::from(height)).map_err(broken)?;
            let parts = depths.split_at_checked(pixels).zip(changes.split_at_checked(pixels));
            let ((own_depths, depths_left), (own_changes, changes_left)) =
                parts.ok_or_else(|| broken(format!("no numbers for {width} x {height} pixels of a residual view")))?;
            (depths, changes) = (depths_left, changes_left);
            let rows: [Vec4; 3] = std::array::from_fn(|row| Vec4::from_slice(&numbers[4 * row..4 * row + 4]));
            let projection = Mat3::from_cols_array_2d(&rows.map(|row| row.truncate().to_array())).transpose();
            let offset = Vec3::from(rows.map(|row| row.w));
            let view =
                ResidualView::new([width, height], projection, offset, own_depths.to_vec(), own_changes.to_vec());
            views.push(view.ok_or_else(|| broken("a residual view has no camera, no pixels or wrong depths"))?);
        }
        if !depths.is_empty() || !changes.is_empty() {
            return Err(broken("residual views have more numbers than pixels"));
        }
        Ok(ResidualViews(views))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored() -> ViewColor {
        let grid = VoxelGrid::new(5, UnitCube::default().half_extent() as f32);
        let coefficients = |node: u32| std::array::from_fn(|term| Vec3::new(node as f32, term as f32, 0.5) / 128.0);
        let nodes = vec![3, 17, 124];
        let harmonics = ViewColor::new(grid, nodes.clone(), nodes.into_iter().map(coefficients).collect());
        let view = |size: [u32; 2], focal: f32| {
            let pixels = 0..size[0] * size[1];
            let depths = pixels.clone().map(|pixel| f16::from_f32(1.0 + pixel as f32 / 64.0)).collect();
            let changes = pixels.map(|pixel| [pixel as i8, -3, 127]).collect();
            let projection = Mat3::from_diagonal(Vec3::new(focal, focal, 1.0));
            ResidualView::new(size, projection, Vec3::new(0.5, 1.5, 2.0), depths, changes).unwrap()
        };
        ViewColor { residuals: ResidualViews(vec![view([3, 2], 5.0), view([1, 4], 7.0)]), ..harmonics }
    }

    #[test]
    fn what_is_stored_is_read_again() {
        let stored = stored();
        let bytes = stored.to_bytes("a ball").unwrap();
        assert_eq!(ViewColor::surface_of(&bytes), Ok(Some("a ball".to_owned())));
        assert!((0..9).all(|_| stored.to_bytes("a ball").unwrap() == bytes), "the same bytes each time");
        assert_eq!(ViewColor::from_bytes(&bytes), Ok(stored));
        let empty = ViewColor::new(VoxelGrid::new(5, 0.55), Vec::new(), Vec::new());
        assert_eq!(ViewColor::from_bytes(&empty.to_bytes("").unwrap()), Ok(empty));
    }

    #[test]
    fn what_does_not_fit_together_is_an_error() {
        let bytes = stored().to_bytes("").unwrap();
        for length in 0..bytes.len() {
            assert!(ViewColor::from_bytes(&bytes[..length]).is_err(), "{length} bytes");
            assert!(ViewColor::surface_of(&bytes[..length]).is_err(), "{length} bytes");
        }
        let said = |nodes: Vec<u32>, first: f32, cells: usize| {
            let mut wrong = ViewColor { nodes, grid: VoxelGrid::new(cells + 1, 0.55), ..stored() };
            wrong.coefficients[0][0].x = first;
            ViewColor::from_bytes(&wrong.to_bytes("").unwrap()).unwrap_err().to_string()
        };
        assert!(said(vec![3, 3, 124], 0.0, 4).contains("in order"));
        assert!(said(vec![3, 17, 125], 0.0, 4).contains("in order"));
        assert!(said(vec![3, 17, 124], f32::NAN, 4).contains("not all"));
        assert!(said(vec![3, 17, 124], 0.0, 2).contains("in order"), "nodes of a larger grid");
        assert!(said(vec![3, 17, 124], 0.0, 600).contains("600 cells"));
        let said = |change: &dyn Fn(&mut ResidualView)| {
            let mut wrong = stored();
            change(&mut wrong.residuals.0[1]);
            ViewColor::from_bytes(&wrong.to_bytes("").unwrap()).unwrap_err().to_string()
        };
        assert!(said(&|view| view.height = 5).contains("1 x 5 pixels"));
        assert!(said(&|view| view.width = u32::MAX).contains("no numbers for"));
        assert!(said(&|view| view.height = 3).contains("more numbers"));
        assert!(
            said(&|view| {
                view.depths.truncate(3);
                view.changes.truncate(3);
            })
            .contains("no numbers for")
        );
        assert!(said(&|view| view.projection = Mat3::ZERO).contains("no camera"));
        assert!(said(&|view| view.offset.x = f32::NAN).contains("no camera"));
        assert!(said(&|view| view.depths[2] = f16::INFINITY).contains("wrong depths"));
        assert!(said(&|view| view.depths[2] = -f16::ONE).contains("wrong depths"));
        assert!(ViewColor::from_bytes(b"photographs").is_err());
    }
}
