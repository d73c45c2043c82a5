//! Views of glTF buffers that meshoptimizer compressed (`EXT_meshopt_compression`, and `KHR_meshopt_compression`, which adds
//! newer versions of its codecs).

use std::sync::Arc;

use ::gltf::{Buffer, Document};
use serde::Deserialize;

use crate::files::limits::{ARRAY_BYTES, MESHOPT_INFLATION};

/// Names of the extension.
const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// What the extension says of a view: where the compressed bytes are, and what they become.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Compressed {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: usize,
    count: usize,
    mode: String,
    #[serde(default)]
    filter: Option<String>,
}

/// Whether an extension is this one.
pub(super) fn is_known(extension: &str) -> bool {
    NAMES.contains(&extension)
}

/// Whether a buffer has no bytes: it is there for views to lie in, when they are not compressed.
pub(super) fn is_fallback(buffer: &Buffer) -> bool {
    NAMES.iter().any(|name| buffer.extension_value(name).is_some_and(|said| said["fallback"] == true))
}

/// The bytes of each compressed view, by its index.
pub(super) fn decompressed(document: &Document, buffers: &[Arc<Vec<u8>>]) -> Result<Vec<Option<Vec<u8>>>, String> {
    // Buffers that are in one file count once.
    let mut files: Vec<(*const Vec<u8>, u64)> = buffers.iter().map(|b| (Arc::as_ptr(b), b.len() as u64)).collect();
    files.sort_unstable();
    files.dedup();
    let length: u64 = files.into_iter().map(|(_, length)| length).sum();
    let mut left = MESHOPT_INFLATION.saturating_mul(length).min(ARRAY_BYTES);
    let views = document.views().map(|view| {
        let Some(said) = NAMES.iter().find_map(|name| view.extension_value(name)) else { return Ok(None) };
        let bytes = serde_json::from_value::<Compressed>(said.clone())
            .map_err(|error| error.to_string())
            .and_then(|compressed| compressed.decoded(buffers, &mut left));
        bytes.map(Some).map_err(|problem| format!("compressed view {}: {problem}", view.index()))
    });
    views.collect()
}

impl Compressed {
    /// The bytes that there were; `left` says how many all views together may still have.
    fn decoded(&self, buffers: &[Arc<Vec<u8>>], left: &mut u64) -> Result<Vec<u8>, String> {
        let Self { byte_stride: stride, count, .. } = *self;
        let buffer = buffers.get(self.buffer).map_or(&[][..], |bytes| bytes.as_slice());
        let end = self.byte_offset.checked_add(self.byte_length);
        let bytes = end.and_then(|end| buffer.get(self.byte_offset..end));
        let bytes = bytes.ok_or_else(|| format!("{} bytes are more than its buffer has", self.byte_length))?;
        let length = (count as u64).saturating_mul(stride as u64);
        let claims = || format!("{count} elements of {stride} bytes are more than the file can hold");
        *left = left.checked_sub(length).ok_or_else(claims)?;
        let damaged = |error: meshopt::Error| format!("its bytes are damaged ({error})");
        let mut decoded = match (self.mode.as_str(), stride) {
            ("ATTRIBUTES", _) => vertices(bytes, count, stride)?.map_err(damaged)?,
            ("TRIANGLES", 2) if count.is_multiple_of(3) => {
                in_bytes(meshopt::decode_index_buffer(bytes, count).map_err(damaged)?)
            }
            ("TRIANGLES", 4) if count.is_multiple_of(3) => {
                let indices: Vec<u32> = meshopt::decode_index_buffer(bytes, count).map_err(damaged)?;
                indices.into_iter().flat_map(u32::to_le_bytes).collect()
            }
            ("INDICES", 2) => in_bytes(meshopt::decode_index_sequence(bytes, count).map_err(damaged)?),
            ("INDICES", 4) => {
                let indices: Vec<u32> = meshopt::decode_index_sequence(bytes, count).map_err(damaged)?;
                indices.into_iter().flat_map(u32::to_le_bytes).collect()
            }
            (mode, _) => return Err(format!("{count} elements of {stride} bytes cannot be {mode}")),
        };
        self.filter(&mut decoded)?;
        Ok(decoded)
    }

    /// Undoes the filter.
    fn filter(&self, bytes: &mut [u8]) -> Result<(), String> {
        let filter = self.filter.as_deref().unwrap_or("NONE");
        match (filter, self.byte_stride) {
            ("NONE", _) => {}
            ("OCTAHEDRAL", 4) => on_elements(bytes, i8::from_le_bytes, i8::to_le_bytes, meshopt::decode_filter_oct),
            ("OCTAHEDRAL", 8) => on_elements(bytes, i16::from_le_bytes, i16::to_le_bytes, meshopt::decode_filter_oct),
            ("QUATERNION", 8) => on_elements(bytes, i16::from_le_bytes, i16::to_le_bytes, meshopt::decode_filter_quat),
            ("COLOR", 4) => on_elements(bytes, u8::from_le_bytes, u8::to_le_bytes, meshopt::decode_filter_color),
            ("COLOR", 8) => on_elements(bytes, u16::from_le_bytes, u16::to_le_bytes, meshopt::decode_filter_color),
            ("EXPONENTIAL", stride) if stride % 4 == 0 => {
                on_elements(bytes, u32::from_le_bytes, u32::to_le_bytes, |floats: &mut [[u32; 1]]| {
                    meshopt::decode_filter_exp(floats);
                });
            }
            (other, stride) => return Err(format!("elements of {stride} bytes have no filter {other}")),
        }
        Ok(())
    }
}

/// Elements of N numbers of B bytes, as numbers to `change` and back.
fn on_elements<T: Copy + Default, const B: usize, const N: usize>(
    bytes: &mut [u8],
    read: impl Fn([u8; B]) -> T,
    write: impl Fn(T) -> [u8; B],
    change: impl Fn(&mut [[T; N]]),
) {
    let numbers: Vec<T> = bytes.as_chunks::<B>().0.iter().map(|&number| read(number)).collect();
    let mut elements = numbers.as_chunks::<N>().0.to_vec();
    change(&mut elements);
    for (to, number) in bytes.as_chunks_mut::<B>().0.iter_mut().zip(elements.as_flattened()) {
        *to = write(*number);
    }
}

fn in_bytes(indices: Vec<u16>) -> Vec<u8> {
    indices.into_iter().flat_map(u16::to_le_bytes).collect()
}

/// Elements of vertices, whose size the decoder wants to know when it is compiled.
fn vertices(bytes: &[u8], count: usize, stride: usize) -> Result<meshopt::Result<Vec<u8>>, String> {
    fn of<const N: usize>(bytes: &[u8], count: usize) -> meshopt::Result<Vec<u8>>
    where
        [u8; N]: Default,
    {
        meshopt::decode_vertex_buffer::<[u8; N]>(bytes, count).map(|elements| elements.as_flattened().to_vec())
    }
    Ok(match stride {
        4 => of::<4>(bytes, count),
        8 => of::<8>(bytes, count),
        12 => of::<12>(bytes, count),
        16 => of::<16>(bytes, count),
        20 => of::<20>(bytes, count),
        24 => of::<24>(bytes, count),
        28 => of::<28>(bytes, count),
        32 => of::<32>(bytes, count),
        _ => return Err(format!("elements of {stride} bytes are not read, expected a multiple of 4 up to 32")),
    })
}
