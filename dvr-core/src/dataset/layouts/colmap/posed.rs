//! A sparse model for those who want its pictures and points without a scene.

use std::path::Path;

use glam::DVec3;

use super::points::Images;
use super::{binary, lens, projection, text};
use crate::camera::Camera;
use crate::dataset::pairing::natural_order;
use crate::error::{Error, Result};
use crate::lens::Lens;
use crate::points::PointCloud;
use crate::verified_points::TrackSight;

/// A sparse model of COLMAP: the pictures that it placed, and the points that it triangulated.
#[derive(Clone, Debug)]
pub struct ColmapModel {
    /// In the natural order of their names.
    pub pictures: Vec<PosedPicture>,
    /// In the model's own space, with colours.
    pub points: PointCloud,
    /// For each point, the mean distance in pixels between where it is and where features show it; negative where COLMAP
    /// did not compute it.
    pub errors_px: Vec<f64>,
    /// For each point, how many features show it.
    pub track_lengths: Vec<usize>,
    /// For each point the pictures that show it, by their places in `pictures`, each once.
    pub sights: Vec<Vec<TrackSight>>,
}

/// A picture that has a camera.
#[derive(Clone, Debug)]
pub struct PosedPicture {
    /// Its path below the folder of pictures.
    pub name: String,
    /// Its camera without the distortion of the lens.
    pub camera: Camera,
    /// Its lens.
    pub lens: Lens,
}

/// Reads the sparse model in `folder`, text or binary.
///
/// # Errors
/// [`Error::Io`] where a file is missing, [`Error::Format`] where one is damaged, or a camera none.
pub fn read_colmap_model(folder: &Path) -> Result<ColmapModel> {
    let binary = folder.join("images.bin").is_file();
    let mut model = if binary { binary::read_model(folder)? } else { text::read_model(folder)? };
    model.images.sort_by(|a, b| natural_order(&a.name, &b.name));
    let mut pictures = Vec::with_capacity(model.images.len());
    for image in &model.images {
        let camera = model.cameras.get(&image.camera).ok_or_else(|| {
            Error::format(
                folder,
                format!("image `{}` has camera {}, which does not exist", image.name, image.camera),
                "Export the model again.",
            )
        })?;
        let lens = lens(camera, image, folder)?;
        let unusable =
            |source| Error::UnusableCamera { path: folder.to_owned(), what: format!("`{}`: ", image.name), source };
        let camera = projection(&lens, image, folder)?.camera(lens.size.0, lens.size.1).map_err(unusable)?;
        pictures.push(PosedPicture { name: image.name.clone(), camera, lens });
    }
    let images = Images::new(&model, folder);
    let color = |c: u8| f32::from(c) / 255.0;
    Ok(ColmapModel {
        pictures,
        points: PointCloud {
            points: model.points.iter().map(|point| DVec3::from(point.position).as_vec3()).collect(),
            normals: None,
            colors: Some(model.points.iter().map(|point| point.color.map(color)).collect()),
        },
        errors_px: model.points.iter().map(|point| point.error).collect(),
        sights: model.points.iter().map(|point| images.sights(&point.track)).collect(),
        track_lengths: model.points.iter().map(|point| point.track.len()).collect(),
    })
}
