//! Grid fields in few bytes: quantised, and only where the surface is.
//!
//! A trilinear surface is determined by the corners of the cells that it passes through. Their values are stored as
//! steps of a thirty-second of a cell; for all other nodes it is enough to know on which side they are. Colours are
//! stored, in 64 steps, where such a cell needs them. Both are far finer than the accuracy of training. The whole is
//! deflated (RFC 1951).

use std::io::{Read, Write};

use dvr_core::voxel::VoxelGrid;
use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;

use crate::field::grid_field::{GridField, GridValues};

/// Why bytes cannot be read as a grid field.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GridFormatError {
    /// They begin otherwise.
    #[error("these bytes are not a grid field")]
    NotAGridField,
    /// Written by another version of this program.
    #[error("the grid field has format version {found}, expected {expected}")]
    Version {
        /// The version found.
        found: u32,
        /// The version that this program reads.
        expected: u32,
    },
    /// The header describes grids that cannot be.
    #[error(
        "the grid field has {shape_nodes} and {color_nodes} nodes along an edge over +-{half_extent}, expected 2 to \
         {MAX_NODES} nodes over a positive extent"
    )]
    Extents {
        /// Nodes of the occupancy grid along an edge.
        shape_nodes: u32,
        /// Nodes of the colour grid along an edge.
        color_nodes: u32,
        /// Half the edge length.
        half_extent: f32,
    },
    /// The values are not the ones that were written.
    #[error("the grid field is damaged: {reason}")]
    Damaged {
        /// What reading it met.
        reason: String,
    },
    /// The header describes more than is kept.
    #[error("the grid field has {values} values, and at most {MAX_VALUES} are read")]
    TooLarge {
        /// Occupancies and colour channels of all nodes.
        values: usize,
    },
    /// There are fewer or more values than the header asks for.
    #[error("the grid field is cut short")]
    CutShort,
}

/// Version of the format.
pub const GRID_FORMAT_VERSION: u32 = 2;

const MAGIC: &[u8; 4] = b"DVRL";

/// Bytes before the deflated part: magic, version, nodes of shape and colour, half extent.
const HEADER: usize = 20;

/// Quantisation steps of the shape along the edge of a cell: values within four cells are distinguished.
const STEPS_PER_CELL: f32 = 32.0;

/// Colours may overshoot, since they are clamped only after interpolation: what the first and the last step stand for.
const COLOR_RANGE: [f32; 2] = [-0.25, 1.25];

/// The last quantisation step of colours.
const LAST_COLOR: f32 = 63.0;

/// Most nodes along an edge that a file may claim to have: those of 512 cells, the most that training makes.
const MAX_NODES: u32 = 513;

/// Most values of both grids together: those of 512 cells with colours half as fine, which take 750 MB.
pub const MAX_VALUES: usize = 190_000_000;

/// What a node is: away from the surface on either side, or stored.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum Class {
    Outside = 0,
    Inside = 1,
    Stored = 2,
}

/// A field as bytes.
///
/// # Errors
/// [`GridFormatError::TooLarge`] where the field has more than [`MAX_VALUES`].
pub fn to_bytes(field: &GridField) -> Result<Vec<u8>, GridFormatError> {
    let (shape, color) = (field.shape(), field.color());
    check_values(&shape.grid, &color.grid)?;
    let classes = classify(shape);
    let step = shape.grid.spacing() / STEPS_PER_CELL;
    let mut plain: Vec<u8> = classes.iter().map(|&class| class as u8).collect();
    let mut predictor = Predictor::new(&shape.grid, &classes);
    for node in (0..classes.len()).filter(|&node| classes[node] == Class::Stored) {
        let code = quantised(shape.values[node], step);
        plain.push(code.wrapping_sub(predictor.predict(node)) as u8);
        predictor.learn(node, code);
    }
    let needed = needed_colors(&shape.grid, &classes, &color.grid);
    for channel in 0..3 {
        let mut previous = 0u8;
        for node in (0..needed.len()).filter(|&node| needed[node]) {
            // Neighbours differ little: differences deflate well.
            let byte = color_byte(color.values[3 * node + channel]);
            plain.push(byte.wrapping_sub(previous));
            previous = byte;
        }
    }
    let mut bytes = MAGIC.to_vec();
    bytes.extend(GRID_FORMAT_VERSION.to_le_bytes());
    bytes.extend((shape.grid.nodes() as u32).to_le_bytes());
    bytes.extend((color.grid.nodes() as u32).to_le_bytes());
    bytes.extend(shape.grid.half_extent().to_le_bytes());
    let mut encoder = DeflateEncoder::new(bytes, Compression::best());
    encoder.write_all(&plain).and_then(|()| encoder.finish()).map_err(|e| damaged(&e))
}

/// A field from bytes.
///
/// # Errors
/// When the bytes are not a grid field, are cut short, come from another version of the program, or claim more than
/// [`MAX_VALUES`].
pub fn from_bytes(bytes: &[u8]) -> Result<GridField, GridFormatError> {
    if bytes.len() < HEADER || &bytes[..4] != MAGIC {
        return Err(GridFormatError::NotAGridField);
    }
    let word = |i: usize| [bytes[4 * i], bytes[4 * i + 1], bytes[4 * i + 2], bytes[4 * i + 3]];
    let version = u32::from_le_bytes(word(1));
    if version != GRID_FORMAT_VERSION {
        return Err(GridFormatError::Version { found: version, expected: GRID_FORMAT_VERSION });
    }
    let (nodes, color_nodes) = (u32::from_le_bytes(word(2)), u32::from_le_bytes(word(3)));
    let half_extent = f32::from_le_bytes(word(4));
    let plausible = |n: u32| (2..=MAX_NODES).contains(&n);
    if !(plausible(nodes) && plausible(color_nodes) && half_extent > 0.0 && half_extent.is_finite()) {
        return Err(GridFormatError::Extents { shape_nodes: nodes, color_nodes, half_extent });
    }
    let (shape, color) =
        (VoxelGrid::new(nodes as usize, half_extent), VoxelGrid::new(color_nodes as usize, half_extent));
    check_values(&shape, &color)?;
    read_plain(&mut DeflateDecoder::new(&bytes[HEADER..]), shape, color)
}

fn check_values(shape: &VoxelGrid, color: &VoxelGrid) -> Result<(), GridFormatError> {
    let values = shape.len() + 3 * color.len();
    if values > MAX_VALUES { Err(GridFormatError::TooLarge { values }) } else { Ok(()) }
}

/// The next bytes of what was deflated; memory grows as they come.
fn next_bytes(plain: &mut impl Read, count: usize) -> Result<Vec<u8>, GridFormatError> {
    let mut bytes = Vec::new();
    plain.by_ref().take(count as u64).read_to_end(&mut bytes).map_err(|e| damaged(&e))?;
    bytes.shrink_to_fit();
    if bytes.len() == count { Ok(bytes) } else { Err(GridFormatError::CutShort) }
}

fn damaged(problem: &std::io::Error) -> GridFormatError {
    GridFormatError::Damaged { reason: problem.to_string() }
}

/// How many values of shape and colour a file of this field stores.
pub fn stored_values(field: &GridField) -> usize {
    let classes = classify(field.shape());
    let shape = classes.iter().filter(|class| **class == Class::Stored).count();
    let needed = needed_colors(&field.shape().grid, &classes, &field.color().grid);
    shape + 3 * needed.iter().filter(|needed| **needed).count()
}

/// What was deflated, part by part: nothing is made for what is not there.
fn read_plain(plain: &mut impl Read, shape: VoxelGrid, color: VoxelGrid) -> Result<GridField, GridFormatError> {
    let classes = next_bytes(plain, shape.len())?;
    let classes: Vec<Class> = classes
        .into_iter()
        .map(|byte| match byte {
            0 => Class::Outside,
            1 => Class::Inside,
            _ => Class::Stored,
        })
        .collect();
    let values = read_shape(plain, &shape, &classes)?;
    let needed = needed_colors(&shape, &classes, &color);
    drop(classes);
    let colors = read_colors(plain, &needed)?;
    if plain.read(&mut [0]).map_err(|e| damaged(&e))? > 0 {
        return Err(GridFormatError::CutShort);
    }
    let shape = GridValues { grid: shape, values };
    Ok(GridField::new(shape, GridValues { grid: color, values: colors }))
}

/// The occupancy of every node.
fn read_shape(plain: &mut impl Read, shape: &VoxelGrid, classes: &[Class]) -> Result<Vec<f32>, GridFormatError> {
    let stored = classes.iter().filter(|class| **class == Class::Stored).count();
    let codes = next_bytes(plain, stored)?;
    let (step, far) = (shape.spacing() / STEPS_PER_CELL, 2.0 * shape.spacing());
    let mut values: Vec<f32> = classes.iter().map(|&class| if class == Class::Inside { far } else { -far }).collect();
    let mut predictor = Predictor::new(shape, classes);
    let nodes = (0..classes.len()).filter(|&node| classes[node] == Class::Stored);
    for (node, &residual) in nodes.zip(&codes) {
        let code = predictor.predict(node).wrapping_add(residual as i8);
        predictor.learn(node, code);
        values[node] = (f32::from(code) + 0.5) * step;
    }
    Ok(values)
}

/// The colour of every node; grey where none is needed.
fn read_colors(plain: &mut impl Read, needed: &[bool]) -> Result<Vec<f32>, GridFormatError> {
    let count = needed.iter().filter(|needed| **needed).count();
    let mut colors = vec![0.5; 3 * needed.len()];
    for channel in 0..3 {
        let mut byte = 0u8;
        let differences = next_bytes(plain, count)?;
        let nodes = (0..needed.len()).filter(|&node| needed[node]);
        for (node, difference) in nodes.zip(differences) {
            byte = byte.wrapping_add(difference);
            colors[3 * node + channel] = byte_color(byte);
        }
    }
    Ok(colors)
}

/// Which nodes are corners of cells that the surface passes through.
fn classify(shape: &GridValues) -> Vec<Class> {
    let (grid, values) = (&shape.grid, &shape.values);
    let mut classes: Vec<Class> =
        values.iter().map(|&value| if value >= 0.0 { Class::Inside } else { Class::Outside }).collect();
    let (cells, offsets) = (grid.cells(), grid.corner_offsets());
    for i in 0..cells.pow(3) {
        let node = grid.index([i % cells, i / cells % cells, i / (cells * cells)]);
        let inside = offsets.iter().filter(|&&offset| values[node + offset] >= 0.0).count();
        if inside > 0 && inside < 8 {
            offsets.iter().for_each(|offset| classes[node + offset] = Class::Stored);
        }
    }
    classes
}

/// Guesses a node's code from those before it, so that only what is new has to be stored: shapes are almost linear
/// from node to node (the Lorenzo predictor, Ibarria et al. 2003, on as many axes as there are neighbours).
struct Predictor<'a> {
    /// Which nodes have a code, once it is their turn.
    classes: &'a [Class],
    codes: Vec<i8>,
    steps: [usize; 3],
}

impl<'a> Predictor<'a> {
    fn new(grid: &VoxelGrid, classes: &'a [Class]) -> Self {
        let nodes = grid.nodes();
        Self { classes, codes: vec![0; grid.len()], steps: [1, nodes, nodes * nodes] }
    }

    fn predict(&self, node: usize) -> i8 {
        let code = |back: usize| {
            let i = node.checked_sub(back).filter(|&i| self.classes[i] == Class::Stored)?;
            Some(i16::from(self.codes[i]))
        };
        let [x, y, z] = self.steps;
        let plane = |a: usize, b: usize| Some(code(a)? + code(b)? - code(a + b)?);
        let all =
            || Some(code(x)? + code(y)? + code(z)? - code(x + y)? - code(x + z)? - code(y + z)? + code(x + y + z)?);
        let guess = all().or_else(|| plane(x, y)).or_else(|| plane(x, z)).or_else(|| plane(y, z));
        let guess = guess.or_else(|| code(x)).or_else(|| code(y)).or_else(|| code(z)).unwrap_or(0);
        guess.clamp(-128, 127) as i8
    }

    fn learn(&mut self, node: usize, code: i8) {
        self.codes[node] = code;
    }
}

/// The colour nodes around stored shape nodes.
fn needed_colors(shape: &VoxelGrid, classes: &[Class], color: &VoxelGrid) -> Vec<bool> {
    let mut needed = vec![false; color.len()];
    let offsets = color.corner_offsets();
    for node in (0..classes.len()).filter(|&node| classes[node] == Class::Stored) {
        let cell = color.locate(shape.position(node));
        offsets.iter().for_each(|offset| needed[cell.node + offset] = true);
    }
    needed
}

/// The sign is kept: codes 0 and up are inside, -1 and down outside, each for the middle of its step.
fn quantised(value: f32, step: f32) -> i8 {
    (value / step).floor().clamp(-128.0, 127.0) as i8
}

fn color_byte(value: f32) -> u8 {
    let [low, high] = COLOR_RANGE;
    ((value - low) / (high - low) * LAST_COLOR).round().clamp(0.0, LAST_COLOR) as u8
}

fn byte_color(byte: u8) -> f32 {
    let [low, high] = COLOR_RANGE;
    low + (high - low) * f32::from(byte) / LAST_COLOR
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::field::grid_field::tests::ball;

    #[test]
    fn the_surface_and_its_colours_survive() {
        let field = ball(33);
        let bytes = to_bytes(&field).unwrap();
        assert!(bytes.len() < 8_000, "{} bytes", bytes.len());
        let read = from_bytes(&bytes).unwrap();
        let cell = field.shape().grid.spacing();
        for i in 0..200 {
            let direction = Vec3::new((i as f32).sin(), (1.7 * i as f32).cos(), (2.3 * i as f32).sin()).normalize();
            let point = 0.3 * direction;
            let value = |f: &GridField| f.shape().grid.value(&f.shape().values, point);
            assert!((value(&field) - value(&read)).abs() <= 0.51 * cell / STEPS_PER_CELL);
            for (a, b) in field.color_at(point, None).iter().zip(read.color_at(point, None)) {
                assert!((a - b).abs() < 0.5 * 1.5 / LAST_COLOR + 1e-4, "{a} {b}");
            }
        }
        // Every sign is kept, so the topology is.
        let signs = |f: &GridField| f.shape().values.iter().map(|&v| v >= 0.0).collect::<Vec<_>>();
        assert_eq!(signs(&field), signs(&read));
        assert_eq!(to_bytes(&read).unwrap(), bytes, "writing again changes nothing");
    }

    #[test]
    fn damaged_bytes_are_refused() {
        let bytes = to_bytes(&ball(33)).unwrap();
        for other in [b"".as_slice(), b"DVRX"] {
            assert_eq!(from_bytes(other).err(), Some(GridFormatError::NotAGridField));
        }
        for length in [10, HEADER, bytes.len() / 2, bytes.len() - 1] {
            assert!(from_bytes(&bytes[..length]).is_err(), "{length} bytes");
        }
        let mut newer = bytes.clone();
        newer[4] = 9;
        assert_eq!(
            from_bytes(&newer).err(),
            Some(GridFormatError::Version { found: 9, expected: GRID_FORMAT_VERSION })
        );
        let claiming = |nodes: [u32; 2]| {
            let mut claiming = bytes.clone();
            claiming[8..16].copy_from_slice(&nodes.map(u32::to_le_bytes).concat());
            from_bytes(&claiming).err()
        };
        for nodes in [[u32::MAX, 17], [2049, 17], [33, 0]] {
            assert!(matches!(claiming(nodes), Some(GridFormatError::Extents { .. })), "{nodes:?}");
        }
        let values = 513usize.pow(3) * 4;
        assert_eq!(claiming([513, 513]), Some(GridFormatError::TooLarge { values }));
        assert_eq!(claiming([513, 257]), Some(GridFormatError::CutShort));
    }
}
