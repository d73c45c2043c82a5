//! From one picture of an unknown object to its mesh.

use dvr_core::dataset::InputPicture;
use dvr_core::mesh::Mesh;
use dvr_render::{MeshShader, Shader, render_view};
use glam::DVec3;
use image::RgbImage;
use image::imageops::{FilterType, resize};

use crate::error::{Error, Result};
use crate::export::mesh::MeshOptions;
use crate::export::preview::{normal_picture, orbit_camera, sheet, to_rgb8};
use crate::objects::model::Asked;
use crate::objects::object_model::ObjectModel;
use crate::objects::shape::Shape;

/// What a model makes of a picture.
pub struct Prediction {
    /// What was seen, in object space; of fields with vertex colours.
    pub shape: Shape,
    /// What the encoder saw, then the mesh from two sides in colour and from one as normals.
    pub preview: RgbImage,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Width and height of the preview's pictures, pixels.
const PREVIEW: u32 = 192;

/// Where the preview looks from, degrees around the object and above it.
const SIDES: [(f64, f64); 2] = [(30.0, 20.0), (210.0, 20.0)];

/// The object in a picture as [`dvr_core::dataset::input_picture`] makes them, of the size that the model takes.
///
/// # Errors
/// When the model takes no pictures, or sees no surface in this one.
pub fn predict(model: &ObjectModel, picture: &InputPicture, options: &MeshOptions) -> Result<Prediction> {
    model.picture_size()?;
    let (shape, warnings) = match model {
        ObjectModel::Fields(model) => {
            let extracted = model.mesh(Asked::Picture(picture), options)?;
            (Shape::Mesh(extracted.mesh), extracted.warnings)
        }
        ObjectModel::System(model) => (model.shape(Some(picture), 0, &options.extraction), Vec::new()),
    };
    if shape.drawn().is_empty() {
        return Err(Error::NothingSeen);
    }
    let preview = preview_of(&picture.image, &shape.drawn());
    Ok(Prediction { shape, preview, warnings })
}

fn preview_of(picture: &RgbImage, mesh: &Mesh) -> RgbImage {
    let shader = MeshShader::new(mesh);
    let mut row = vec![resize(picture, PREVIEW, PREVIEW, FilterType::Triangle)];
    let mut normals = None;
    for (turn, elevation) in SIDES {
        let camera = orbit_camera(PREVIEW, turn, elevation, DVec3::Y);
        let rendering = render_view(&shader as &dyn Shader, &camera);
        row.push(to_rgb8(&rendering.color));
        normals.get_or_insert_with(|| normal_picture(&rendering, &camera));
    }
    row.extend(normals);
    sheet(&[row])
}
