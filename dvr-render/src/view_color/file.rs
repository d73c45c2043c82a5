//! View-dependent colour as bytes: safetensors, with the cells of the grid among the metadata.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::Path;

use dvr_core::UnitCube;
use dvr_core::files::decoded_picture;
use dvr_core::voxel::VoxelGrid;
use glam::{Mat3, Vec3, Vec4};
use half::f16;
use image::{ImageFormat, ImageReader};
use rayon::prelude::*;
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensorError, SafeTensors, serialize};

use super::ViewColor;
use super::harmonics::TERMS;
use super::lumigraph::{Lumigraph, Photograph, nodes};

/// Names of the tensors: indices of nodes, x fastest, `[n]`; and the coefficients of each, by term and channel.
const NODES: &str = "nodes";
const COEFFICIENTS: &str = "coefficients";

/// Names of the tensors of photographs: what takes points of object space to homogeneous pixels, row by row, `[v, 3, 4]`;
/// width, height, pixels from one node of depths to the next and bytes of the JPEG, `[v, 4]`; and z-depths at the nodes and JPEGs of all, one after the other, `[n]` and
/// `[b]`. Files without them have none.
const PROJECTIONS: &str = "photograph_projections";
const SIZES: &str = "photograph_sizes";
const DEPTHS: &str = "photograph_depths";
const PICTURES: &str = "photographs";

/// All that a file may hold.
const TENSORS: [&str; 7] = [NODES, COEFFICIENTS, SURFACE, PROJECTIONS, SIZES, DEPTHS, PICTURES];

/// Key of the cells along an edge of the grid, over the padded cube.
const CELLS: &str = "cells";

/// Name of the tensor of what is said of the surface: bytes of UTF-8. (Not among the metadata, which are written in an order of
/// chance where there are several.)
const SURFACE: &str = "surface";

/// Most cells along an edge that a file may claim to have.
const MAX_CELLS: usize = 128;

/// Most pixels that all photographs of a file may claim to have.
const MAX_PIXELS: u64 = 64_000_000;

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
    /// As bytes: indices of nodes in 32 bits, coefficients in 16, photographs as JPEGs. `surface` is what it was fitted to, in the
    /// caller's words.
    ///
    /// # Errors
    /// When the container cannot hold them.
    pub fn to_bytes(&self, surface: &str) -> Result<Vec<u8>, ViewColorError> {
        let nodes: Vec<u8> = self.nodes.iter().flat_map(|node| node.to_le_bytes()).collect();
        let numbers = self.coefficients.as_flattened().iter().flat_map(|by_channel| by_channel.to_array());
        let numbers: Vec<u8> = numbers.flat_map(|number| f16::from_f32(number).to_le_bytes()).collect();
        let count = self.nodes.len();
        let photographs = PhotographTensors::of(&self.lumigraph);
        let mut tensors = vec![
            (NODES, TensorView::new(Dtype::U32, vec![count], &nodes).map_err(broken)?),
            (COEFFICIENTS, TensorView::new(Dtype::F16, vec![count, TERMS, 3], &numbers).map_err(broken)?),
            (SURFACE, TensorView::new(Dtype::U8, vec![surface.len()], surface.as_bytes()).map_err(broken)?),
        ];
        if !self.lumigraph.is_empty() {
            tensors.extend(photographs.tensors().map_err(broken)?);
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
        if let Some(other) = tensors.names().into_iter().find(|name| !TENSORS.contains(name)) {
            return Err(broken(format!("it holds \"{other}\", which this version does not know")));
        }
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
        let lumigraph = if tensors.names().contains(&PROJECTIONS) {
            // Any number of what has these parts.
            let bytes = |name, dtype, parts: &[usize]| {
                let found = tensor(name, dtype)?;
                match found.shape() {
                    [_, rest @ ..] if rest == parts => Ok(found.data().to_vec()),
                    shape => Err(broken(format!("{name} has shape {shape:?}"))),
                }
            };
            PhotographTensors {
                projections: bytes(PROJECTIONS, Dtype::F32, &[3, 4])?,
                sizes: bytes(SIZES, Dtype::U32, &[4])?,
                depths: bytes(DEPTHS, Dtype::F16, &[])?,
                pictures: bytes(PICTURES, Dtype::U8, &[])?,
            }
            .lumigraph()?
        } else {
            Lumigraph::default()
        };
        Ok(Self { lumigraph, ..Self::new(grid, nodes, by_channel.as_chunks().0.to_vec()) })
    }
}

/// Photographs as the bytes of their tensors.
struct PhotographTensors {
    projections: Vec<u8>,
    sizes: Vec<u8>,
    depths: Vec<u8>,
    pictures: Vec<u8>,
}

impl PhotographTensors {
    fn of(Lumigraph(photographs): &Lumigraph) -> Self {
        let rows = |photograph: &Photograph| {
            let (columns, offset) = (photograph.projection.transpose(), photograph.offset);
            (0..3).flat_map(move |row| [columns.col(row).to_array().to_vec(), vec![offset[row]]].concat())
        };
        let sizes = |photograph: &Photograph| {
            let [width, height] = photograph.size();
            [width, height, photograph.spacing, photograph.stored.len() as u32]
        };
        let depths = photographs.iter().flat_map(|photograph| &photograph.depths);
        Self {
            projections: photographs.iter().flat_map(rows).flat_map(f32::to_le_bytes).collect(),
            sizes: photographs.iter().flat_map(sizes).flat_map(u32::to_le_bytes).collect(),
            depths: depths.flat_map(|depth| depth.to_le_bytes()).collect(),
            pictures: photographs.iter().flat_map(|photograph| &photograph.stored).copied().collect(),
        }
    }

    fn tensors(&self) -> Result<[(&'static str, TensorView<'_>); 4], SafeTensorError> {
        let (count, nodes) = (self.sizes.len() / 16, self.depths.len() / 2);
        Ok([
            (PROJECTIONS, TensorView::new(Dtype::F32, vec![count, 3, 4], &self.projections)?),
            (SIZES, TensorView::new(Dtype::U32, vec![count, 4], &self.sizes)?),
            (DEPTHS, TensorView::new(Dtype::F16, vec![nodes], &self.depths)?),
            (PICTURES, TensorView::new(Dtype::U8, vec![self.pictures.len()], &self.pictures)?),
        ])
    }

    fn lumigraph(&self) -> Result<Lumigraph, ViewColorError> {
        let numbers: Vec<f32> = self.projections.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
        let sizes: Vec<u32> = self.sizes.as_chunks().0.iter().map(|&bytes| u32::from_le_bytes(bytes)).collect();
        let depths: Vec<f16> = self.depths.as_chunks().0.iter().map(|&bytes| f16::from_le_bytes(bytes)).collect();
        let (projections, sizes) = (numbers.as_chunks::<12>().0, sizes.as_chunks::<4>().0);
        if projections.len() != sizes.len() {
            return Err(broken(format!("{} cameras of photographs and {} sizes", projections.len(), sizes.len())));
        }
        let pixels = |&[width, height, ..]: &[u32; 4]| u64::from(width) * u64::from(height);
        let claimed = sizes.iter().map(pixels).fold(0, u64::saturating_add);
        if claimed > MAX_PIXELS {
            return Err(broken(format!("its photographs have {claimed} pixels, expected at most {MAX_PIXELS}")));
        }
        let (mut depths, mut pictures) = (&depths[..], &self.pictures[..]);
        let mut parts = Vec::with_capacity(sizes.len());
        for (numbers, &[width, height, spacing, bytes]) in projections.iter().zip(sizes) {
            if spacing == 0 {
                return Err(broken("its depths have no pixels between them"));
            }
            let [columns, rows] = nodes([width, height], spacing);
            let split = depths.split_at_checked(columns as usize * rows as usize);
            let ((own_depths, depths_left), (own_picture, pictures_left)) = split
                .zip(pictures.split_at_checked(bytes as usize))
                .ok_or_else(|| broken(format!("no numbers for {width} x {height} pixels of a photograph")))?;
            (depths, pictures) = (depths_left, pictures_left);
            let size = (width, height);
            parts.push(StoredPhotograph {
                projection: numbers,
                size,
                spacing,
                depths: own_depths,
                picture: own_picture,
            });
        }
        if !depths.is_empty() || !pictures.is_empty() {
            return Err(broken("it has more numbers than its photographs need"));
        }
        Ok(Lumigraph(parts.into_par_iter().map(StoredPhotograph::photograph).collect::<Result<_, _>>()?))
    }
}

/// What a file holds of a photograph.
struct StoredPhotograph<'a> {
    projection: &'a [f32; 12],
    size: (u32, u32),
    spacing: u32,
    depths: &'a [f16],
    picture: &'a [u8],
}

impl StoredPhotograph<'_> {
    fn photograph(self) -> Result<Photograph, ViewColorError> {
        // Before any pixel is decoded: the size is a claim.
        let reader = ImageReader::with_format(Cursor::new(self.picture), ImageFormat::Jpeg);
        if reader.into_dimensions().map_err(broken)? != self.size {
            return Err(broken("a photograph has another size than its file says"));
        }
        let decoded = decoded_picture(Path::new("a photograph"), self.picture).map_err(broken)?.into_rgb8();
        let rows: [Vec4; 3] = std::array::from_fn(|row| Vec4::from_slice(&self.projection[4 * row..4 * row + 4]));
        let projection = Mat3::from_cols_array_2d(&rows.map(|row| row.truncate().to_array())).transpose();
        let (offset, depths) = (Vec3::from(rows.map(|row| row.w)), self.depths.to_vec());
        let photograph = Photograph::new((projection, offset), (self.spacing, depths), self.picture.to_vec(), decoded);
        photograph.ok_or_else(|| broken("a photograph has no camera, or wrong depths"))
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::files::encoded_jpeg;
    use image::{Rgb, RgbImage};

    use super::*;

    fn stored() -> ViewColor {
        let grid = VoxelGrid::new(5, UnitCube::default().half_extent() as f32);
        let coefficients = |node: u32| std::array::from_fn(|term| Vec3::new(node as f32, term as f32, 0.5) / 128.0);
        let at = vec![3, 17, 124];
        let harmonics = ViewColor::new(grid, at.clone(), at.into_iter().map(coefficients).collect());
        let photograph = |size: [u32; 2], focal: f32| {
            let pixels = RgbImage::from_fn(size[0], size[1], |u, v| Rgb([40 * u as u8, 60 * v as u8, 200]));
            let jpeg = encoded_jpeg(&pixels, 90, None).unwrap();
            let pixels = decoded_picture(Path::new(""), &jpeg).unwrap().into_rgb8();
            let [columns, rows] = nodes(size, 2);
            let depths = (0..columns * rows).map(|node| f16::from_f32(1.0 + node as f32 / 64.0)).collect();
            let projection = Mat3::from_diagonal(Vec3::new(focal, focal, 1.0));
            Photograph::new((projection, Vec3::new(0.5, 1.5, 2.0)), (2, depths), jpeg, pixels).unwrap()
        };
        ViewColor { lumigraph: Lumigraph(vec![photograph([6, 2], 5.0), photograph([1, 4], 7.0)]), ..harmonics }
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
        let said = |change: &dyn Fn(&mut PhotographTensors)| {
            let mut wrong = PhotographTensors::of(&stored().lumigraph);
            change(&mut wrong);
            wrong.lumigraph().unwrap_err().to_string()
        };
        // Width, height, spacing and bytes of the second.
        let size = |tensors: &mut PhotographTensors, axis: usize, to: u32| {
            tensors.sizes[16 + 4 * axis..20 + 4 * axis].copy_from_slice(&to.to_le_bytes());
        };
        assert!(said(&|tensors| size(tensors, 1, 500)).contains("1 x 500 pixels"));
        assert!(said(&|tensors| size(tensors, 1, 5)).contains("another size"));
        assert!(said(&|tensors| size(tensors, 0, u32::MAX)).contains("pixels, expected at most"));
        assert!(said(&|tensors| size(tensors, 3, u32::MAX)).contains("no numbers for"));
        assert!(said(&|tensors| size(tensors, 3, 9)).contains("more numbers"));
        assert!(said(&|tensors| size(tensors, 2, 0)).contains("no pixels between"));
        assert!(said(&|tensors| tensors.depths.truncate(2)).contains("no numbers for"));
        assert!(said(&|tensors| tensors.depths.extend([0, 0])).contains("more numbers"));
        assert!(said(&|tensors| tensors.pictures[0] = 0).contains("no view-dependent colour"));
        assert!(said(&|tensors| tensors.projections.truncate(48)).contains("1 cameras"));
        assert!(said(&|tensors| tensors.projections.fill(0)).contains("no camera"));
        for wrong in [f16::INFINITY, -f16::ONE, f16::NAN] {
            let depth = |tensors: &mut PhotographTensors| tensors.depths[..2].copy_from_slice(&wrong.to_le_bytes());
            assert!(said(&depth).contains("wrong depths"), "{wrong}");
        }
        let other = TensorView::new(Dtype::U8, vec![1], &[0]).unwrap();
        let other = serialize([("residual_changes", other)], Some(HashMap::from([(CELLS.to_owned(), "4".to_owned())])));
        assert!(ViewColor::from_bytes(&other.unwrap()).unwrap_err().problem.contains("residual_changes"));
        assert!(ViewColor::from_bytes(b"pictures").is_err());
    }
}
