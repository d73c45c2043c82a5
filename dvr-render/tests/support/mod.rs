//! What the extraction tests share: statements about meshes, fixtures, and the decoder they were made with.

#![allow(dead_code)] // each test binary uses its own part

pub mod decoder;
pub mod topology;

use std::path::PathBuf;

/// Path of a parity fixture, or `None` (and a note) where the fixtures are not at hand.
pub fn fixture(name: &str) -> Option<PathBuf> {
    let shared = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared"));
    if !shared.is_dir() {
        println!("skipped: ../shared is not here");
        return None;
    }
    Some(shared.join("fixtures").join(name))
}

/// An array of an npz archive, flattened in C order.
pub fn array<T: npyz::Deserialize>(path: &std::path::Path, name: &str) -> Vec<T> {
    let mut archive = npyz::npz::NpzArchive::open(path).unwrap();
    archive.by_name(name).unwrap().unwrap().into_vec().unwrap()
}
