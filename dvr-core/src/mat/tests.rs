//! Files as MATLAB and SciPy write them, and damaged ones.

use std::io::Write;
use std::path::PathBuf;

use dvr_test_support::{MatEntry, mat_file, mat_header};
use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::{MatArray, MatValues, read_mat};
use crate::error::{Error, Result};

/// What `scipy.io.savemat(..., do_compression=True)` writes behind its header: `ObsMask`, logical `[3, 2, 2]`, true at
/// `[1, 0, 1]` and `[2, 1, 0]`; `BB`, `[[-1.5, 2, 3], [4, 5, 6.25]]`; `Res`, 1.5; `note`, a text.
const BY_SCIPY: &str = "\
    0f00000038000000789ce36360600800623620e600624e2606306005621e20660662262806014620660762ffa462dfc4e26cb0380f035c9211\
    c604007c2203580f0000003a000000789ce36360604800623620e680d220c00ae533013133103302594e4e0c0c9c40b601030cfcd80fa1051c\
    a002505a044a734069490700c3c704910f00000027000000789ce3636060b000623620e680d220c00ae533c2313343506a310327541c027ed8\
    0300308a02e00f0000002e000000789ce3636060b000623620e600621606086085f219a1728c4099bcfc925401283f51a124b5a284810100447f\
    0484";

fn unhex(text: &str) -> Vec<u8> {
    (0..text.len() / 2).map(|i| u8::from_str_radix(&text[2 * i..2 * i + 2], 16).unwrap()).collect()
}

fn read(bytes: &[u8], names: &[&str]) -> Result<Vec<MatArray>> {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("a.mat");
    std::fs::write(&path, bytes).unwrap();
    read_mat(&path, names)
}

fn deflated(element: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(element).unwrap();
    let data = encoder.finish().unwrap();
    [&mat_header()[..], &15u32.to_le_bytes(), &(data.len() as u32).to_le_bytes(), &data].concat()
}

#[test]
fn arrays_of_scipy_are_read_in_the_order_that_was_asked_for() {
    let file = [mat_header(), unhex(BY_SCIPY)].concat();
    let arrays = read(&file, &["Res", "ObsMask", "BB"]).unwrap();
    assert_eq!(arrays[0].to_f64(), [1.5]);
    assert_eq!(arrays[2], MatArray { shape: vec![2, 3], values: MatValues::F64(vec![-1.5, 4.0, 2.0, 5.0, 3.0, 6.25]) });
    assert_eq!(arrays[1].shape, [3, 2, 2]);
    let inside: Vec<usize> =
        arrays[1].clone().into_truths().into_iter().enumerate().filter_map(|(i, inside)| inside.then_some(i)).collect();
    assert_eq!(inside, [2 + 3, 1 + 6], "the first index runs fastest");
}

#[test]
fn numbers_of_every_type_become_doubles_and_bytes_stay() {
    let stored: [(u32, Vec<u8>); 10] = [
        (1, (-3i8).to_le_bytes().to_vec()),
        (2, vec![7]),
        (3, (-300i16).to_le_bytes().to_vec()),
        (4, 60_000u16.to_le_bytes().to_vec()),
        (5, (-70_000i32).to_le_bytes().to_vec()),
        (6, 4_000_000_000u32.to_le_bytes().to_vec()),
        (7, 0.25f32.to_le_bytes().to_vec()),
        (9, 0.1f64.to_le_bytes().to_vec()),
        (12, (-5i64).to_le_bytes().to_vec()),
        (13, 5u64.to_le_bytes().to_vec()),
    ];
    let expected = [-3.0, 7.0, -300.0, 60_000.0, -70_000.0, 4e9, 0.25, 0.1, -5.0, 5.0];
    for ((stored, data), expected) in stored.into_iter().zip(expected) {
        let entry = MatEntry { name: "a", shape: &[1, 1], class: 6, stored, data: &data };
        let array = read(&mat_file(&[entry]), &["a"]).unwrap().remove(0);
        assert_eq!(array.to_f64(), [expected], "type {stored}");
        assert_eq!(matches!(array.values, MatValues::U8(_)), stored == 2);
    }
}

#[test]
fn big_endian_files_are_read() {
    let mut file = mat_header();
    file[124..].copy_from_slice(&[0x01, 0x00, b'M', b'I']);
    let words = [14u32, 56, 6, 8, 6, 0, 5, 8, 1, 1, (1 << 16) | 1];
    file.extend(words.iter().flat_map(|word| word.to_be_bytes()));
    file.extend([b'a', 0, 0, 0]);
    file.extend([9u32, 8].iter().flat_map(|word| word.to_be_bytes()));
    file.extend(0.75f64.to_be_bytes());
    assert_eq!(read(&file, &["a"]).unwrap()[0].to_f64(), [0.75]);
}

#[test]
fn what_is_missing_damaged_or_of_another_kind_is_refused() {
    let numbers = [1.0f64, 2.0].map(f64::to_le_bytes).concat();
    let entry = MatEntry::doubles("a", &[1, 2], &numbers);
    let file = mat_file(&[entry]);
    let says = |bytes: &[u8], name: &str, words: &str| {
        let error = read(bytes, &[name]).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    assert_eq!(read(&file, &["a"]).unwrap()[0].to_f64(), [1.0, 2.0]);
    says(&file, "b", "there is no array `b`; there is: a");
    says(&file[..100], "a", "cut short");
    says(&file[..file.len() - 4], "a", "ends early");
    says(b"MATLAB 7.3 MAT-file", "a", "cut short");
    says(&[b"MATLAB 7.3".to_vec(), vec![b' '; 118]].concat(), "a", "7.3");
    says(&[b' '; 200], "a", "level 5");
    says(&mat_file(&[MatEntry { shape: &[3, 2], ..entry }]), "a", "6 elements take 48 bytes, and there are 16");
    says(&mat_file(&[MatEntry { shape: &[u32::MAX; 3], ..entry }]), "a", "more than can be counted");
    says(&mat_file(&[MatEntry { class: 4, ..entry }]), "a", "class 4");
    says(&mat_file(&[MatEntry { class: 6 | 0x0800, ..entry }]), "a", "complex");
    let mut compressed = deflated(&entry.element());
    assert_eq!(read(&compressed, &["a"]).unwrap()[0].to_f64(), [1.0, 2.0]);
    let last = compressed.len() - 1;
    compressed[last] ^= 1;
    says(&compressed, "a", "damaged");
}

#[test]
fn what_an_array_claims_is_held_against_the_limit_before_it_is_inflated() {
    let entry = MatEntry::bytes("a", &[65_536, 65_536], &[]);
    let error = read(&deflated(&entry.element()), &["a"]).unwrap_err();
    assert!(matches!(error, Error::TooLarge { value, .. } if value == 1 << 32), "{error}");
}
