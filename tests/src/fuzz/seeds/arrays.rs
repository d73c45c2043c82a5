//! Arrays of NumPy and MATLAB.

use std::io::{Cursor, Write};

use dvr_core::npz::{Array, Values, write_npz};
use dvr_test_support::{MatEntry, mat_header};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::written;

/// An archive of arrays.
pub(in crate::fuzz) fn npz_of(arrays: &[(&str, Array)]) -> Vec<u8> {
    let arrays: Vec<_> = arrays.iter().map(|(name, array)| (*name, array)).collect();
    written("a.npz", |path| write_npz(path, &arrays).unwrap_or_else(|e| panic!("{e}")))
}

pub(in crate::fuzz) fn npz() -> Vec<Vec<u8>> {
    let numbers = Array::f32(&[2, 3], vec![0.5, -1.0, f32::INFINITY, 3.0, 4.0, 5.0]);
    let bits = Array { shape: vec![3], values: Values::U8(vec![0, 128, 255]) };
    let truths = Array { shape: vec![3, 1], values: Values::Bool(vec![true, false, true]) };
    let whole = Array { shape: vec![2], values: Values::I64(vec![-7, 1 << 40]) };
    vec![npz_of(&[("points", numbers), ("bits", bits)]), npz_of(&[("truths", truths), ("whole", whole)])]
}

pub(in crate::fuzz) fn npy() -> Vec<Vec<u8>> {
    let kinds = [("<f4", 24), (">f8", 48), ("<f2", 12), ("|i1", 6), ("<u2", 12), ("<i8", 48), ("|b1", 6)];
    let sound = kinds.map(|(kind, bytes)| npy_of(kind, kind == ">f8", "(2, 3)", &vec![1; bytes]));
    sound.into_iter().chain([npy_of("<f4", false, "()", &[0; 4])]).collect()
}

/// A `.npy` file, format version 1.0.
pub(in crate::fuzz) fn npy_of(kind: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let fortran = if fortran { "True" } else { "False" };
    let header = format!("{{'descr': '{kind}', 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
}

/// An archive whose only entry is `a.npy`, stored.
pub(in crate::fuzz) fn archive_of(npy: &[u8]) -> Vec<u8> {
    zip_of("a.npy", CompressionMethod::Stored, |zip| zip.write_all(npy))
}

/// An archive with one entry.
pub(in crate::fuzz) fn zip_of(
    name: &str,
    method: CompressionMethod,
    write: impl FnOnce(&mut ZipWriter<Cursor<Vec<u8>>>) -> std::io::Result<()>,
) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file(name, SimpleFileOptions::default().compression_method(method)).unwrap_or_else(|e| panic!("{e}"));
    write(&mut zip).unwrap_or_else(|e| panic!("{e}"));
    zip.finish().unwrap_or_else(|e| panic!("{e}")).into_inner()
}

/// A mask and a box, deflated and not.
pub(in crate::fuzz) fn mat() -> Vec<Vec<u8>> {
    let mask: Vec<u8> = (0..24).map(|i| i % 2).collect();
    let corners: Vec<u8> = (0..6).flat_map(|i| f64::from(i).to_le_bytes()).collect();
    let elements =
        [MatEntry::bytes("ObsMask", &[2, 3, 4], &mask).element(), MatEntry::doubles("BB", &[2, 3], &corners).element()];
    let deflated = elements.each_ref().map(|element| deflated_element(|encoder| encoder.write_all(element)));
    [elements, deflated].map(|elements| [mat_header(), elements.concat()].concat()).into()
}

/// What is written, as a deflated element of a MAT file.
pub(in crate::fuzz) fn deflated_element(
    write: impl FnOnce(&mut ZlibEncoder<Vec<u8>>) -> std::io::Result<()>,
) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    write(&mut encoder).unwrap_or_else(|e| panic!("{e}"));
    let data = encoder.finish().unwrap_or_else(|e| panic!("{e}"));
    [&[15, data.len() as u32].map(u32::to_le_bytes).concat()[..], &data].concat()
}
