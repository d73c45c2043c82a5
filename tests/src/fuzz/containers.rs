//! Damage behind checksums and compression: containers are taken apart, damaged inside, and put together again.

use std::io::{Cursor, Read, Write};

use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use flate2::{Compression, Crc};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::{Anatomy, mutation, parts};

/// `base`, damaged; `other` is another file of the same kind.
pub(super) fn damaged(anatomy: Anatomy, base: &[u8], other: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    // The container itself, too.
    if rng.random_bool(0.15) {
        return mutation::bytes(base, other, rng);
    }
    let inside = match anatomy {
        Anatomy::Bytes => None,
        Anatomy::Text => Some(mutation::text(base, other, rng)),
        Anatomy::Png => png(base, rng),
        Anatomy::Zip => zip(base, rng),
        Anatomy::Checked(header) => checked(base, header, rng),
        Anatomy::Safetensors => safetensors(base, rng),
        Anatomy::Glb => glb(base, rng),
        Anatomy::Parts => several(base, other, rng),
    };
    inside.unwrap_or_else(|| mutation::bytes(base, other, rng))
}

/// One of the chunks, its checksum made anew; `IDAT` is damaged before it is deflated, half of the time.
fn png(base: &[u8], rng: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let (signature, mut rest) = base.split_at_checked(8)?;
    let mut chunks: Vec<([u8; 4], Vec<u8>)> = Vec::new();
    while let Some((length, tail)) = rest.split_first_chunk::<4>() {
        let (kind, tail) = tail.split_first_chunk::<4>()?;
        let (data, tail) = tail.split_at_checked(u32::from_be_bytes(*length) as usize)?;
        chunks.push((*kind, data.to_vec()));
        rest = tail.get(4..)?;
    }
    let chosen = rng.random_range(0..chunks.len().max(1));
    let (kind, data) = chunks.get_mut(chosen)?;
    if kind == b"IDAT" && rng.random_bool(0.5) {
        let mut plain = Vec::new();
        ZlibDecoder::new(data.as_slice()).read_to_end(&mut plain).ok()?;
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(&mutation::bytes(&plain, &plain, rng)).ok()?;
        *data = encoder.finish().ok()?;
    } else {
        *data = mutation::bytes(data, data, rng);
    }
    if rng.random_bool(0.1) {
        let again = chunks[chosen].clone();
        chunks.push(again);
    }
    let chunk = |(kind, data): &([u8; 4], Vec<u8>)| {
        let mut crc = Crc::new();
        crc.update(kind);
        crc.update(data);
        [&(data.len() as u32).to_be_bytes()[..], kind, data, &crc.sum().to_be_bytes()].concat()
    };
    Some([signature, &chunks.iter().flat_map(chunk).collect::<Vec<u8>>()].concat())
}

/// One of the entries.
fn zip(base: &[u8], rng: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let mut archive = ZipArchive::new(Cursor::new(base)).ok()?;
    let mut entries = Vec::new();
    for i in 0..archive.len() {
        let mut entry = archive.by_index(i).ok()?;
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).ok()?;
        entries.push((entry.name().ok()?.to_string(), bytes, entry.compression()));
    }
    // The largest part of a checkpoint's structure is in its pickle.
    let pickle = entries.iter().position(|(name, _, _)| name.ends_with(".pkl")).filter(|_| rng.random_bool(0.7));
    let chosen = pickle.unwrap_or_else(|| rng.random_range(0..entries.len().max(1)));
    let (_, bytes, _) = entries.get_mut(chosen)?;
    *bytes = if rng.random_bool(0.5) { mutation::bytes(bytes, bytes, rng) } else { mutation::text(bytes, bytes, rng) };
    if rng.random_bool(0.05) {
        entries.remove(chosen);
    }
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes, method) in entries {
        let method = if method == CompressionMethod::Stored { method } else { CompressionMethod::Deflated };
        zip.start_file(name, SimpleFileOptions::default().compression_method(method)).ok()?;
        zip.write_all(&bytes).ok()?;
    }
    Some(zip.finish().ok()?.into_inner())
}

/// The header or what is behind it; length and checksum are made anew.
fn checked(base: &[u8], header: usize, rng: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let (mut head, mut stream) = (base.get(..header)?.to_vec(), base.get(header + 8..)?.to_vec());
    if rng.random_bool(0.5) {
        head = mutation::bytes(&head, &head, rng);
    } else {
        stream = mutation::bytes(&stream, &stream, rng);
    }
    Some(with_checksum(head, &stream))
}

/// A header, the length of what follows, the CRC-32 of all but itself, and what follows.
pub(super) fn with_checksum(mut head: Vec<u8>, stream: &[u8]) -> Vec<u8> {
    head.extend((stream.len() as u32).to_le_bytes());
    let mut crc = Crc::new();
    crc.update(&head);
    crc.update(stream);
    head.extend(crc.sum().to_le_bytes());
    head.extend(stream);
    head
}

/// The JSON header, with its length made anew.
fn safetensors(base: &[u8], rng: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let (length, rest) = base.split_first_chunk::<8>()?;
    let (header, data) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let (header, data) = if rng.random_bool(0.7) {
        (mutation::text(header, header, rng), data.to_vec())
    } else {
        (header.to_vec(), mutation::bytes(data, data, rng))
    };
    Some([&(header.len() as u64).to_le_bytes()[..], &header, &data].concat())
}

/// The JSON chunk or the bytes behind it, with all lengths made anew.
fn glb(base: &[u8], rng: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let length = usize::try_from(u32::from_le_bytes(base.get(12..16)?.try_into().ok()?)).ok()?;
    let (json, rest) = base.get(20..)?.split_at_checked(length)?;
    let data = rest.get(8..).unwrap_or_default();
    let (mut json, mut data) = if rng.random_bool(0.8) {
        (mutation::text(json, json, rng), data.to_vec())
    } else {
        (json.to_vec(), mutation::bytes(data, data, rng))
    };
    json.resize(json.len().next_multiple_of(4), b' ');
    data.resize(data.len().next_multiple_of(4), 0);
    let total = 28 + json.len() + data.len();
    let words = [2, total as u32, json.len() as u32].map(u32::to_le_bytes).concat();
    let data_head = (data.len() as u32).to_le_bytes();
    Some([b"glTF", &words[..], b"JSON", &json, &data_head, b"BIN\0", &data].concat())
}

/// One of the files, by its name.
fn several(base: &[u8], other: &[u8], rng: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let mut files: Vec<(String, Vec<u8>)> =
        parts::split(base).into_iter().map(|(name, bytes)| (name, bytes.to_vec())).collect();
    let others = parts::split(other);
    let chosen = rng.random_range(0..files.len().max(1));
    let (name, bytes) = files.get_mut(chosen)?;
    let twin = others.iter().find(|(other, _)| other == name).map_or(&[][..], |(_, bytes)| *bytes);
    let anatomy = match name.rsplit('.').next().unwrap_or_default() {
        "png" => Anatomy::Png,
        "npz" => Anatomy::Zip,
        "bin" => Anatomy::Bytes,
        _ => Anatomy::Text,
    };
    *bytes = damaged(anatomy, bytes, twin, rng);
    let borrowed: Vec<(&str, &[u8])> = files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
    Some(parts::joined(&borrowed))
}
