//! MATLAB's MAT files of level 5, as `save -v6` writes them and, deflated, `save -v7`: arrays of numbers.
//!
//! The format: MathWorks, "MAT-File Level 5 File Format". Files of `save -v7.3` are HDF5 and are refused. Written here:
//! what an array claims is held against limits before it is inflated, which the crate `matfile` does not do.

mod array;
mod element;
mod file;

pub use array::{MatArray, MatValues};
pub use file::read_mat;

#[cfg(test)]
mod tests;
