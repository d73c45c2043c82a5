//! Why a network cannot be read or written.

use dvr_core::number_range::OutOfRange;

/// Why a network cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file itself cannot be opened or written.
    #[error(transparent)]
    File(#[from] dvr_core::Error),
    /// Another kind of file, or a damaged one.
    #[error("not a readable file of tensors: {reason}")]
    Damaged {
        /// What reading it met.
        reason: String,
    },
    /// A tensor whose numbers cannot be read.
    #[error("not a readable file of tensors: tensor {name:?}: {reason}")]
    DamagedTensor {
        /// The tensor.
        name: String,
        /// What reading it met.
        reason: String,
    },
    /// A tensor of numbers that no network here consists of.
    #[error("tensor {name:?} holds numbers of type {dtype}, expected floating point or 64-bit integers")]
    NumberType {
        /// The tensor.
        name: String,
        /// Its type.
        dtype: String,
    },
    /// The header does not say what the network is made of.
    #[error("the header does not describe a network: key {key:?} is missing")]
    MissingKey {
        /// The key.
        key: &'static str,
    },
    /// The header's configuration cannot be understood.
    #[error("the header does not describe a network: {key} is {value:?}: {reason}")]
    Configuration {
        /// The key.
        key: String,
        /// What it says.
        value: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A network of another kind.
    #[error("the file holds a network of the kind {found:?}, expected {expected:?}")]
    Kind {
        /// What the header says.
        found: String,
        /// What was asked for.
        expected: &'static str,
    },
    /// Written by another version of this program.
    #[error("the file has format version {found:?}, expected {expected}")]
    Version {
        /// The version in the header, as it stands there.
        found: String,
        /// The version that this program reads.
        expected: u32,
    },
    /// A tensor whose shape is not the one that the configuration, or the other tensors, ask for.
    #[error("tensor {name:?} has the shape {found:?}, the others ask for {expected}")]
    Shape {
        /// The tensor.
        name: String,
        /// Its shape.
        found: Vec<usize>,
        /// The shape that fits, or what it must be like.
        expected: String,
    },
    /// The configuration asks for more than the file holds.
    #[error("the network that the header describes has {expected} numbers, and the file holds {found}")]
    TooFewNumbers {
        /// Numbers in the file.
        found: u64,
        /// Numbers of the network, at least.
        expected: u64,
    },
    /// A network's tensors that are not in the file.
    #[error("tensor {:?} is missing{}", names.first().map_or("", String::as_str), more(names.len()))]
    MissingTensors {
        /// Their names.
        names: Vec<String>,
    },
    /// Tensors of the file that are not the network's.
    #[error("tensor {:?} has no place in the network{}", names.first().map_or("", String::as_str), more(names.len()))]
    UnknownTensors {
        /// Their names.
        names: Vec<String>,
    },
    /// The file holds an encoder alone: features to start from, but not a model.
    #[error("the file holds an encoder and no decoder")]
    NoDecoder,
    /// The tensors are those of another architecture.
    #[error("{found}, expected {expected}")]
    Architecture {
        /// What the tensors' names and shapes say.
        found: String,
        /// What is known here.
        expected: &'static str,
    },
    /// The features of a ResNet-18 are for that encoder alone.
    #[error("pretrained features are those of a ResNet-18, and the encoder is another")]
    EncoderWithoutFeatures,
    /// The tensors' shapes give a configuration that no model can have.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
}

impl RecordError {
    /// What a reader of containers says, as it says it.
    pub(crate) fn damaged(reason: impl std::fmt::Display) -> Self {
        Self::Damaged { reason: reason.to_string() }
    }
}

/// How many more there are than the one that is named.
fn more(count: usize) -> String {
    if count > 1 { format!(" (and {} more)", count - 1) } else { String::new() }
}
