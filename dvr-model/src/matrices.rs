//! Numbers as matrices, row by row, for their products.

use ndarray::{ArrayView2, ArrayViewMut2};

/// The first numbers of a slice, of which there are enough.
pub(crate) fn matrix(numbers: &[f32], rows: usize, columns: usize) -> ArrayView2<'_, f32> {
    ArrayView2::from_shape((rows, columns), &numbers[..rows * columns]).expect("as many numbers")
}

/// The same to be written.
pub(crate) fn matrix_mut(numbers: &mut [f32], rows: usize, columns: usize) -> ArrayViewMut2<'_, f32> {
    ArrayViewMut2::from_shape((rows, columns), &mut numbers[..rows * columns]).expect("as many numbers")
}
