//! An array of a MAT file.

/// The elements of an array.
#[derive(Clone, Debug, PartialEq)]
pub enum MatValues {
    /// Stored as unsigned bytes: truth values, `uint8`, and what MATLAB found to fit, whatever the array's class.
    U8(Vec<u8>),
    /// Stored as anything else, in double precision: exact but for the largest integers.
    F64(Vec<f64>),
}

/// A real array of numbers or truth values.
#[derive(Clone, Debug, PartialEq)]
pub struct MatArray {
    /// Length along each axis, two at least.
    pub shape: Vec<usize>,
    /// The elements, as many as the product of `shape`; the first index runs fastest.
    pub values: MatValues,
}

impl MatArray {
    /// The elements in double precision.
    pub fn to_f64(&self) -> Vec<f64> {
        match &self.values {
            MatValues::U8(values) => values.iter().map(|&value| f64::from(value)).collect(),
            MatValues::F64(values) => values.clone(),
        }
    }

    /// Which elements are not zero.
    pub fn into_truths(self) -> Vec<bool> {
        match self.values {
            MatValues::U8(values) => values.into_iter().map(|value| value != 0).collect(),
            MatValues::F64(values) => values.into_iter().map(|value| value != 0.0).collect(),
        }
    }
}
