//! PyTorch files: named tensors, and what lies beside them.

use std::collections::HashMap;
use std::path::Path;

use burn_store::bridge;
use burn_store::burn_pack::Tensor as NamedTensor;
use burn_store::pytorch_reader::{PickleValue, PytorchReader};

use crate::error::RecordError;

/// Tensors by name, their bytes unread.
pub(super) type Tensors = HashMap<String, NamedTensor>;

/// The tensors below a key of the file.
pub(super) fn read_tensors(path: &Path, key: Option<&str>) -> Result<Tensors, RecordError> {
    let reader = match key {
        Some(key) => PytorchReader::with_top_level_key(path, key),
        None => PytorchReader::new(path),
    };
    let tensors = reader.map_err(RecordError::damaged)?.into_tensors();
    Ok(tensors.into_iter().map(|(name, tensor)| (name, bridge::from_pytorch(tensor))).collect())
}

/// What a file holds besides tensors.
pub(super) struct Pickle(HashMap<String, PickleValue>);

impl Pickle {
    /// Reads a file whose root is a dictionary.
    pub(super) fn read(path: &Path) -> Result<Self, RecordError> {
        std::fs::File::open(path).map_err(|e| dvr_core::Error::io(path, e))?;
        match PytorchReader::read_pickle_data(path, None).map_err(RecordError::damaged)? {
            PickleValue::Dict(entries) => Ok(Self(entries)),
            _ => Err(RecordError::damaged("there is no dictionary of tensors in it")),
        }
    }

    /// What lies under a key of the root.
    pub(super) fn get(&self, key: &str) -> Option<&PickleValue> {
        self.0.get(key)
    }

    /// The first parameter group of the optimiser: its settings, and the numbers of its parameters.
    pub(super) fn parameter_group(&self) -> Option<&HashMap<String, PickleValue>> {
        match entry(self.get("optimizer")?, "param_groups")? {
            PickleValue::List(groups) => match groups.first()? {
                PickleValue::Dict(group) => Some(group),
                _ => None,
            },
            _ => None,
        }
    }
}

/// An entry of a dictionary.
pub(super) fn entry<'a>(value: &'a PickleValue, key: &str) -> Option<&'a PickleValue> {
    if let PickleValue::Dict(entries) = value { entries.get(key) } else { None }
}

/// A number.
pub(super) fn number(value: &PickleValue) -> Option<f64> {
    match value {
        PickleValue::Float(value) => Some(*value),
        PickleValue::Int(value) => Some(*value as f64),
        _ => None,
    }
}

/// A whole number.
pub(super) fn whole(value: &PickleValue) -> Option<i64> {
    if let PickleValue::Int(value) = value { Some(*value) } else { None }
}

/// The two extents of a matrix.
pub(super) fn matrix(tensors: &Tensors, name: &str) -> Result<[usize; 2], RecordError> {
    let missing = || RecordError::MissingTensors { names: vec![name.to_owned()] };
    let shape: Vec<usize> = tensors.get(name).ok_or_else(missing)?.shape.iter().copied().collect();
    <[usize; 2]>::try_from(shape).map_err(|found| RecordError::Shape {
        name: name.to_owned(),
        found,
        expected: "a matrix".into(),
    })
}

/// A tensor under another name.
pub(super) fn renamed(mut tensor: NamedTensor, name: &str) -> (String, NamedTensor) {
    tensor.name = name.to_owned();
    (name.to_owned(), tensor)
}
