//! The file: a header, and an array per element.

use std::io::Read;
use std::path::Path;

use flate2::read::ZlibDecoder;

use super::array::MatArray;
use super::element::{COMPRESSED, Elements, INT8, INT32, MATRIX, Problem, UINT32};
use crate::error::{Error, Result};
use crate::files::limits::{ARRAY_BYTES, check_limit};
use crate::files::{read_bytes, shortened};

/// Bytes before the first element.
const HEADER_BYTES: usize = 128;

/// Bytes of an array's name; MATLAB's have 63 at most.
const NAME_BYTES: usize = 256;

/// Axes of an array.
const AXES: usize = 32;

/// Classes of arrays that hold numbers, from `double` to `uint64`.
const NUMBERS: std::ops::RangeInclusive<u32> = 6..=15;

/// The class of MATLAB's newer objects, whose elements are in another order.
const OPAQUE: u32 = 17;

/// Flag of an array with an imaginary part.
const COMPLEX: u32 = 0x0800;

const REMEDY: &str = "Copy the file again, or save it anew with `save -v7`.";

/// Reads the arrays of these names, in that order. Others are passed over and not inflated.
///
/// # Errors
/// [`Error::Io`] where the file cannot be read; [`Error::Format`] where it is no MAT file of level 5, an array is
/// missing (the error lists those there are), damaged, complex, or holds no numbers; [`Error::TooLarge`] where one has
/// more than [`ARRAY_BYTES`] in memory.
pub fn read_mat(path: &Path, names: &[&str]) -> Result<Vec<MatArray>> {
    let bytes = read_bytes(path)?;
    let big_endian = check_header(path, &bytes)?;
    let mut found: Vec<Option<MatArray>> = names.iter().map(|_| None).collect();
    let mut others = Vec::new();
    let mut rest = &bytes[HEADER_BYTES..];
    while !rest.is_empty() {
        let mut elements = Elements::new(rest, big_endian);
        let unsound = |problem: Problem| Error::format(path, format!("an element cannot be read: {problem}"), REMEDY);
        let tag = elements.tag().map_err(unsound)?;
        let Some(data) = rest[8..].get(..tag.length) else { return Err(unsound("it ends early".to_owned())) };
        rest = &rest[8 + tag.length..];
        let reader = Reader { path, names };
        let array = match tag.kind {
            COMPRESSED => {
                let mut inflated = Elements::new(ZlibDecoder::new(data), big_endian);
                match inflated.tag().map_err(unsound)?.kind {
                    MATRIX => reader.array(inflated)?,
                    _ => Entry::Other(None),
                }
            }
            MATRIX => reader.array(Elements::new(data, big_endian))?,
            _ => Entry::Other(None),
        };
        match array {
            Entry::Wanted(index, array) => found[index] = Some(array),
            Entry::Other(name) => others.extend(name),
        }
        if found.iter().all(Option::is_some) {
            break;
        }
    }
    let missing = |name: &str| {
        let there = shortened(&others.join(", "));
        let remedy = "Check that this is the file that was meant.";
        Error::format(path, format!("there is no array `{name}`; there is: {there}"), remedy)
    };
    found.into_iter().zip(names).map(|(array, name)| array.ok_or_else(|| missing(name))).collect()
}

/// Whether the file's numbers have their most significant byte first.
fn check_header(path: &Path, bytes: &[u8]) -> Result<bool> {
    let not_level_5 = |problem: &str| Error::format(path, problem, "Save it with MATLAB's `save -v7`.");
    let Some(header) = bytes.get(..HEADER_BYTES) else {
        return Err(not_level_5("this is not a MAT file: its header is cut short"));
    };
    if header.starts_with(b"MATLAB 7.3") {
        return Err(not_level_5("this is a MAT file of version 7.3 (HDF5), which is not read"));
    }
    match &header[124..] {
        [0x00, 0x01, b'I', b'M'] => Ok(false),
        [0x01, 0x00, b'M', b'I'] => Ok(true),
        _ => Err(not_level_5("this is not a MAT file of level 5")),
    }
}

/// An array of the file.
enum Entry {
    /// One that was asked for, and which.
    Wanted(usize, MatArray),
    /// Another, with its name where it has one.
    Other(Option<String>),
}

/// A problem of an array, or one that already knows its file.
enum Fault {
    Problem(Problem),
    Whole(Error),
}

impl From<Problem> for Fault {
    fn from(problem: Problem) -> Self {
        Self::Problem(problem)
    }
}

struct Reader<'a> {
    path: &'a Path,
    names: &'a [&'a str],
}

impl Reader<'_> {
    /// An array from its sub-elements: flags, dimensions, name, and its numbers.
    fn array<R: Read>(&self, mut elements: Elements<R>) -> Result<Entry> {
        let unsound = |problem: Problem| Error::format(self.path, format!("an array is damaged: {problem}"), REMEDY);
        let flags = elements.integers(UINT32, 2).map_err(unsound)?;
        let flags = flags.first().copied().unwrap_or(0);
        let class = flags & 0xff;
        if class == OPAQUE {
            return Ok(Entry::Other(None));
        }
        let shape: Vec<usize> =
            elements.integers(INT32, AXES).map_err(unsound)?.into_iter().map(|length| length as usize).collect();
        let tag = elements.tag().map_err(unsound)?;
        if tag.kind != INT8 {
            return Err(unsound(format!("its name has type {}, expected {INT8}", tag.kind)));
        }
        let name = String::from_utf8_lossy(&elements.small(tag, NAME_BYTES).map_err(unsound)?).into_owned();
        let Some(index) = self.names.iter().position(|wanted| *wanted == name) else {
            return Ok(Entry::Other(Some(name)));
        };
        let wrong = |problem: &str| Error::format(self.path, format!("array `{name}` {problem}"), REMEDY);
        if !NUMBERS.contains(&class) {
            return Err(wrong(&format!("is of class {class}, expected numbers")));
        }
        if flags & COMPLEX != 0 {
            return Err(wrong("is complex, expected real numbers"));
        }
        let count = shape.iter().try_fold(1usize, |product, &length| product.checked_mul(length));
        let count = count.ok_or_else(|| wrong(&format!("has dimensions {shape:?}, more than can be counted")))?;
        let what = format!("the size of array `{name}` in bytes");
        let check = |bytes: usize| check_limit(self.path, &what, bytes as u64, ARRAY_BYTES).map_err(Fault::Whole);
        let damaged = |problem: Problem| wrong(&format!("cannot be read: {problem}"));
        let values = elements.values(count, check).map_err(|fault| match fault {
            Fault::Problem(problem) => damaged(problem),
            Fault::Whole(error) => error,
        })?;
        elements.finish().map_err(damaged)?;
        Ok(Entry::Wanted(index, MatArray { shape, values }))
    }
}
