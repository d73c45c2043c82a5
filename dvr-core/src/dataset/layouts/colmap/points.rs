//! The points of a model, with the images that triangulated them.

use std::collections::HashMap;
use std::path::Path;

use glam::{DVec2, DVec3, Vec3};

use super::model::{Model, ModelImage, ModelPoint, TrackEntry};
use super::{binary, lens, projection, text};
use crate::camera::Camera;
use crate::error::Result;
use crate::lens::Lens;
use crate::points::PointCloud;
use crate::scene::SparsePoints;
use crate::verified_points::{TrackSight, Tracks, VerifiedPoints};

/// The points with the views that see them, which are the images in their order.
pub(super) fn sparse_points(model: &Model, folder: &Path) -> Option<SparsePoints> {
    if model.points.is_empty() {
        return None;
    }
    let images = Images::new(model, folder);
    let tracks: Vec<Vec<TrackSight>> = model.points.iter().map(|point| images.sights(&point.track)).collect();
    let bearings_of = |track: &Vec<TrackSight>| track.iter().map(|sight| sight.bearing).collect::<Option<Vec<_>>>();
    Some(SparsePoints {
        visible_in: tracks.iter().map(|track| track.iter().map(|sight| sight.camera).collect()).collect(),
        bearings: tracks.iter().map(bearings_of).collect(),
        errors_px: errors(&model.points),
        cloud: PointCloud {
            points: model.points.iter().map(|point| DVec3::from(point.position).as_vec3()).collect::<Vec<Vec3>>(),
            normals: None,
            colors: Some(model.points.iter().map(|point| point.color.map(|c| f32::from(c) / 255.0)).collect()),
        },
    })
}

/// The points of `points3D.bin` or `points3D.txt`. Their tracks, where the model's other files lie beside
/// it.
///
/// # Errors
/// Where a file cannot be read or is damaged.
pub(in crate::dataset) fn read_verified_points(path: &Path) -> Result<VerifiedPoints> {
    let binary = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("bin"));
    let folder = path.parent().unwrap_or(Path::new("."));
    let kind = if binary { "bin" } else { "txt" };
    let has_images = ["cameras", "images"].iter().all(|name| folder.join(format!("{name}.{kind}")).is_file());
    let points = if binary { binary::read_points(path)? } else { text::read_points(path)? };
    let tracks = if has_images {
        let mut model = if binary { binary::read_model(folder)? } else { text::read_model(folder)? };
        model.points.clear();
        tracks(&model, &points, folder)
    } else {
        None
    };
    Ok(VerifiedPoints {
        points: points.iter().map(|point| point.position.into()).collect(),
        track_lengths: Some(points.iter().map(|point| distinct_images(&point.track)).collect()),
        errors_px: errors(&points),
        tracks,
    })
}

/// The tracks with the model's own cameras, without distortion; `None` where one of these is no camera.
fn tracks(model: &Model, points: &[ModelPoint], folder: &Path) -> Option<Tracks> {
    let images = Images::new(model, folder);
    let camera = |image: &ModelImage| -> Option<Camera> {
        let lens = lens(model.cameras.get(&image.camera)?, image, folder).ok()?;
        projection(&lens, image, folder).ok()?.camera(lens.size.0, lens.size.1).ok()
    };
    let cameras = model.images.iter().map(camera).collect::<Option<Vec<_>>>()?;
    Some(Tracks { cameras, sights: points.iter().map(|point| images.sights(&point.track)).collect() })
}

/// How many images a track names: one may show a point by two features.
fn distinct_images(track: &[TrackEntry]) -> usize {
    let mut images: Vec<u32> = track.iter().map(|entry| entry.image).collect();
    images.sort_unstable();
    images.dedup();
    images.len()
}

/// COLMAP writes -1 where it has computed none.
fn errors(points: &[ModelPoint]) -> Option<Vec<f64>> {
    points.iter().map(|point| Some(point.error).filter(|error| *error >= 0.0)).collect()
}

/// A model's images in their order, ready to be asked what a track says.
pub(super) struct Images<'a> {
    images: &'a [ModelImage],
    /// `None` where a camera's lens is none.
    lenses: Vec<Option<Lens>>,
    place: HashMap<u32, usize>,
}

impl<'a> Images<'a> {
    pub(super) fn new(model: &'a Model, folder: &Path) -> Self {
        let of_image = |image: &ModelImage| lens(model.cameras.get(&image.camera)?, image, folder).ok();
        Self {
            images: &model.images,
            lenses: model.images.iter().map(of_image).collect(),
            place: model.images.iter().enumerate().map(|(place, image)| (image.id, place)).collect(),
        }
    }

    /// The images of a track, ascending, each once; those that are not in the model are left out.
    pub(super) fn sights(&self, track: &[TrackEntry]) -> Vec<TrackSight> {
        let sight = |entry: &TrackEntry| {
            let camera = *self.place.get(&entry.image)?;
            let feature = self.images[camera].features.get(entry.feature as usize);
            let lens = self.lenses[camera].as_ref();
            let bearing =
                feature.zip(lens).and_then(|(&[x, y], lens)| lens.direction_of(DVec2::new(x.into(), y.into())));
            Some(TrackSight { camera, bearing })
        };
        let mut sights: Vec<TrackSight> = track.iter().filter_map(sight).collect();
        sights.sort_by_key(|sight| sight.camera);
        sights.dedup_by_key(|sight| sight.camera);
        sights
    }
}
