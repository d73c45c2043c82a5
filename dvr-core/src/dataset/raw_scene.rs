//! What a reader finds before any pixel is read: one struct for all layouts.

use std::path::PathBuf;

use glam::{DMat3, DMat4, DVec3};

use crate::camera::{Camera, Similarity};
use crate::error::CameraError;
use crate::lens::Lens;
use crate::scene::{GroundTruth, SparsePoints, Split};

/// A scene as its files describe it.
///
/// Projections, ground truth and sparse points share one space, the *files' space*: object space for the DVR layout,
/// the world for all others.
pub(super) struct RawScene {
    /// For [`Scene::format`](crate::Scene::format).
    pub format: &'static str,
    /// The folder.
    pub root: PathBuf,
    /// The file with the cameras, to be named in errors.
    pub cameras: PathBuf,
    pub views: Vec<RawView>,
    /// Takes the files' space to the world.
    pub files_to_world: Similarity,
    /// Where the object is, in the files' space.
    pub object_bounds: ObjectBounds,
    /// Indices in `visible_in` refer to `views`.
    pub sparse_points: Option<SparsePoints>,
    pub ground_truth: GroundTruth,
    pub warnings: Vec<String>,
}

impl RawScene {
    /// Of views in the world, whose files say nothing else.
    pub fn new(format: &'static str, root: PathBuf, cameras: PathBuf, views: Vec<RawView>) -> Self {
        Self {
            format,
            root,
            cameras,
            views,
            files_to_world: Similarity::default(),
            object_bounds: ObjectBounds::Unknown,
            sparse_points: None,
            ground_truth: GroundTruth::default(),
            warnings: Vec::new(),
        }
    }
}

/// Where the files say that the object is.
#[derive(Clone, Copy)]
pub(super) enum ObjectBounds {
    /// In the unit cube of the files' space.
    UnitCube,
    /// Somewhere in the image of the unit cube under this similarity.
    Bound(Similarity),
    /// They do not.
    Unknown,
}

/// One view as the files describe it.
pub(super) struct RawView {
    pub name: String,
    pub image: PathBuf,
    pub mask: Option<PathBuf>,
    pub depth: Option<PathBuf>,
    pub projection: Projection,
    /// Its lens, where that distorts; `projection` is without the distortion.
    pub lens: Option<Lens>,
    pub split: Split,
}

/// A 3x4 projection matrix `[left | right]`, and what its image coordinates mean.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projection {
    pub left: DMat3,
    pub right: DVec3,
    pub coordinates: Coordinates,
}

/// What image coordinates mean.
#[derive(Clone, Copy, Debug)]
pub(super) enum Coordinates {
    /// `[-1, 1]` across the image, `(-1, -1)` its top left corner.
    Normalised,
    /// Pixels from the top left corner of an image of that size; an image of another size is a scaled copy.
    /// Without a size: pixels of the image as it is.
    Pixels(Option<(u32, u32)>),
}

impl Projection {
    /// `K [R | t]` in pixels.
    pub fn from_parts(k: DMat3, rotation: DMat3, translation: DVec3, size: Option<(u32, u32)>) -> Self {
        Self { left: k * rotation, right: k * translation, coordinates: Coordinates::Pixels(size) }
    }

    /// The upper three rows of a 4x4 matrix.
    pub fn from_matrix(matrix: &DMat4, coordinates: Coordinates) -> Self {
        Self { left: DMat3::from_mat4(*matrix), right: matrix.w_axis.truncate(), coordinates }
    }

    /// The same projection, followed by a change of image coordinates.
    pub fn then(self, change: DMat3) -> Self {
        Self { left: change * self.left, right: change * self.right, ..self }
    }

    /// The same projection with integers at the corners of pixels where they were at the centres.
    pub fn shifted_to_corners(self) -> Self {
        self.then(DMat3::from_translation(glam::DVec2::splat(0.5)))
    }

    /// Units of the projection's third coordinate (what the DVR files call depth) in units of the space.
    pub fn depth_units(&self) -> f64 {
        self.left.row(2).length()
    }

    /// Whether pictures of an object at `point` are mirror images: no turn and no zoom of a pinhole camera makes them.
    ///
    /// The files give depth a sign: what is in front of the camera has a positive third coordinate. A negative
    /// determinant with the object in front is a mirror (with the object behind, the whole matrix has the other sign).
    pub fn mirrors(&self, point: DVec3) -> bool {
        self.left.determinant() < 0.0 && self.left.row(2).dot(point) + self.right.z > 0.0
    }

    /// The camera of an image of `width` x `height` pixels.
    ///
    /// # Errors
    /// When the matrix is singular or not finite, or the image has another shape than the camera was made for.
    pub fn camera(&self, width: u32, height: u32) -> Result<Camera, CameraError> {
        match self.coordinates {
            Coordinates::Normalised => {
                let (half_width, half_height) = (0.5 * f64::from(width), 0.5 * f64::from(height));
                let to_pixels = DMat3::from_cols(
                    DVec3::new(half_width, 0.0, 0.0),
                    DVec3::new(0.0, half_height, 0.0),
                    DVec3::new(half_width, half_height, 1.0),
                );
                Camera::from_projection(width, height, to_pixels * self.left, to_pixels * self.right)
            }
            Coordinates::Pixels(size) => {
                let (full_width, full_height) = size.unwrap_or((width, height));
                let camera = Camera::from_projection(full_width, full_height, self.left, self.right)?;
                let (sx, sy) = (f64::from(width) / f64::from(full_width), f64::from(height) / f64::from(full_height));
                // A scaled copy is off by rounding at most.
                let off = (f64::from(height) - sx * f64::from(full_height)).abs();
                if off.min((f64::from(width) - sy * f64::from(full_width)).abs()) > 1.5 {
                    let (image, camera) = ((width, height), (full_width, full_height));
                    return Err(CameraError::PictureShape { image, camera });
                }
                Ok(camera.resized(width, height))
            }
        }
    }
}

/// Whether a matrix is a rotation, up to the rounding of text files.
pub(super) fn is_rotation(matrix: &DMat3) -> bool {
    let defect = *matrix * matrix.transpose() - DMat3::IDENTITY;
    matrix.determinant() > 0.0 && defect.to_cols_array().iter().all(|x| x.abs() < 1e-2)
}
