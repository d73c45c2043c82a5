use std::path::PathBuf;

use super::npy::NpyHead;
use super::*;
use crate::error::Error;

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    (folder, path)
}

fn parse_npy(mut bytes: &[u8]) -> Result<Array, String> {
    let most = bytes.len() as u64;
    NpyHead::read(&mut bytes)?.read_values(&mut bytes, most)
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
fn an_entry_that_inflates_beyond_the_limit_is_refused_before_it_does() {
    let (_folder, path) = folder();
    let zeros = Array { shape: vec![1 << 20], values: Values::U8(vec![0; 1 << 20]) };
    write_npz(&path, &[("a", &zeros)]).unwrap();
    let packed = std::fs::metadata(&path).unwrap().len();
    assert!(packed < 4096, "{packed}");
    // The same entry with a header that promises doubles: 8 bytes each, more than the file can inflate to.
    let head = npy("<f8", false, "(99999999,)", &[0; 64]);
    let huge = npy("<f2", false, "(199999999,)", &[0; 64]);
    for (bytes, is_limit) in [(head, true), (huge, true), (npy("<f8", false, "(9999999,)", &[0; 64]), false)] {
        let mut zip = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
        zip.start_file("a.npy", zip::write::SimpleFileOptions::default()).unwrap();
        std::io::Write::write_all(&mut zip, &bytes).unwrap();
        zip.finish().unwrap();
        let error = NpzFile::open(&path).unwrap().read("a").unwrap_err();
        assert_eq!(matches!(error, Error::TooLarge { .. }), is_limit, "{error}");
    }
}

#[test]
fn a_header_of_nested_brackets_is_refused_at_once() {
    for (open, close) in [("(", ")"), ("[", "]"), ("{", "}")] {
        let shape = format!("{}1,{}", open.repeat(200), close.repeat(200));
        assert!(parse_npy(&npy("<f4", false, &shape, &[0; 4])).unwrap_err().contains("brackets"));
    }
}

#[test]
fn a_shape_that_does_not_fit_is_not_written() {
    let (_folder, path) = folder();
    assert!(write_npz(&path, &[("a", &Array::f32(&[3], vec![0.0]))]).is_err());
    assert!(!path.exists());
}
