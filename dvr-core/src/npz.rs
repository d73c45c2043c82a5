//! NumPy's `.npz` archives: named arrays, read whatever their dtype, written compressed.
//!
//! The format: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>.

use std::fs::File;
use std::io::{BufReader, Cursor, Read, Write};
use std::path::{Path, PathBuf};

use npyz::{Deserialize, NpyFile, Order, WriterBuilder};
use zip::ZipArchive;
use zip::write::SimpleFileOptions;

use crate::error::{Error, Result};
use crate::files::write_bytes_atomically;

const REMEDY: &str = "The file may be truncated: copy it again, or write it anew with numpy.savez.";

/// The elements of an array. Smaller integers are widened, half precision to single.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// `float32`, and `float16`.
    F32(Vec<f32>),
    /// `float64`.
    F64(Vec<f64>),
    /// `int32`, `int16`, `int8`, `uint16`.
    I32(Vec<i32>),
    /// `int64`, `uint32`, `uint64`.
    I64(Vec<i64>),
    /// `uint8`.
    U8(Vec<u8>),
    /// `bool`.
    Bool(Vec<bool>),
}

/// An array of an `.npz` file: a shape, and its elements in C order (the last index runs fastest).
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length along each axis; empty for a scalar.
    pub shape: Vec<usize>,
    /// The elements, as many as the product of `shape`.
    pub values: Values,
}

macro_rules! convert {
    ($values:expr, $to:ty) => {
        match $values {
            Values::F32(v) => v.iter().map(|&x| x as $to).collect(),
            Values::F64(v) => v.iter().map(|&x| x as $to).collect(),
            Values::I32(v) => v.iter().map(|&x| x as $to).collect(),
            Values::I64(v) => v.iter().map(|&x| x as $to).collect(),
            Values::U8(v) => v.iter().map(|&x| x as $to).collect(),
            Values::Bool(v) => v.iter().map(|&x| u8::from(x) as $to).collect(),
        }
    };
}

impl Array {
    /// An array in single precision.
    pub fn f32(shape: &[usize], values: Vec<f32>) -> Self {
        Self { shape: shape.to_vec(), values: Values::F32(values) }
    }

    /// An array in double precision.
    pub fn f64(shape: &[usize], values: Vec<f64>) -> Self {
        Self { shape: shape.to_vec(), values: Values::F64(values) }
    }

    /// How many elements there are.
    pub fn len(&self) -> usize {
        match &self.values {
            Values::F32(v) => v.len(),
            Values::F64(v) => v.len(),
            Values::I32(v) => v.len(),
            Values::I64(v) => v.len(),
            Values::U8(v) => v.len(),
            Values::Bool(v) => v.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The elements in single precision.
    pub fn to_f32(&self) -> Vec<f32> {
        convert!(&self.values, f32)
    }

    /// The elements in double precision, exact but for the largest integers.
    pub fn to_f64(&self) -> Vec<f64> {
        convert!(&self.values, f64)
    }

    /// The elements as integers; fractions are cut off.
    pub fn to_i64(&self) -> Vec<i64> {
        convert!(&self.values, i64)
    }

    /// Which elements are greater than zero.
    pub fn to_bool(&self) -> Vec<bool> {
        self.to_f32().into_iter().map(|x| x > 0.0).collect()
    }

    /// One truth value an item, from booleans, numbers, or bytes of eight bits each (`numpy.packbits`, as the
    /// occupancies of the ShapeNet datasets are stored). `None` where the array has neither length.
    pub fn to_bool_of_length(&self, length: usize) -> Option<Vec<bool>> {
        if self.len() == length {
            return Some(self.to_bool());
        }
        match &self.values {
            Values::U8(bytes) if bytes.len() == length.div_ceil(8) => {
                Some((0..length).map(|i| bytes[i / 8] >> (7 - i % 8) & 1 == 1).collect())
            }
            _ => None,
        }
    }
}

/// An `.npz` file that is open for reading.
pub struct NpzFile {
    path: PathBuf,
    archive: ZipArchive<BufReader<File>>,
    names: Vec<String>,
}

impl NpzFile {
    /// Opens the archive and reads its table of contents.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be opened, [`Error::Format`] where it is not a whole archive.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|source| Error::io(path, source))?;
        let archive = ZipArchive::new(BufReader::new(file))
            .map_err(|error| Error::format(path, format!("this is not a whole .npz archive ({error})"), REMEDY))?;
        let names = archive
            .file_names()
            .filter_map(|name| Some(npyz::npz::array_name_from_file_name(&name.ok()?)?.to_owned()))
            .collect();
        Ok(Self { path: path.to_owned(), archive, names })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Names of the arrays, in the order of the file.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Whether there is an array of that name.
    pub fn contains(&self, name: &str) -> bool {
        self.names.iter().any(|n| n == name)
    }

    /// Reads an array.
    ///
    /// # Errors
    /// [`Error::Format`] where there is no such array (the error lists those there are), its data are damaged or end
    /// early, or its dtype is not a number.
    pub fn read(&mut self, name: &str) -> Result<Array> {
        if !self.contains(name) {
            let mut names = self.names.join(", ");
            if let Some((cut, _)) = names.char_indices().nth(200) {
                names.truncate(cut);
                names.push_str(" ...");
            }
            return Err(Error::format(
                &self.path,
                format!("there is no array `{name}`; there is: {names}"),
                "Check that this is the file that was meant.",
            ));
        }
        let wrong = |what: String| Error::format(&self.path, format!("array `{name}` cannot be read ({what})"), REMEDY);
        let mut entry = self
            .archive
            .by_name(&npyz::npz::file_name_from_array_name(name))
            .map_err(|error| wrong(error.to_string()))?;
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).map_err(|error| wrong(error.to_string()))?;
        parse_npy(&bytes).map_err(wrong)
    }
}

/// One `.npy` file in memory; the error is what is wrong with it.
fn parse_npy(bytes: &[u8]) -> std::result::Result<Array, String> {
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
        return Err(format!("shape {shape:?} of {size} bytes an element, but only {found} bytes of data"));
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

/// Writes named arrays to a compressed archive, as `numpy.savez_compressed` does.
///
/// The file holds no time of writing: the same arrays give the same bytes.
///
/// # Errors
/// [`Error::Io`] where the file cannot be written; [`Error::Format`] where an array's shape and its number of elements
/// disagree.
pub fn write_npz(path: &Path, arrays: &[(&str, &Array)]) -> Result<()> {
    for (name, array) in arrays {
        if array.shape.iter().product::<usize>() != array.len() {
            return Err(Error::format(
                path,
                format!("array `{name}` has shape {:?} but {} elements", array.shape, array.len()),
                "Give as many elements as the shape says.",
            ));
        }
    }
    let bytes = encode(arrays).map_err(|source| Error::io(path, source))?;
    write_bytes_atomically(path, &bytes)
}

fn encode(arrays: &[(&str, &Array)]) -> std::io::Result<Vec<u8>> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().last_modified_time(zip::DateTime::default());
    for (name, array) in arrays {
        zip.start_file(npyz::npz::file_name_from_array_name(name), options.large_file(array.len() > 1 << 28))?;
        match &array.values {
            Values::F32(v) => write_npy(&mut zip, &array.shape, v)?,
            Values::F64(v) => write_npy(&mut zip, &array.shape, v)?,
            Values::I32(v) => write_npy(&mut zip, &array.shape, v)?,
            Values::I64(v) => write_npy(&mut zip, &array.shape, v)?,
            Values::U8(v) => write_npy(&mut zip, &array.shape, v)?,
            Values::Bool(v) => write_npy(&mut zip, &array.shape, v)?,
        }
    }
    Ok(zip.finish()?.into_inner())
}

fn write_npy<T: npyz::AutoSerialize + Copy>(
    out: &mut impl Write,
    shape: &[usize],
    values: &[T],
) -> std::io::Result<()> {
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(out).begin_nd()?;
    writer.extend(values.iter().copied())?;
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        (folder, path)
    }

    /// A `.npy` file as NumPy writes it (format version 1.0).
    fn npy(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
        let fortran = if fortran { "True" } else { "False" };
        let mut dict = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
        while (dict.len() + 11) % 64 != 0 {
            dict.push(' ');
        }
        dict.push('\n');
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((dict.len() as u16).to_le_bytes());
        bytes.extend(dict.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn arrays_of_every_kind_come_back() {
        let (_folder, path) = folder();
        let arrays = [
            ("f32", Array::f32(&[2, 3], vec![0.5, -1.0, f32::INFINITY, 3.0, 4.0, 5.0])),
            ("f64", Array::f64(&[], vec![1e-300])),
            ("i32", Array { shape: vec![2], values: Values::I32(vec![-7, 8]) }),
            ("i64", Array { shape: vec![1], values: Values::I64(vec![1 << 40]) }),
            ("u8", Array { shape: vec![3], values: Values::U8(vec![0, 128, 255]) }),
            ("bool", Array { shape: vec![3, 1], values: Values::Bool(vec![true, false, true]) }),
            ("empty", Array::f32(&[0, 3], vec![])),
        ];
        let borrowed: Vec<_> = arrays.iter().map(|(name, array)| (*name, array)).collect();
        write_npz(&path, &borrowed).unwrap();
        let mut npz = NpzFile::open(&path).unwrap();
        assert_eq!(npz.names(), arrays.each_ref().map(|(name, _)| *name));
        for (name, array) in &arrays {
            assert_eq!(&npz.read(name).unwrap(), array, "{name}");
        }
        let first = std::fs::read(&path).unwrap();
        write_npz(&path, &borrowed).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), first, "the same arrays give the same bytes");
    }

    #[test]
    fn columns_first_and_big_endian_are_put_in_order() {
        let data: Vec<u8> = [1.0f32, 4.0, 2.0, 5.0, 3.0, 6.0].iter().flat_map(|x| x.to_be_bytes()).collect();
        let array = parse_npy(&npy(">f4", true, "(2, 3)", &data)).unwrap();
        assert_eq!(array, Array::f32(&[2, 3], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
    }

    #[test]
    fn small_types_are_widened() {
        assert_eq!(parse_npy(&npy("<f2", false, "(1,)", &[0, 0x3c])).unwrap().to_f32(), [1.0]);
        assert_eq!(parse_npy(&npy("|i1", false, "(1,)", &[0xff])).unwrap().to_i64(), [-1]);
        assert_eq!(parse_npy(&npy("<u2", false, "(1,)", &[0xff, 0xff])).unwrap().to_f64(), [65535.0]);
    }

    #[test]
    fn packed_bits_are_unpacked_where_the_length_says_so() {
        let packed = Array { shape: vec![2], values: Values::U8(vec![0b1010_0000, 0b0100_0000]) };
        let expected: Vec<bool> = (0..10).map(|i| [0, 2, 9].contains(&i)).collect();
        assert_eq!(packed.to_bool_of_length(10), Some(expected));
        assert_eq!(packed.to_bool_of_length(2), Some(vec![true, true]));
        assert_eq!(packed.to_bool_of_length(17), None);
    }

    #[test]
    fn a_shape_that_promises_more_than_the_file_holds_is_refused() {
        for shape in ["(4,)", "(99999999999, 99999999999)", "(18446744073709551615,)", "(0, 18446744073709551615, 9)"] {
            assert!(parse_npy(&npy("<f4", false, shape, &[0; 12])).is_err(), "{shape}");
        }
        assert!(parse_npy(&npy("|O", false, "(1,)", &[0; 8])).is_err(), "pickled objects");
        assert!(parse_npy(b"\x93NUMPY\x01\x00\xff\xffx").is_err());
    }

    #[test]
    fn a_truncated_archive_and_a_missing_array_are_named() {
        let (_folder, path) = folder();
        let array = Array::f32(&[50], (0..50).map(|i| i as f32).collect());
        write_npz(&path, &[("points", &array)]).unwrap();
        let missing = NpzFile::open(&path).unwrap().read("normals").unwrap_err().to_string();
        assert!(missing.contains("a.npz: there is no array `normals`; there is: points"), "{missing}");
        let bytes = std::fs::read(&path).unwrap();
        for length in 0..bytes.len() {
            std::fs::write(&path, &bytes[..length]).unwrap();
            let result = NpzFile::open(&path).and_then(|mut npz| npz.read("points"));
            assert!(matches!(result, Err(Error::Format { .. })), "{length} of {} bytes", bytes.len());
        }
        for index in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[index] ^= 0xff;
            std::fs::write(&path, &damaged).unwrap();
            // Damage may hit a byte that means nothing; it must never give other values.
            if let Ok(read) = NpzFile::open(&path).and_then(|mut npz| npz.read("points")) {
                assert_eq!(read, array, "byte {index}");
            }
        }
    }

    #[test]
    fn a_shape_that_does_not_fit_is_not_written() {
        let (_folder, path) = folder();
        assert!(write_npz(&path, &[("a", &Array::f32(&[3], vec![0.0]))]).is_err());
        assert!(!path.exists());
    }
}
