//! What is wrong with a camera or a similarity.

/// A matrix that makes no camera or no similarity, or a camera that does not fit its picture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// The projection matrix holds NaN or infinity.
    #[error("a camera matrix holds NaN or infinity. Export the cameras again.")]
    NotFinite,
    /// The left 3x3 block of the projection matrix is singular.
    #[error("a camera matrix is singular (it maps space to a line). Export the cameras again.")]
    Singular,
    /// The picture has another shape than the one that the camera was made for.
    #[error(
        "the image has {}x{} pixels, its camera {}x{}. Use the images that the cameras were made for, or scaled copies of \
         them.",
        image.0, image.1, camera.0, camera.1
    )]
    PictureShape {
        /// Width and height of the picture.
        image: (u32, u32),
        /// Width and height of the picture that the camera was made for.
        camera: (u32, u32),
    },
    /// The matrix of a similarity is singular, mirrors or is not finite.
    #[error(
        "a scale matrix is singular, mirrored or not finite (scale {scale}). A scale_mat must be a uniform scale with a \
         rotation and a translation."
    )]
    NoScale {
        /// Cube root of the determinant.
        scale: f64,
    },
    /// The matrix of a similarity stretches or shears.
    #[error(
        "a scale matrix stretches its axes differently. A scale_mat must be a uniform scale with a rotation and a \
         translation."
    )]
    Stretched,
}
