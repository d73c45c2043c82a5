//! The numbers behind a glTF accessor, with every range checked.
//!
//! The `gltf` crate's own readers panic on accessors of an unexpected type or without elements; files come from
//! anywhere.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ::gltf::accessor::{Accessor, DataType};
use ::gltf::{Document, buffer};

use super::meshopt_views::{decompressed, is_fallback};
use crate::files::{read_bytes, shortened};

/// The bytes of a document's buffers, and where the document lies.
pub(super) struct GltfBuffers {
    folder: PathBuf,
    buffers: Vec<Arc<Vec<u8>>>,
    /// The bytes of views that are compressed, by their index.
    decompressed: Vec<Option<Vec<u8>>>,
}

impl GltfBuffers {
    /// Loads every buffer: the binary chunk, data URIs, and files beside the document.
    pub fn load(document: &Document, folder: &Path, mut blob: Option<Vec<u8>>) -> Result<Self, String> {
        // Many buffers may be in one file, which is read once.
        let mut files: HashMap<String, Arc<Vec<u8>>> = HashMap::new();
        let buffers = document.buffers().map(|buffer| {
            let bytes = match buffer.source() {
                _ if is_fallback(&buffer) => Ok(Arc::default()),
                buffer::Source::Bin => blob.take().map(Arc::new).ok_or("has no binary chunk".to_owned()),
                buffer::Source::Uri(uri) => match files.get(uri) {
                    Some(known) => Ok(known.clone()),
                    None => read_uri(folder, uri).map(|bytes| {
                        let bytes = Arc::new(bytes);
                        files.insert(uri.to_owned(), bytes.clone());
                        bytes
                    }),
                },
            };
            bytes.map_err(|problem| format!("buffer {} {problem}", buffer.index()))
        });
        let buffers = buffers.collect::<Result<Vec<_>, _>>()?;
        let decompressed = decompressed(document, &buffers)?;
        Ok(Self { folder: folder.to_owned(), buffers, decompressed })
    }

    /// Bytes of all buffers and of what is compressed in them; those that are in one file count once.
    pub fn length(&self) -> usize {
        let mut files: Vec<(*const Vec<u8>, usize)> = self.buffers.iter().map(|b| (Arc::as_ptr(b), b.len())).collect();
        files.sort_unstable();
        files.dedup();
        let in_files: usize = files.into_iter().map(|(_, length)| length).sum();
        in_files + self.decompressed.iter().flatten().map(Vec::len).sum::<usize>()
    }

    /// The folder that relative URIs start from.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The bytes of a buffer view. Like all problems here, one is reported without its subject.
    pub fn view(&self, view: &buffer::View) -> Result<&[u8], String> {
        if let Some(Some(bytes)) = self.decompressed.get(view.index()) {
            return Ok(bytes);
        }
        let bytes = self.buffers.get(view.buffer().index()).map_or(&[][..], |bytes| bytes.as_slice());
        view.offset().checked_add(view.length()).and_then(|end| bytes.get(view.offset()..end)).ok_or(format!(
            "a view of {} bytes is larger than its buffer of {}",
            view.length(),
            bytes.len()
        ))
    }
}

/// What a URI of a document names: a data URI's content, or a file beside the document.
pub(super) fn read_uri(folder: &Path, uri: &str) -> Result<Vec<u8>, String> {
    if uri.starts_with("data:") {
        let data = buffer::Data::from_source(buffer::Source::Uri(uri), None);
        return data.map(|d| d.0).map_err(|e| format!("is a data URI that cannot be decoded: {e}"));
    }
    let name = percent_decoded(uri);
    let missing = || format!("is in `{}`, which is not there", shortened(&name));
    let path = super::texture_file::find_reference(folder, &name).ok_or_else(missing)?;
    read_bytes(&path).map_err(|e| format!("cannot be read: {e}"))
}

/// `%20` and its like; what is not a proper escape stays as it is.
pub(super) fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        let hex = (*first == b'%').then(|| tail.get(..2)).flatten().and_then(|h| std::str::from_utf8(h).ok());
        if let Some(byte) = hex.and_then(|h| u8::from_str_radix(h, 16).ok()) {
            bytes.push(byte);
            rest = &tail[2..];
        } else {
            bytes.push(*first);
            rest = tail;
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Vectors of at least `N` components, further ones dropped; whole numbers are scaled where the accessor says so.
pub(super) fn vectors<const N: usize>(accessor: &Accessor, buffers: &GltfBuffers) -> Result<Vec<[f32; N]>, String> {
    if accessor.dimensions().multiplicity() < N {
        return Err(format!("accessor {} has too few components for what it is used for", accessor.index()));
    }
    let (kind, normalized) = (accessor.data_type(), accessor.normalized());
    let decode = |element: &[u8]| {
        std::array::from_fn(|i| component(&element[i * kind.size()..(i + 1) * kind.size()], kind, normalized))
    };
    elements(accessor, buffers, decode)
}

/// Indices of vertices.
pub(super) fn indices(accessor: &Accessor, buffers: &GltfBuffers) -> Result<Vec<u32>, String> {
    let kind = accessor.data_type();
    elements(accessor, buffers, |element| match (kind, element) {
        (DataType::U8, [a, ..]) => u32::from(*a),
        (DataType::U16, [a, b, ..]) => u32::from(u16::from_le_bytes([*a, *b])),
        (DataType::U32, [a, b, c, d, ..]) => u32::from_le_bytes([*a, *b, *c, *d]),
        // Not a type of indices: no mesh has as many vertices, so the caller's range check names it.
        _ => u32::MAX,
    })
}

fn elements<T>(accessor: &Accessor, buffers: &GltfBuffers, decode: impl Fn(&[u8]) -> T) -> Result<Vec<T>, String> {
    let name = accessor.index();
    if accessor.sparse().is_some() {
        return Err(format!("accessor {name} is sparse, which is not read"));
    }
    let view = accessor.view().ok_or(format!("accessor {name} has no data"))?;
    let bytes = buffers.view(&view).map_err(|problem| format!("accessor {name} {problem}"))?;
    let (size, count) = (accessor.size(), accessor.count());
    let stride = view.stride().unwrap_or(size);
    if stride < size {
        return Err(format!("accessor {name} has elements of {size} bytes every {stride} bytes"));
    }
    let end = count
        .checked_sub(1)
        .and_then(|last| last.checked_mul(stride)?.checked_add(size)?.checked_add(accessor.offset()))
        .filter(|&end| end <= bytes.len());
    if end.is_none() {
        return Err(format!("accessor {name} wants {count} elements from a view of {} bytes", bytes.len()));
    }
    Ok((0..count).map(|i| accessor.offset() + i * stride).map(|at| decode(&bytes[at..at + size])).collect())
}

/// One number; normalised whole numbers as the specification scales them (section 3.11).
fn component(bytes: &[u8], kind: DataType, normalized: bool) -> f32 {
    let (value, full) = match (kind, bytes) {
        (DataType::I8, [a]) => (f32::from(*a as i8), 127.0),
        (DataType::U8, [a]) => (f32::from(*a), 255.0),
        (DataType::I16, [a, b]) => (f32::from(i16::from_le_bytes([*a, *b])), 32767.0),
        (DataType::U16, [a, b]) => (f32::from(u16::from_le_bytes([*a, *b])), 65535.0),
        (DataType::U32, [a, b, c, d]) => (u32::from_le_bytes([*a, *b, *c, *d]) as f32, 1.0),
        (DataType::F32, [a, b, c, d]) => return f32::from_le_bytes([*a, *b, *c, *d]),
        // The caller cuts slices of the type's size.
        _ => (f32::NAN, 1.0),
    };
    if normalized { (value / full).max(-1.0) } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_are_decoded_and_broken_ones_stay() {
        assert_eq!(percent_decoded("two%20words%2fa.png"), "two words/a.png");
        assert_eq!(percent_decoded("100%"), "100%");
        assert_eq!(percent_decoded("%zz%C3%A9"), "%zz\u{e9}");
    }

    #[test]
    fn whole_numbers_are_scaled_as_the_specification_says() {
        assert_eq!(component(&[255], DataType::U8, true), 1.0);
        assert_eq!(component(&[0x80], DataType::I8, true), -1.0);
        assert_eq!(component(&[0xff, 0x7f], DataType::I16, true), 1.0);
        assert_eq!(component(&[3, 0], DataType::U16, false), 3.0);
    }
}
