//! Grid fields in few bytes: quantised, and only where the surface is.
//!
//! A trilinear surface is determined by the corners of the cells that it passes through. Their values are stored as
//! steps of a thirty-second of a cell; for all other nodes it is enough to know on which side they are. Colours are
//! stored, in 64 steps, where such a cell needs them. Both are far finer than the accuracy of training. The whole is
//! deflated (RFC 1951).

use std::io::{Read, Write};
use std::ops::Range;

use dvr_core::voxel::VoxelGrid;
use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;

use crate::active::ActiveNodes;
use crate::bricks::BrickValues;
use crate::color::CHANNELS;
use crate::field::grid_field::GridField;

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
const OUTSIDE: u8 = 0;
const INSIDE: u8 = 1;
const STORED: u8 = 2;

/// A field as bytes.
///
/// # Errors
/// [`GridFormatError::TooLarge`] where the field has more than [`MAX_VALUES`].
pub fn to_bytes(field: &GridField) -> Result<Vec<u8>, GridFormatError> {
    let (shape, color) = (field.shape(), field.color());
    let (grid, color_grid) = (shape.grid(), color.grid());
    check_values(grid, color_grid)?;
    let mut bytes = MAGIC.to_vec();
    bytes.extend(GRID_FORMAT_VERSION.to_le_bytes());
    bytes.extend((grid.nodes() as u32).to_le_bytes());
    bytes.extend((color_grid.nodes() as u32).to_le_bytes());
    bytes.extend(grid.half_extent().to_le_bytes());
    let mut encoder = DeflateEncoder::new(bytes, Compression::best());
    let stored = NodeSet::around_surface(field);
    let mut write = |plain: &[u8]| encoder.write_all(plain).map_err(|e| damaged(&e));
    let mut classes = vec![OUTSIDE; grid.nodes().pow(2)];
    for z in 0..grid.nodes() {
        field.occupancy().write_inside(z, &mut classes);
        stored.iter_range(z * classes.len()..(z + 1) * classes.len()).for_each(|node| {
            classes[node - z * grid.nodes().pow(2)] = STORED;
        });
        write(&classes)?;
    }
    let (step, mut predictor) = (grid.spacing() / STEPS_PER_CELL, Predictor::new(grid, &stored));
    let code = |node: usize| {
        let code = quantised(shape.at(grid.coordinates(node))[0], step);
        let residual = code.wrapping_sub(predictor.predict(node)) as u8;
        predictor.learn(node, code);
        residual
    };
    write(&stored.iter().map(code).collect::<Vec<u8>>())?;
    let needed = stored.needed_colors(grid, color_grid);
    for channel in 0..3 {
        let mut previous = 0u8;
        let difference = |node: usize| {
            // Neighbours differ little: differences deflate well.
            let byte = color_byte(color.at(color_grid.coordinates(node))[channel]);
            byte.wrapping_sub(std::mem::replace(&mut previous, byte))
        };
        write(&needed.iter().map(difference).collect::<Vec<u8>>())?;
    }
    encoder.finish().map_err(|e| damaged(&e))
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
    let stored = NodeSet::around_surface(field);
    stored.count() + 3 * stored.needed_colors(field.shape().grid(), field.color().grid()).count()
}

/// What was deflated, part by part: nothing is made for what is not there.
fn read_plain(plain: &mut impl Read, shape: VoxelGrid, color: VoxelGrid) -> Result<GridField, GridFormatError> {
    let (stored, inside) = read_classes(plain, &shape)?;
    let values = read_shape(plain, &shape, &stored, &inside)?;
    let colors = read_colors(plain, &color, &stored.needed_colors(&shape, &color))?;
    if plain.read(&mut [0]).map_err(|e| damaged(&e))? > 0 {
        return Err(GridFormatError::CutShort);
    }
    Ok(GridField::of_bricks(values, colors))
}

/// Which nodes are stored, and which of the others are inside.
fn read_classes(plain: &mut impl Read, shape: &VoxelGrid) -> Result<(NodeSet, NodeSet), GridFormatError> {
    let (nodes, plane) = (shape.nodes(), shape.nodes().pow(2));
    let (mut stored, mut inside) = (NodeSet::new(shape), NodeSet::new(shape));
    let mut below: Option<Vec<u8>> = None;
    for z in 0..nodes {
        let classes = next_bytes(plain, plane)?;
        // The surface does not pass between neighbours that are not stored.
        let is_torn = |a: &[u8], b: &[u8]| a.iter().zip(b).any(|(&a, &b)| a != b && a < STORED && b < STORED);
        let is_torn_along_x = classes.chunks(nodes).any(|row| is_torn(row, &row[1..]));
        let is_torn_along_z = below.is_some_and(|below| is_torn(&below, &classes));
        if is_torn_along_x || is_torn(&classes, &classes[nodes..]) || is_torn_along_z {
            return Err(GridFormatError::Damaged { reason: "a surface without values".to_owned() });
        }
        for (i, &class) in classes.iter().enumerate() {
            match class {
                OUTSIDE => {}
                INSIDE => inside.set(z * plane + i),
                _ => stored.set(z * plane + i),
            }
        }
        below = Some(classes);
    }
    Ok((stored, inside))
}

/// The occupancy: that of stored nodes, and two spacings on either side at all others.
fn read_shape(
    plain: &mut impl Read,
    shape: &VoxelGrid,
    stored: &NodeSet,
    inside: &NodeSet,
) -> Result<BrickValues<1>, GridFormatError> {
    let codes = next_bytes(plain, stored.count())?;
    let (step, far) = (shape.spacing() / STEPS_PER_CELL, 2.0 * shape.spacing());
    let mut predictor = Predictor::new(shape, stored);
    let value = |(node, &residual): (usize, &u8)| {
        let code = predictor.predict(node).wrapping_add(residual as i8);
        predictor.learn(node, code);
        (f32::from(code) + 0.5) * step
    };
    let values: Vec<f32> = stored.iter().zip(&codes).map(value).collect();
    let is_inside = |at: [usize; 3]| inside.contains(shape.index(at));
    Ok(BrickValues::between_sides(&stored.active(shape), &values, [[-far], [far]], is_inside))
}

/// The colours; grey where none is needed.
fn read_colors(
    plain: &mut impl Read,
    color: &VoxelGrid,
    needed: &NodeSet,
) -> Result<BrickValues<CHANNELS>, GridFormatError> {
    let count = needed.count();
    let mut colors = vec![[0.0; CHANNELS]; count];
    for channel in 0..CHANNELS {
        let mut byte = 0u8;
        for (color, difference) in colors.iter_mut().zip(next_bytes(plain, count)?) {
            byte = byte.wrapping_add(difference);
            color[channel] = byte_color(byte);
        }
    }
    Ok(BrickValues::between_sides(&needed.active(color), colors.as_flattened(), [[0.5; CHANNELS]; 2], |_| false))
}

/// A set of nodes, a bit each.
struct NodeSet(Vec<u64>);

impl NodeSet {
    fn new(grid: &VoxelGrid) -> Self {
        Self(vec![0; grid.len().div_ceil(64)])
    }

    /// The corners of the cells that the surface passes through.
    fn around_surface(field: &GridField) -> Self {
        let grid = field.shape().grid();
        let (mut set, offsets) = (Self::new(grid), grid.corner_offsets());
        for cell in field.occupancy().crossed_cells() {
            let node = grid.index(cell);
            offsets.iter().for_each(|offset| set.set(node + offset));
        }
        set
    }

    fn set(&mut self, node: usize) {
        self.0[node / 64] |= 1 << (node % 64);
    }

    fn contains(&self, node: usize) -> bool {
        self.0[node / 64] >> (node % 64) & 1 == 1
    }

    fn count(&self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// All of them, in rising order.
    fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        self.iter_range(0..64 * self.0.len())
    }

    /// Those of a range.
    fn iter_range(&self, range: Range<usize>) -> impl Iterator<Item = usize> + '_ {
        let words = range.start / 64..range.end.div_ceil(64);
        let of_word = |index: usize| {
            let mut word = self.0[index];
            std::iter::from_fn(move || {
                let bit = (word != 0).then(|| word.trailing_zeros() as usize)?;
                word &= word - 1;
                Some(64 * index + bit)
            })
        };
        words.flat_map(of_word).filter(move |node| range.contains(node))
    }

    /// The same as runs.
    fn active(&self, grid: &VoxelGrid) -> ActiveNodes {
        let mut runs: Vec<(u32, u32)> = Vec::new();
        for node in self.iter() {
            match runs.last_mut() {
                Some((start, length)) if (*start + *length) as usize == node && node % grid.nodes() > 0 => *length += 1,
                _ => runs.push((node as u32, 1)),
            }
        }
        ActiveNodes::of_runs(grid, runs.into_iter())
    }

    /// The colour nodes around these nodes of the shape.
    fn needed_colors(&self, shape: &VoxelGrid, color: &VoxelGrid) -> Self {
        let (mut needed, offsets) = (Self::new(color), color.corner_offsets());
        for node in self.iter() {
            let cell = color.locate(shape.position(node));
            offsets.iter().for_each(|offset| needed.set(cell.node + offset));
        }
        needed
    }
}

/// Guesses a node's code from those before it, so that only what is new has to be stored: shapes are almost linear
/// from node to node (the Lorenzo predictor, Ibarria et al. 2003, on as many axes as there are neighbours).
struct Predictor<'a> {
    /// Which nodes have a code, once it is their turn.
    stored: &'a NodeSet,
    /// Codes of the nodes of two layers: nothing that lies further back is asked for.
    codes: Vec<i8>,
    steps: [usize; 3],
}

impl<'a> Predictor<'a> {
    fn new(grid: &VoxelGrid, stored: &'a NodeSet) -> Self {
        let nodes = grid.nodes();
        Self { stored, codes: vec![0; 2 * nodes * nodes], steps: [1, nodes, nodes * nodes] }
    }

    fn predict(&self, node: usize) -> i8 {
        let code = |back: usize| {
            let i = node.checked_sub(back).filter(|&i| self.stored.contains(i))?;
            Some(i16::from(self.codes[i % self.codes.len()]))
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
        let layers = self.codes.len();
        self.codes[node % layers] = code;
    }
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
        let cell = field.shape().grid().spacing();
        for i in 0..200 {
            let direction = Vec3::new((i as f32).sin(), (1.7 * i as f32).cos(), (2.3 * i as f32).sin()).normalize();
            let point = 0.3 * direction;
            let value = |f: &GridField| f.shape().value(point);
            assert!((value(&field) - value(&read)).abs() <= 0.51 * cell / STEPS_PER_CELL);
            for (a, b) in field.color_at(point, None).iter().zip(read.color_at(point, None)) {
                assert!((a - b).abs() < 0.5 * 1.5 / LAST_COLOR + 1e-4, "{a} {b}");
            }
        }
        // Every sign is kept, so the topology is.
        let signs = |f: &GridField| f.dense_shape().values.iter().map(|&v| v >= 0.0).collect::<Vec<_>>();
        assert_eq!(signs(&field), signs(&read));
        assert_eq!(to_bytes(&read).unwrap(), bytes, "writing again changes nothing");
    }

    #[test]
    fn rows_at_the_surface_are_read_and_written_as_all_nodes_are() {
        let field = ball(33);
        let read = from_bytes(&to_bytes(&field).unwrap()).unwrap();
        assert!(2 * read.shape().layout().stored_rows() < field.shape().layout().stored_rows());
        let all = GridField::new(read.dense_shape(), read.dense_color());
        assert_eq!(to_bytes(&all).unwrap(), to_bytes(&read).unwrap());
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
