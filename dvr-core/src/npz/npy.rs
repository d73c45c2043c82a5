//! A `.npy` file: an array with its header.

use std::io::{Read, Write};
use std::path::Path;

use npyz::{Deserialize, NpyFile, Order, WriterBuilder};

use super::array::{Array, Values};
use crate::error::Error;
use crate::files::limits::{ARRAY_BYTES, NPY_HEADER_BYTES};
use crate::files::{check_limit, read_bytes};

/// Bytes before the header from version 2.0 on: magic, version and the header's length. Version 1.0 has two less.
const PREFIX: usize = 12;

/// Brackets in brackets of a header. An array of numbers has two; npyz takes time by the power of their number.
const MOST_NESTED: usize = 4;

/// Reads a file of one array.
///
/// # Errors
/// [`Error::Io`] where the file cannot be opened, [`Error::Format`] where it is damaged or ends early, or its dtype is not a
/// number; [`Error::TooLarge`] where the array has more than [`ARRAY_BYTES`].
pub fn read_npy(path: &Path) -> crate::Result<Array> {
    let bytes = read_bytes(path)?;
    let wrong = |what: String| {
        let remedy = "The file may be truncated: copy it again, or write it anew with numpy.save.";
        Error::format(path, format!("its array cannot be read ({what})"), remedy)
    };
    let mut reader = bytes.as_slice();
    let head = NpyHead::read(&mut reader).map_err(wrong)?;
    check_limit(path, "the size of its array in bytes", head.bytes_in_memory(), ARRAY_BYTES)?;
    let most = reader.len() as u64;
    head.read_values(&mut reader, most).map_err(wrong)
}

/// What a `.npy` file says of its array.
pub(super) struct NpyHead {
    header: npyz::NpyHeader,
    dtype: npyz::TypeStr,
    shape: Vec<usize>,
    /// Bytes of an element in the file.
    size: usize,
    count: usize,
}

impl NpyHead {
    /// Reads the header; the error is what is wrong with it.
    pub(super) fn read(reader: &mut impl Read) -> Result<Self, String> {
        let text = header_bytes(reader)?;
        check_header(&text)?;
        let header = npyz::NpyHeader::from_reader(text.as_slice()).map_err(|error| error.to_string())?;
        let npyz::DType::Plain(dtype) = header.dtype() else {
            return Err("it holds records, not numbers".to_owned());
        };
        let shape = header.shape().iter().map(|&n| usize::try_from(n)).collect::<Result<Vec<_>, _>>();
        let shape = shape.map_err(|error| error.to_string())?;
        let size = dtype.num_bytes().ok_or("its elements have no fixed size")?;
        let count = shape.iter().try_fold(1usize, |n, &length| n.checked_mul(length));
        let count = count.ok_or_else(|| format!("its shape {shape:?} is not possible"))?;
        Ok(Self { header, dtype, shape, size, count })
    }

    /// Bytes of the array as [`Values`] hold it.
    pub(super) fn bytes_in_memory(&self) -> u64 {
        let size = match (self.dtype.type_char(), self.size) {
            (npyz::TypeChar::Float | npyz::TypeChar::Int, size) => size.max(4),
            (npyz::TypeChar::Uint, 2) => 4,
            (npyz::TypeChar::Uint, 4) => 8,
            (_, size) => size.max(1),
        };
        (self.count as u64).saturating_mul(size as u64)
    }

    /// Reads the elements, of which there may be `most` bytes; the error is what is wrong with them.
    pub(super) fn read_values(self, reader: &mut impl Read, most: u64) -> Result<Array, String> {
        let Self { header, dtype, shape, size, count } = self;
        // A damaged shape must not decide how much memory is asked for.
        if (count as u64).checked_mul(size as u64).is_none_or(|bytes| bytes > most) {
            return Err(format!("shape {shape:?} of {size} bytes per element, but less than {most} bytes of data"));
        }
        let order = header.order();
        let npy = NpyFile::with_header(header, reader);
        let values = match (dtype.type_char(), dtype.size_field()) {
            (npyz::TypeChar::Float, 2) => Values::F32(elements(npy, count, half::f16::to_f32)?),
            (npyz::TypeChar::Float, 4) => Values::F32(elements(npy, count, |x: f32| x)?),
            (npyz::TypeChar::Float, 8) => Values::F64(elements(npy, count, |x: f64| x)?),
            (npyz::TypeChar::Int, 1) => Values::I32(elements(npy, count, |x: i8| i32::from(x))?),
            (npyz::TypeChar::Int, 2) => Values::I32(elements(npy, count, |x: i16| i32::from(x))?),
            (npyz::TypeChar::Int, 4) => Values::I32(elements(npy, count, |x: i32| x)?),
            (npyz::TypeChar::Int, 8) => Values::I64(elements(npy, count, |x: i64| x)?),
            (npyz::TypeChar::Uint, 1) => Values::U8(elements(npy, count, |x: u8| x)?),
            (npyz::TypeChar::Uint, 2) => Values::I32(elements(npy, count, |x: u16| i32::from(x))?),
            (npyz::TypeChar::Uint, 4) => Values::I64(elements(npy, count, |x: u32| i64::from(x))?),
            (npyz::TypeChar::Uint, 8) => {
                Values::I64(elements(npy, count, |x: u64| i64::try_from(x).unwrap_or(i64::MAX))?)
            }
            (npyz::TypeChar::Bool, _) => Values::Bool(elements(npy, count, |x: bool| x)?),
            _ => return Err(format!("its dtype {dtype} is not a number")),
        };
        let values = if order == Order::Fortran { in_c_order(values, &shape) } else { values };
        Ok(Array { shape, values })
    }
}

/// Magic, version, length and header, as they stand in the file.
fn header_bytes(reader: &mut impl Read) -> Result<Vec<u8>, String> {
    let early = |_| "it ends in its header".to_owned();
    let mut bytes = vec![0; PREFIX - 2];
    reader.read_exact(&mut bytes).map_err(early)?;
    let length = if bytes[6] == 1 {
        u64::from(u16::from_le_bytes([bytes[8], bytes[9]]))
    } else {
        bytes.resize(PREFIX, 0);
        reader.read_exact(&mut bytes[PREFIX - 2..]).map_err(early)?;
        u64::from(u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]))
    };
    if length > NPY_HEADER_BYTES {
        return Err(format!("its header has {length} bytes, and at most {NPY_HEADER_BYTES} are read"));
    }
    let start = bytes.len();
    bytes.resize(start + length as usize, 0);
    reader.read_exact(&mut bytes[start..]).map_err(early)?;
    Ok(bytes)
}

/// Refuses a header that npyz would take too long for, or whose lengths it would multiply past the largest number.
fn check_header(header: &[u8]) -> Result<(), String> {
    let mut depth = 0usize;
    for byte in header {
        match byte {
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > MOST_NESTED {
            return Err(format!("its header has more than {MOST_NESTED} brackets in each other"));
        }
    }
    let text = String::from_utf8_lossy(header);
    let numbers = text.split(|c: char| !c.is_ascii_digit()).filter(|number| !number.is_empty());
    let lengths = numbers.map(|number| number.parse::<u64>().ok());
    // The size of an element is among the numbers.
    let product =
        lengths.map(|length| length.map(|length| length.max(1))).try_fold(1u64, |n, length| n.checked_mul(length?));
    product.map(|_| ()).ok_or_else(|| "its shape is not possible".to_owned())
}

fn elements<T: Deserialize, U>(
    npy: NpyFile<impl Read>,
    count: usize,
    convert: impl Fn(T) -> U,
) -> Result<Vec<U>, String> {
    let reader = npy.data::<T>().map_err(|error| error.to_string())?;
    let mut values = Vec::with_capacity(count);
    for value in reader {
        values.push(convert(value.map_err(|error| error.to_string())?));
    }
    Ok(values)
}

fn in_c_order(values: Values, shape: &[usize]) -> Values {
    fn reorder<T: Copy>(values: &[T], shape: &[usize]) -> Vec<T> {
        let strides: Vec<usize> =
            shape.iter().scan(1, |product, &length| Some(std::mem::replace(product, *product * length))).collect();
        let mut index = vec![0; shape.len()];
        let mut result = Vec::with_capacity(values.len());
        for _ in 0..values.len() {
            result.push(values[index.iter().zip(&strides).map(|(i, stride)| i * stride).sum::<usize>()]);
            for axis in (0..shape.len()).rev() {
                index[axis] += 1;
                if index[axis] < shape[axis] {
                    break;
                }
                index[axis] = 0;
            }
        }
        result
    }
    match values {
        Values::F32(v) => Values::F32(reorder(&v, shape)),
        Values::F64(v) => Values::F64(reorder(&v, shape)),
        Values::I32(v) => Values::I32(reorder(&v, shape)),
        Values::I64(v) => Values::I64(reorder(&v, shape)),
        Values::U8(v) => Values::U8(reorder(&v, shape)),
        Values::Bool(v) => Values::Bool(reorder(&v, shape)),
    }
}

/// Writes an array of one dtype.
pub(super) fn write_npy<T: npyz::AutoSerialize + Copy>(
    out: &mut impl Write,
    shape: &[usize],
    values: &[T],
) -> std::io::Result<()> {
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(out).begin_nd()?;
    writer.extend(values.iter().copied())?;
    writer.finish()
}
