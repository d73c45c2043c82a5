//! An array of numbers of any dtype.

/// The elements of an array. Smaller integers are widened, half precision to single.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// `float32`, and `float16`.
    F32(Vec<f32>),
    /// `float64`.
    F64(Vec<f64>),
    /// `int32`, `int16`, `int8`, `uint16`.
    I32(Vec<i32>),
    /// `int64`, `uint32`, `uint64`.
    I64(Vec<i64>),
    /// `uint8`.
    U8(Vec<u8>),
    /// `bool`.
    Bool(Vec<bool>),
}

/// An array of an `.npz` file: a shape, and its elements in C order (the last index runs fastest).
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length along each axis; empty for a scalar.
    pub shape: Vec<usize>,
    /// The elements, as many as the product of `shape`.
    pub values: Values,
}

macro_rules! convert {
    ($values:expr, $to:ty) => {
        match $values {
            Values::F32(v) => v.iter().map(|&x| x as $to).collect(),
            Values::F64(v) => v.iter().map(|&x| x as $to).collect(),
            Values::I32(v) => v.iter().map(|&x| x as $to).collect(),
            Values::I64(v) => v.iter().map(|&x| x as $to).collect(),
            Values::U8(v) => v.iter().map(|&x| x as $to).collect(),
            Values::Bool(v) => v.iter().map(|&x| u8::from(x) as $to).collect(),
        }
    };
}

impl Array {
    /// An array in single precision.
    pub fn f32(shape: &[usize], values: Vec<f32>) -> Self {
        Self { shape: shape.to_vec(), values: Values::F32(values) }
    }

    /// An array in double precision.
    pub fn f64(shape: &[usize], values: Vec<f64>) -> Self {
        Self { shape: shape.to_vec(), values: Values::F64(values) }
    }

    /// How many elements there are.
    pub fn len(&self) -> usize {
        match &self.values {
            Values::F32(v) => v.len(),
            Values::F64(v) => v.len(),
            Values::I32(v) => v.len(),
            Values::I64(v) => v.len(),
            Values::U8(v) => v.len(),
            Values::Bool(v) => v.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The elements in single precision.
    pub fn to_f32(&self) -> Vec<f32> {
        convert!(&self.values, f32)
    }

    /// The elements in double precision, exact but for the largest integers.
    pub fn to_f64(&self) -> Vec<f64> {
        convert!(&self.values, f64)
    }

    /// The elements as integers; fractions are cut off.
    pub fn to_i64(&self) -> Vec<i64> {
        convert!(&self.values, i64)
    }

    /// Which elements are greater than zero.
    pub fn to_bool(&self) -> Vec<bool> {
        self.to_f32().into_iter().map(|x| x > 0.0).collect()
    }

    /// One truth value per item, from booleans, numbers, or bytes of eight bits each (`numpy.packbits`, as the
    /// occupancies of the ShapeNet datasets are stored). `None` where the array has neither length.
    pub fn to_bool_of_length(&self, length: usize) -> Option<Vec<bool>> {
        if self.len() == length {
            return Some(self.to_bool());
        }
        match &self.values {
            Values::U8(bytes) if bytes.len() == length.div_ceil(8) => {
                Some((0..length).map(|i| bytes[i / 8] >> (7 - i % 8) & 1 == 1).collect())
            }
            _ => None,
        }
    }
}
