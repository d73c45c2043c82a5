//! Data elements: what a MAT file, and each of its arrays, is made of. ("MAT-File Level 5 File Format", page 1-9.)

use std::io::Read;

use super::array::MatValues;

/// A problem, in words that go behind the name of the file.
pub(super) type Problem = String;

/// Types of data, by their number in the file.
pub(super) const INT8: u32 = 1;
pub(super) const INT32: u32 = 5;
pub(super) const UINT32: u32 = 6;
pub(super) const MATRIX: u32 = 14;
pub(super) const COMPRESSED: u32 = 15;

/// Bytes per turn where numbers are widened.
const CHUNK: usize = 1 << 16;

/// What stands before each element's data.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tag {
    /// The type of the data.
    pub kind: u32,
    /// Bytes of data, without padding.
    pub length: usize,
    /// The data themselves, where they are so short that they lie within the tag.
    within: Option<[u8; 4]>,
}

/// Elements one after another, little- or big-endian.
pub(super) struct Elements<R> {
    source: R,
    big_endian: bool,
}

impl<R: Read> Elements<R> {
    pub(super) fn new(source: R, big_endian: bool) -> Self {
        Self { source, big_endian }
    }

    /// The next tag.
    pub(super) fn tag(&mut self) -> Result<Tag, Problem> {
        let [first, second] = [self.word()?, self.word()?];
        let number = |word: [u8; 4]| if self.big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) };
        let (kind, length) = (number(first), number(second));
        // Short elements have length and type in one word, and their data in the other.
        if kind >> 16 != 0 {
            let tag = Tag { kind: kind & 0xffff, length: (kind >> 16) as usize, within: Some(second) };
            return if tag.length <= 4 { Ok(tag) } else { Err("a short element is longer than four bytes".to_owned()) };
        }
        Ok(Tag { kind, length: length as usize, within: None })
    }

    /// The data of an element that has at most so many bytes, and the padding behind them.
    pub(super) fn small(&mut self, tag: Tag, most: usize) -> Result<Vec<u8>, Problem> {
        if tag.length > most {
            return Err(format!("an element has {} bytes where at most {most} are expected", tag.length));
        }
        if let Some(within) = tag.within {
            return Ok(within[..tag.length].to_vec());
        }
        let mut data = vec![0; tag.length.next_multiple_of(8)];
        self.source.read_exact(&mut data).map_err(cut_short)?;
        data.truncate(tag.length);
        Ok(data)
    }

    /// Whole numbers of 32 bits, as many as there are, at most `most`.
    pub(super) fn integers(&mut self, kind: u32, most: usize) -> Result<Vec<u32>, Problem> {
        let tag = self.tag()?;
        if tag.kind != kind || !tag.length.is_multiple_of(4) {
            return Err(format!("an element of {} bytes has type {}, expected {kind}", tag.length, tag.kind));
        }
        let data = self.small(tag, 4 * most)?;
        let number = |word: &[u8]| numbers_of::<4>(word, self.big_endian).map(u32::from_le_bytes).next().unwrap_or(0);
        Ok(data.chunks_exact(4).map(number).collect())
    }

    /// The next element's `count` numbers. `check` hears how many bytes they take in memory, before any is read.
    pub(super) fn values<E: From<Problem>>(
        &mut self,
        count: usize,
        check: impl FnOnce(usize) -> Result<(), E>,
    ) -> Result<MatValues, E> {
        let tag = self.tag()?;
        let width = width_of(tag.kind).ok_or_else(|| format!("its data have type {}, which is no number", tag.kind))?;
        let is_byte = tag.kind == 2;
        let (stored, in_memory) = (count.checked_mul(width), count.checked_mul(if is_byte { 1 } else { 8 }));
        let (Some(stored), Some(in_memory)) = (stored, in_memory) else {
            return Err(Problem::from("its dimensions are more than can be counted").into());
        };
        check(in_memory)?;
        if stored != tag.length {
            return Err(format!("{count} elements take {stored} bytes, and there are {}", tag.length).into());
        }
        let within = tag.within.unwrap_or_default();
        let mut data: Box<dyn Read + '_> = match tag.within {
            Some(_) => Box::new(&within[..tag.length]),
            None => Box::new((&mut self.source).take(tag.length as u64)),
        };
        let mut bytes = Vec::new();
        if is_byte {
            data.read_to_end(&mut bytes).map_err(cut_short)?;
            return if bytes.len() == count {
                Ok(MatValues::U8(bytes))
            } else {
                Err(short_of(count, bytes.len()).into())
            };
        }
        let mut values = Vec::new();
        loop {
            bytes.clear();
            (&mut data).take(CHUNK as u64).read_to_end(&mut bytes).map_err(cut_short)?;
            if bytes.is_empty() {
                break;
            }
            widen(tag.kind, &bytes, self.big_endian, &mut values);
        }
        if values.len() == count { Ok(MatValues::F64(values)) } else { Err(short_of(count, values.len()).into()) }
    }

    /// Reads what is left, which can be no more than padding. Where the source has a checksum, it is compared at its end.
    pub(super) fn finish(mut self) -> Result<(), Problem> {
        std::io::copy(&mut (&mut self.source).take(64), &mut std::io::sink()).map_err(cut_short)?;
        Ok(())
    }

    fn word(&mut self) -> Result<[u8; 4], Problem> {
        let mut word = [0; 4];
        self.source.read_exact(&mut word).map_err(cut_short)?;
        Ok(word)
    }
}

fn cut_short(error: std::io::Error) -> Problem {
    match error.kind() {
        std::io::ErrorKind::UnexpectedEof => "it ends early".to_owned(),
        _ => format!("it is damaged: {error}"),
    }
}

fn short_of(count: usize, found: usize) -> Problem {
    format!("it ends early: {found} of {count} elements are there")
}

/// Bytes of a number of a type.
fn width_of(kind: u32) -> Option<usize> {
    match kind {
        1 | 2 => Some(1),
        3 | 4 => Some(2),
        5..=7 => Some(4),
        9 | 12 | 13 => Some(8),
        _ => None,
    }
}

/// Numbers of `N` bytes, the least significant first; what is left over at the end is left out.
fn numbers_of<const N: usize>(bytes: &[u8], big_endian: bool) -> impl Iterator<Item = [u8; N]> + '_ {
    bytes.chunks_exact(N).map(move |chunk| {
        let mut number = [0; N];
        number.copy_from_slice(chunk);
        if big_endian {
            number.reverse();
        }
        number
    })
}

/// Appends numbers of a type in double precision.
fn widen(kind: u32, bytes: &[u8], big: bool, values: &mut Vec<f64>) {
    match kind {
        1 => values.extend(bytes.iter().map(|&byte| f64::from(byte as i8))),
        2 => values.extend(bytes.iter().map(|&byte| f64::from(byte))),
        3 => values.extend(numbers_of(bytes, big).map(|n| f64::from(i16::from_le_bytes(n)))),
        4 => values.extend(numbers_of(bytes, big).map(|n| f64::from(u16::from_le_bytes(n)))),
        5 => values.extend(numbers_of(bytes, big).map(|n| f64::from(i32::from_le_bytes(n)))),
        6 => values.extend(numbers_of(bytes, big).map(|n| f64::from(u32::from_le_bytes(n)))),
        7 => values.extend(numbers_of(bytes, big).map(|n| f64::from(f32::from_le_bytes(n)))),
        9 => values.extend(numbers_of(bytes, big).map(f64::from_le_bytes)),
        12 => values.extend(numbers_of(bytes, big).map(|n| i64::from_le_bytes(n) as f64)),
        _ => values.extend(numbers_of(bytes, big).map(|n| u64::from_le_bytes(n) as f64)),
    }
}
