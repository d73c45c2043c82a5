//! View-dependent colour as bytes: safetensors, with the cells of the grid among the metadata.

use std::collections::HashMap;

use dvr_core::UnitCube;
use dvr_core::voxel::VoxelGrid;
use glam::Vec3;
use half::f16;
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};

use super::ViewColor;
use super::harmonics::TERMS;

/// Names of the tensors: indices of nodes, x fastest, `[n]`; and the coefficients of each, by term and channel.
const NODES: &str = "nodes";
const COEFFICIENTS: &str = "coefficients";

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
    /// As bytes: indices of nodes in 32 bits, coefficients in 16. `surface` is what it was fitted to, in the caller's words.
    ///
    /// # Errors
    /// When the container cannot hold them.
    pub fn to_bytes(&self, surface: &str) -> Result<Vec<u8>, ViewColorError> {
        let nodes: Vec<u8> = self.nodes.iter().flat_map(|node| node.to_le_bytes()).collect();
        let numbers = self.coefficients.as_flattened().iter().flat_map(|by_channel| by_channel.to_array());
        let numbers: Vec<u8> = numbers.flat_map(|number| f16::from_f32(number).to_le_bytes()).collect();
        let count = self.nodes.len();
        let tensors = [
            (NODES, TensorView::new(Dtype::U32, vec![count], &nodes).map_err(broken)?),
            (COEFFICIENTS, TensorView::new(Dtype::F16, vec![count, TERMS, 3], &numbers).map_err(broken)?),
            (SURFACE, TensorView::new(Dtype::U8, vec![surface.len()], surface.as_bytes()).map_err(broken)?),
        ];
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
        Ok(Self::new(grid, nodes, by_channel.as_chunks().0.to_vec()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored() -> ViewColor {
        let grid = VoxelGrid::new(5, UnitCube::default().half_extent() as f32);
        let coefficients = |node: u32| std::array::from_fn(|term| Vec3::new(node as f32, term as f32, 0.5) / 128.0);
        let nodes = vec![3, 17, 124];
        ViewColor::new(grid, nodes.clone(), nodes.into_iter().map(coefficients).collect())
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
        assert!(ViewColor::from_bytes(b"photographs").is_err());
    }
}
