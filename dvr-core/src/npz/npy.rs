//! One `.npy` file in memory: an array with its header.

use std::io::{Cursor, Write};

use npyz::{Deserialize, NpyFile, Order, WriterBuilder};

use super::array::{Array, Values};

/// One `.npy` file in memory; the error is what is wrong with it.
pub(super) fn parse_npy(bytes: &[u8]) -> std::result::Result<Array, String> {
    if !shape_is_sane(bytes) {
        return Err("its shape is not possible".to_owned());
    }
    let mut rest = Cursor::new(bytes);
    let header = npyz::NpyHeader::from_reader(&mut rest).map_err(|error| error.to_string())?;
    let npyz::DType::Plain(dtype) = header.dtype() else {
        return Err("it holds records, not numbers".to_owned());
    };
    let shape = header.shape().iter().map(|&n| usize::try_from(n)).collect::<std::result::Result<Vec<_>, _>>();
    let shape = shape.map_err(|error| error.to_string())?;
    let size = dtype.num_bytes().ok_or("its elements have no fixed size")?;
    // A damaged shape must not decide how much memory is asked for.
    let expected = shape.iter().try_fold(size, |n, &length| n.checked_mul(length));
    let found = bytes.len() - rest.position() as usize;
    if expected.is_none_or(|expected| expected > found) {
        return Err(format!("shape {shape:?} of {size} bytes per element, but only {found} bytes of data"));
    }
    let order = header.order();
    let npy = NpyFile::with_header(header, rest);
    let values = match (dtype.type_char(), dtype.size_field()) {
        (npyz::TypeChar::Float, 2) => Values::F32(elements(npy, half::f16::to_f32)?),
        (npyz::TypeChar::Float, 4) => Values::F32(elements(npy, |x: f32| x)?),
        (npyz::TypeChar::Float, 8) => Values::F64(elements(npy, |x: f64| x)?),
        (npyz::TypeChar::Int, 1) => Values::I32(elements(npy, |x: i8| i32::from(x))?),
        (npyz::TypeChar::Int, 2) => Values::I32(elements(npy, |x: i16| i32::from(x))?),
        (npyz::TypeChar::Int, 4) => Values::I32(elements(npy, |x: i32| x)?),
        (npyz::TypeChar::Int, 8) => Values::I64(elements(npy, |x: i64| x)?),
        (npyz::TypeChar::Uint, 1) => Values::U8(elements(npy, |x: u8| x)?),
        (npyz::TypeChar::Uint, 2) => Values::I32(elements(npy, |x: u16| i32::from(x))?),
        (npyz::TypeChar::Uint, 4) => Values::I64(elements(npy, |x: u32| i64::from(x))?),
        (npyz::TypeChar::Uint, 8) => Values::I64(elements(npy, |x: u64| i64::try_from(x).unwrap_or(i64::MAX))?),
        (npyz::TypeChar::Bool, _) => Values::Bool(elements(npy, |x: bool| x)?),
        _ => return Err(format!("its dtype {dtype} is not a number")),
    };
    let values = if order == Order::Fortran { in_c_order(values, &shape) } else { values };
    Ok(Array { shape, values })
}

/// Whether the lengths in a `.npy` header can be multiplied: npyz does so without looking.
fn shape_is_sane(bytes: &[u8]) -> bool {
    let header = bytes.split(|&b| b == b'\n').next().map(String::from_utf8_lossy).unwrap_or_default();
    let shape = header.split_once("'shape'").and_then(|(_, rest)| rest.split_once('(')?.1.split_once(')'));
    let Some((lengths, _)) = shape else { return true };
    let lengths = lengths.split(',').filter_map(|length| length.trim().parse::<u64>().ok());
    lengths.map(|length| length.max(1)).try_fold(16u64, u64::checked_mul).is_some()
}

fn elements<T: Deserialize, U>(
    npy: NpyFile<Cursor<&[u8]>>,
    convert: impl Fn(T) -> U,
) -> std::result::Result<Vec<U>, String> {
    let reader = npy.data::<T>().map_err(|error| error.to_string())?;
    reader.map(|x| x.map(&convert)).collect::<std::io::Result<_>>().map_err(|error| error.to_string())
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
