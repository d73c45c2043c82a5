//! Grid fields in few bytes: quantised, and only where the surface is.
//!
//! A trilinear surface is determined by the corners of the cells that it passes through. Their values are stored as
//! steps of a thirty-second of a cell; for all other nodes it is enough to know on which side they are. Colours are
//! stored, in 64 steps, where such a cell needs them. Both are far finer than the accuracy of training. All is predicted
//! by what comes before it, and what is left is range coded with adaptive probabilities: signs, then values, then
//! colours, in one stream.

mod coder;
mod colors;
mod shape;
mod signs;

use dvr_core::voxel::VoxelGrid;
use flate2::Crc;

use crate::bricks::{BrickValues, NodeSet};
use crate::color::CHANNELS;
use crate::field::grid_field::GridField;
use coder::{Coder, Reader, Writer};

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
    /// It stores more than is kept of any surface.
    #[error("the grid field stores {values} values around its surface, and at most {MAX_STORED} are read")]
    TooMuchSurface {
        /// Occupancies and colour channels around the surface.
        values: usize,
    },
    /// There is less of it than the header asks for.
    #[error("the grid field is cut short")]
    CutShort,
}

/// Version of the format.
pub const GRID_FORMAT_VERSION: u32 = 3;

const MAGIC: &[u8; 4] = b"DVRL";

/// Bytes before the stream: magic, version, nodes of shape and colour, half extent, length of the stream in bytes, and the
/// CRC-32 of all but itself.
const HEADER: usize = 28;

/// Where the checksum is.
const CHECKSUM: usize = 24;

/// Quantisation steps of the shape along the edge of a cell: values within four cells are distinguished.
const STEPS_PER_CELL: f32 = 32.0;

/// Colours may overshoot, since they are clamped only after interpolation: what the first and the last step stand for.
const COLOR_RANGE: [f32; 2] = [-0.25, 1.25];

/// Most values around the surface: surfaces of photographs have a fourth of that with 512 cells.
const MAX_STORED: usize = 10_000_000;

/// The last quantisation step of colours.
const LAST_COLOR: f32 = 63.0;

/// Most nodes along an edge that a file may claim to have: those of 512 cells, the most that training makes.
const MAX_NODES: u32 = 513;

/// Most values of both grids together: those of 512 cells with colours half as fine, which take 750 MB.
pub const MAX_VALUES: usize = 190_000_000;

/// A field as bytes.
///
/// # Errors
/// [`GridFormatError::TooLarge`] where the field has more than [`MAX_VALUES`], [`GridFormatError::TooMuchSurface`] where
/// more of them than anybody reads lie around its surface.
pub fn to_bytes(field: &GridField) -> Result<Vec<u8>, GridFormatError> {
    let (shape, color) = (field.shape(), field.color());
    let (grid, color_grid) = (shape.grid(), color.grid());
    check_values(grid, color_grid)?;
    let step = grid.spacing() / STEPS_PER_CELL;
    let inside = NodeSet::inside(grid, field.occupancy());
    let mut writer = Writer::default();
    let of_shape = |at| quantised(shape.at(at)[0], step);
    code(&mut writer, [grid, color_grid], &inside, of_shape, |at| color.at(at).map(color_byte))?;
    let stream = writer.finish();
    let mut bytes = MAGIC.to_vec();
    bytes.extend(GRID_FORMAT_VERSION.to_le_bytes());
    bytes.extend((grid.nodes() as u32).to_le_bytes());
    bytes.extend((color_grid.nodes() as u32).to_le_bytes());
    bytes.extend(grid.half_extent().to_le_bytes());
    bytes.extend((stream.len() as u32).to_le_bytes());
    bytes.extend([0; 4]);
    bytes.extend(stream);
    let checksum = checksum(&bytes);
    bytes[CHECKSUM..HEADER].copy_from_slice(&checksum.to_le_bytes());
    Ok(bytes)
}

/// What is in a stream.
struct Coded {
    stored: NodeSet,
    inside: NodeSet,
    steps: Vec<i8>,
    needed: NodeSet,
    colors: Vec<[u8; CHANNELS]>,
}

/// Codes the signs of all nodes, the steps of those around the surface, and the colours that these need. A reader ignores
/// what is given, and fails where it comes to the end of its stream before, or there is too much.
fn code(
    coder: &mut impl Coder,
    [grid, color_grid]: [&VoxelGrid; 2],
    inside: &NodeSet,
    step: impl Fn([usize; 3]) -> i8,
    color: impl Fn([usize; 3]) -> [u8; CHANNELS],
) -> Result<Coded, GridFormatError> {
    let inside = signs::code_signs(coder, grid, inside).ok_or(GridFormatError::CutShort)?;
    let stored = inside.around_surface();
    check_stored(stored.count())?;
    let steps = shape::code_steps(coder, grid, &stored, &inside, step).ok_or(GridFormatError::CutShort)?;
    let needed = needed_colors(&stored, grid, color_grid);
    check_stored(stored.count() + CHANNELS * needed.count())?;
    let colors = colors::code_colors(coder, color_grid, &needed, LAST_COLOR as u8, color);
    let colors = colors.ok_or(GridFormatError::CutShort)?;
    Ok(Coded { stored, inside, steps, needed, colors })
}

/// The CRC-32 of all bytes but those that it is kept in.
fn checksum(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(&bytes[..CHECKSUM]);
    crc.update(&bytes[HEADER..]);
    crc.sum()
}

/// A field from bytes.
///
/// # Errors
/// When the bytes are not a grid field, are cut short or damaged, come from another version of the program, or claim grids
/// that cannot be, more than [`MAX_VALUES`], or more of a surface than there is of any.
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
    let (length, expected) = (u32::from_le_bytes(word(5)) as usize, u32::from_le_bytes(word(6)));
    let plausible = |n: u32| (2..=MAX_NODES).contains(&n);
    if !(plausible(nodes) && plausible(color_nodes) && half_extent > 0.0 && half_extent.is_finite()) {
        return Err(GridFormatError::Extents { shape_nodes: nodes, color_nodes, half_extent });
    }
    let (shape, color) =
        (VoxelGrid::new(nodes as usize, half_extent), VoxelGrid::new(color_nodes as usize, half_extent));
    check_values(&shape, &color)?;
    let stream = &bytes[HEADER..];
    if stream.len() < length {
        return Err(GridFormatError::CutShort);
    }
    if length == 0 || !length.is_multiple_of(4) {
        return Err(damaged("its length is that of no stream"));
    }
    if stream.len() > length {
        return Err(damaged("there is more of it than its header says"));
    }
    if checksum(bytes) != expected {
        return Err(damaged("its checksum is another"));
    }
    read(stream, shape, color)
}

fn check_values(shape: &VoxelGrid, color: &VoxelGrid) -> Result<(), GridFormatError> {
    let values = shape.len() + 3 * color.len();
    if values > MAX_VALUES { Err(GridFormatError::TooLarge { values }) } else { Ok(()) }
}

fn check_stored(values: usize) -> Result<(), GridFormatError> {
    if values > MAX_STORED { Err(GridFormatError::TooMuchSurface { values }) } else { Ok(()) }
}

fn damaged(reason: &str) -> GridFormatError {
    GridFormatError::Damaged { reason: reason.to_owned() }
}

/// How many values of shape and colour a file of this field stores.
pub fn stored_values(field: &GridField) -> usize {
    let (grid, color_grid) = (field.shape().grid(), field.color().grid());
    let stored = NodeSet::inside(grid, field.occupancy()).around_surface();
    stored.count() + CHANNELS * needed_colors(&stored, grid, color_grid).count()
}

/// What a stream holds. At nodes that are not stored, the occupancy is two spacings on either side; where no colour is
/// needed, it is grey.
fn read(stream: &[u8], shape: VoxelGrid, color: VoxelGrid) -> Result<GridField, GridFormatError> {
    let mut reader = Reader::new(stream);
    let nothing = NodeSet::new(&shape);
    let Coded { stored, inside, steps, needed, colors } =
        code(&mut reader, [&shape, &color], &nothing, |_| 0, |_| [0; CHANNELS])?;
    if !reader.ends_here() {
        return Err(damaged("there is more of it than a field"));
    }
    let (step, far) = (shape.spacing() / STEPS_PER_CELL, 2.0 * shape.spacing());
    let numbers: Vec<f32> = steps.into_iter().map(|code| (f32::from(code) + 0.5) * step).collect();
    let values =
        BrickValues::between_sides(&stored.active(&shape), &numbers, [[-far], [far]], |at| inside.contains(at));
    drop(numbers);
    let colors: Vec<f32> = colors.as_flattened().iter().map(|&byte| byte_color(byte)).collect();
    let colors = BrickValues::between_sides(&needed.active(&color), &colors, [[0.5; CHANNELS]; 2], |_| false);
    Ok(GridField::of_bricks(values, colors))
}

/// The colour nodes around these nodes of the shape.
fn needed_colors(stored: &NodeSet, shape: &VoxelGrid, color: &VoxelGrid) -> NodeSet {
    let mut needed = NodeSet::new(color);
    for at in stored.iter() {
        let [x, y, z] = color.coordinates(color.locate(shape.position(shape.index(at))).node);
        for corner in 0..8 {
            needed.set([x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2)]);
        }
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
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::field::GridValues;
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

    /// Whatever a field is: what is stored comes back, and is stored the same again.
    #[test]
    fn fields_of_all_kinds_and_sizes_come_back() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        for (nodes, color_nodes) in [(2, 2), (9, 17), (33, 2), (65, 33), (70, 20)] {
            let (grid, color_grid) = (VoxelGrid::new(nodes, 0.55), VoxelGrid::new(color_nodes, 0.55));
            let far = 30.0 * grid.spacing();
            let fields: [&dyn Fn(Vec3, f32) -> f32; 5] = [
                &|_, noise| 8.0 * grid.spacing() * (noise - 0.5),
                &|_, _| far,
                &|_, _| -far,
                // Through the border, and a ball with whole bricks within.
                &|at, _| at.dot(Vec3::new(0.3, 0.8, -0.2)),
                &|at, _| 0.45 - at.length(),
            ];
            for (index, field) in fields.into_iter().enumerate() {
                let values = (0..grid.len()).map(|node| field(grid.position(node), rng.random())).collect();
                let colors = (0..3 * color_grid.len()).map(|_| rng.random()).collect();
                let field =
                    GridField::new(GridValues { grid, values }, GridValues { grid: color_grid, values: colors });
                let bytes = to_bytes(&field).unwrap();
                let read = from_bytes(&bytes).unwrap();
                let name = format!("{nodes} nodes, {color_nodes} of colour, field {index}");
                let (step, [given, found]) =
                    (grid.spacing() / STEPS_PER_CELL, [&field, &read].map(GridField::dense_shape));
                let stored = NodeSet::inside(&grid, field.occupancy()).around_surface();
                for node in 0..grid.len() {
                    let [given, found] = [given.values[node], found.values[node]];
                    assert_eq!(given >= 0.0, found >= 0.0, "{name}");
                    let is_kept =
                        !stored.contains(grid.coordinates(node)) || quantised(given, step) == quantised(found, step);
                    assert!(is_kept, "{name}: {given} {found}");
                }
                let [given, found] = [&field, &read].map(|field| field.dense_color().values);
                for at in needed_colors(&stored, &grid, &color_grid).iter() {
                    let first = 3 * color_grid.index(at);
                    let bytes = |values: &[f32]| [0, 1, 2].map(|c| color_byte(values[first + c]));
                    assert_eq!(bytes(&given), bytes(&found), "{name}");
                }
                assert_eq!(to_bytes(&read).unwrap(), bytes, "{name}");
            }
        }
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
        for at in [CHECKSUM, HEADER, bytes.len() - 1] {
            let mut changed = bytes.clone();
            changed[at] ^= 1;
            assert!(matches!(from_bytes(&changed), Err(GridFormatError::Damaged { .. })), "byte {at}");
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
            let sum = checksum(&claiming);
            claiming[CHECKSUM..HEADER].copy_from_slice(&sum.to_le_bytes());
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
