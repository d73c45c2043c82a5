//! NumPy's `.npz` archives: named arrays, read whatever their dtype, written compressed.
//!
//! The format: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>.

mod archive;
mod array;
mod npy;

pub use archive::{NpzFile, write_npz};
pub use array::{Array, Values};
pub use npy::read_npy;

#[cfg(test)]
mod tests;
