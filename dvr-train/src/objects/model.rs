//! A trained model of many objects' fields: from a picture to a field.

use burn::module::Module;
use burn::tensor::{Device, Int, Tensor, TensorData};
use dvr_core::dataset::InputPicture;
use dvr_core::mesh::Mesh;
use dvr_core::{Camera, Supervision, UnitCube};
use dvr_model::{Conditioned, ImageModel};
use dvr_render::extract::FieldSurface;
use dvr_render::{MarchSettings, RenderSettings, SkipGrid};

use super::config::ObjectsConfig;
use crate::error::Result;
use crate::learners::module_state::{check_holds, restore_module};

/// Cells along an edge of the grid that lets rendering skip empty space.
const SKIP_CELLS: usize = 32;

/// A model without gradient tracking, with the configuration that it was trained by. Its surface lies where the
/// occupancy is [`ObjectsConfig::threshold`]; the last bias is shifted so that it is where the logit is 0, as everywhere.
#[derive(Clone, Debug)]
pub struct FieldsModel {
    config: ObjectsConfig,
    model: ImageModel,
}

impl FieldsModel {
    /// The model of a configuration, as its learner stores it.
    ///
    /// # Errors
    /// When its parameters are damaged.
    pub(crate) fn from_bytes(config: ObjectsConfig, model: &[u8], device: &Device) -> Result<Self> {
        check_holds(model, config.image_model().parameters())?;
        let model = restore_module(model, config.image_model().init(device))?.valid();
        let model = with_surface_at(model, config.surface_logit());
        Ok(Self { config, model })
    }

    /// The configuration.
    pub fn config(&self) -> &ObjectsConfig {
        &self.config
    }

    /// Encoder and decoder.
    pub fn model(&self) -> &ImageModel {
        &self.model
    }

    /// The field of the object in a picture as [`dvr_core::dataset::input_picture`] makes them.
    pub fn field_of_picture(&self, picture: &InputPicture) -> Conditioned {
        field_of(&self.model, Some(picture), 0, &self.device())
    }

    /// The field of a training object, given its place among them: for models without pictures.
    pub fn field_of_row(&self, row: usize) -> Conditioned {
        field_of(&self.model, None, row as i64, &self.device())
    }

    /// A mesh of one of its fields, without the colours where none were learned: 3D supervision has no pictures.
    pub(crate) fn with_learned_colors(&self, mesh: Mesh) -> Mesh {
        let is_learned = self.config.train.supervision != Supervision::Occupancy;
        Mesh { colors: mesh.colors.filter(|_| is_learned), ..mesh }
    }

    fn device(&self) -> Device {
        self.model.decoder.fc_p.weight.val().device()
    }
}

/// The model without gradient tracking whose logits are smaller by `logit`.
pub(crate) fn with_surface_at(mut model: ImageModel, logit: f64) -> ImageModel {
    if logit != 0.0 {
        model.decoder.fc_out.bias = model.decoder.fc_out.bias.map(|bias| {
            bias.map(|bias| {
                // Channel 0 is the occupancy.
                let rest = bias.clone().narrow(0, 1, 3);
                Tensor::cat(vec![bias.narrow(0, 0, 1) - logit, rest], 0)
            })
        });
    }
    model
}

/// How the fields of objects are looked at.
pub(crate) fn render_settings(samples: usize) -> RenderSettings {
    RenderSettings { march: MarchSettings { steps: samples, ..MarchSettings::default() }, ..RenderSettings::default() }
}

/// Where a field's surface may be.
pub(crate) fn skip_grid(field: &Conditioned) -> SkipGrid {
    SkipGrid::build(&FieldSurface::new(field), UnitCube::default(), SKIP_CELLS)
}

/// The field of the object in a picture, or of the training object with this place among them.
pub(crate) fn field_of(model: &ImageModel, picture: Option<&InputPicture>, row: i64, device: &Device) -> Conditioned {
    let pictures: Vec<&InputPicture> = picture.into_iter().collect();
    model.see(image_tensor(&pictures, device), rows_tensor(&[row], device), cameras_of(&pictures).as_deref()).field
}

/// The cameras of pictures, where all are known.
pub(crate) fn cameras_of(pictures: &[&InputPicture]) -> Option<Vec<Camera>> {
    pictures.iter().map(|picture| picture.camera.clone()).collect()
}

/// Pictures of one size as `[b, 3, size, size]`, sRGB in `[0, 1]`; without pictures, one of one pixel that nobody looks
/// at.
pub(crate) fn image_tensor(pictures: &[&InputPicture], device: &Device) -> Tensor<4> {
    let Some(first) = pictures.first() else { return Tensor::zeros([1, 3, 1, 1], device) };
    let (width, height) = (first.image.width() as usize, first.image.height() as usize);
    let channel = |picture: &InputPicture, c: usize| {
        picture.image.pixels().map(|p| f32::from(p.0[c]) / 255.0).collect::<Vec<_>>()
    };
    let values: Vec<f32> = pictures.iter().flat_map(|picture| (0..3).flat_map(|c| channel(picture, c))).collect();
    Tensor::from_data(TensorData::new(values, [pictures.len(), 3, height, width]), device)
}

/// Places of objects among the training objects, `[b]`.
pub(crate) fn rows_tensor(rows: &[i64], device: &Device) -> Tensor<1, Int> {
    Tensor::from_data(TensorData::new(rows.to_vec(), [rows.len()]), device)
}
