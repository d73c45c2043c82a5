//! What the extraction tests share: statements about meshes, fixtures, and the decoder they were made with.

pub mod decoder;
pub mod shapes;
pub mod topology;

use dvr_core::npz::NpzFile;

/// An array of an npz archive, flattened in C order.
pub fn array<T: FromNumber>(path: &std::path::Path, name: &str) -> Vec<T> {
    let mut archive = NpzFile::open(path).unwrap();
    archive.read(name).unwrap().to_f64().into_iter().map(T::from_number).collect()
}

/// The element types of the fixtures' arrays, all of which fit a double.
pub trait FromNumber {
    fn from_number(number: f64) -> Self;
}

macro_rules! from_number {
    ($($kind:ty),*) => {
        $(impl FromNumber for $kind {
            fn from_number(number: f64) -> Self {
                number as $kind
            }
        })*
    };
}

from_number!(f32, f64, i32, i64, u8);
