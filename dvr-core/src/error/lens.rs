//! What is wrong with the lens of a camera.

/// Intrinsics that no pinhole's picture can be made of.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LensError {
    /// There is no camera model of this name.
    #[error("the camera model {model} is not known")]
    UnknownModel {
        /// Its name.
        model: String,
    },
    /// A camera model has another number of parameters.
    #[error("a camera of model {model} has {found} parameters, not {expected}")]
    Parameters {
        /// The model.
        model: String,
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// A parameter is not finite, or a focal length or size not positive.
    #[error("the lens of a camera has a number that is not finite, or a focal length that is not positive")]
    NotFinite,
    /// The pictures are panoramas.
    #[error("the pictures are panoramas of all directions (EQUIRECTANGULAR), of which no camera with a lens was found")]
    Panorama,
    /// The model maps several directions to one place, or shows next to nothing of the picture.
    #[error("the distortion of the lens cannot be undone: it folds the picture over")]
    CannotBeUndone,
}
