//! What an EXIF block says of the camera: which pictures have the same lens at the same focal length.
//!
//! The block is a TIFF file (TIFF 6.0, section 2) with the tags of EXIF 2.32, table 4.

/// Tags.
const MODEL: u16 = 0x0110;
const EXIF_DIRECTORY: u16 = 0x8769;
const FOCAL_LENGTH: u16 = 0x920a;

/// Types of values.
const ASCII: u16 = 2;
const LONG: u16 = 4;
const RATIONAL: u16 = 5;

/// The camera's model and its focal length in millimetres, as far as a block has them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct CameraTags {
    pub model: String,
    pub focal_length: Option<f64>,
}

/// Reads a block; what is damaged in it is left out.
pub(crate) fn camera_tags(block: &[u8]) -> CameraTags {
    let Some(tiff) = Tiff::new(block) else { return CameraTags::default() };
    let first = tiff.long(4);
    let model = first.and_then(|at| tiff.find(at, MODEL, ASCII)).and_then(|entry| tiff.text(entry));
    let exif = first.and_then(|at| tiff.find(at, EXIF_DIRECTORY, LONG)).and_then(|entry| tiff.long(entry + 8));
    let focal = exif.and_then(|at| tiff.find(at, FOCAL_LENGTH, RATIONAL)).and_then(|entry| tiff.ratio(entry));
    CameraTags { model: model.unwrap_or_default(), focal_length: focal }
}

/// A block and the order of its bytes. Every access is checked.
struct Tiff<'a> {
    block: &'a [u8],
    little: bool,
}

impl<'a> Tiff<'a> {
    fn new(block: &'a [u8]) -> Option<Self> {
        let little = match block.get(..2)? {
            b"II" => true,
            b"MM" => false,
            _ => return None,
        };
        Some(Self { block, little })
    }

    fn short(&self, at: usize) -> Option<u16> {
        let bytes = self.block.get(at..at.checked_add(2)?)?.try_into().ok()?;
        Some(if self.little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
    }

    fn long(&self, at: usize) -> Option<usize> {
        let bytes = self.block.get(at..at.checked_add(4)?)?.try_into().ok()?;
        let value = if self.little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) };
        usize::try_from(value).ok()
    }

    /// Where the entry of a tag begins, in the directory at `directory`.
    fn find(&self, directory: usize, tag: u16, kind: u16) -> Option<usize> {
        let count = usize::from(self.short(directory)?);
        let mut entries = (0..count).map(|i| directory + 2 + 12 * i);
        entries.find(|&at| self.short(at) == Some(tag) && self.short(at + 2) == Some(kind))
    }

    fn text(&self, entry: usize) -> Option<String> {
        let length = self.long(entry + 4)?;
        // Up to four bytes stand in the entry itself.
        let at = if length <= 4 { entry + 8 } else { self.long(entry + 8)? };
        let text = self.block.get(at..at.checked_add(length)?)?;
        Some(String::from_utf8_lossy(text).trim_end_matches('\0').trim().to_owned())
    }

    fn ratio(&self, entry: usize) -> Option<f64> {
        let at = self.long(entry + 8)?;
        let (above, below) = (self.long(at)?, self.long(at.checked_add(4)?)?);
        (below > 0).then(|| above as f64 / below as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block with a model and a focal length of 26 / 10 mm.
    fn block(little: bool) -> Vec<u8> {
        let short = |x: u16| if little { x.to_le_bytes() } else { x.to_be_bytes() };
        let long = |x: u32| if little { x.to_le_bytes() } else { x.to_be_bytes() };
        let mut block = if little { b"II".to_vec() } else { b"MM".to_vec() };
        block.extend(short(42));
        block.extend(long(8));
        block.extend(short(2)); // at 8
        let entry = |tag: u16, kind: u16, count: u32, value: u32| {
            [&short(tag)[..], &short(kind), &long(count), &long(value)].concat()
        };
        block.extend(entry(MODEL, ASCII, 8, 38));
        block.extend(entry(EXIF_DIRECTORY, LONG, 1, 46));
        block.extend(long(0)); // at 34
        block.extend(b"Phone 7\0"); // at 38
        block.extend(short(1)); // at 46
        block.extend(entry(FOCAL_LENGTH, RATIONAL, 1, 64));
        block.extend(long(0)); // at 60
        block.extend([long(26), long(10)].concat()); // at 64
        block
    }

    #[test]
    fn model_and_focal_length_are_read_in_both_byte_orders() {
        for little in [true, false] {
            let expected = CameraTags { model: "Phone 7".to_owned(), focal_length: Some(2.6) };
            assert_eq!(camera_tags(&block(little)), expected);
        }
    }

    #[test]
    fn a_damaged_block_says_less_and_never_panics() {
        let whole = block(true);
        for length in 0..whole.len() {
            let _ = camera_tags(&whole[..length]);
        }
        for at in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[at] = 0xff;
            let _ = camera_tags(&damaged);
        }
        assert_eq!(camera_tags(b""), CameraTags::default());
    }
}
