//! Why a prediction cannot be compared with the truth.

/// Why a figure cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ComparisonError {
    /// Two lists of items have different lengths.
    #[error("{predicted} predicted items cannot be compared with {truth} true ones")]
    Lengths {
        /// Items of the prediction.
        predicted: usize,
        /// Items of the truth.
        truth: usize,
    },
    /// Two pictures, or a picture and a mask, have different sizes.
    #[error(
        "a picture of {}x{} pixels cannot be compared with one of {}x{}",
        predicted.0, predicted.1, truth.0, truth.1
    )]
    Sizes {
        /// Width and height of the prediction.
        predicted: (u32, u32),
        /// Width and height of the truth.
        truth: (u32, u32),
    },
    /// A picture without pixels.
    #[error("a picture without pixels has no structure to compare")]
    NoPixels,
    /// The true mesh has no area to sample.
    #[error("the true mesh has no area to sample")]
    NoArea,
    /// A cloud is too small to be split into halves and compared with itself.
    #[error("a cloud of {points} points, against {predicted} predicted ones, has no floor: at least two are needed")]
    NoFloor {
        /// Points of the cloud.
        points: usize,
        /// Points that predictions are sampled with.
        predicted: usize,
    },
    /// The points of a surface cannot be used.
    #[error("the {which} surface {problem}")]
    Surface {
        /// `true` or `predicted`.
        which: &'static str,
        /// What is wrong with its points, with the verb.
        problem: &'static str,
    },
}
