//! A trained model of many objects' fields: from a picture to a field.

use burn::module::Module;
use burn::tensor::{Device, Int, Tensor, TensorData};
use dvr_core::dataset::InputPicture;
use dvr_core::mesh::Mesh;
use dvr_core::{Camera, Mask, Supervision, UnitCube};
use dvr_model::{ImageModel, ObjectField};
use dvr_render::extract::{ExtractSettings, FieldSurface, ScalarField};
use dvr_render::{FittedField, MarchSettings, RenderSettings, SilhouetteFit, SkipGrid, silhouette_overlap};
use glam::Vec3;

use super::config::ObjectsConfig;
use super::mirror::Symmetry;
use super::shape::Shape;
use crate::error::{Error, Result};
use crate::export::mesh::{ColorSource, MeshOptions, ObjectMesh, object_mesh};
use crate::learners::module_state::{check_holds, restore_module};

/// Cells along an edge of the grid that lets rendering skip empty space.
const SKIP_CELLS: usize = 32;

/// Points along an edge of the cube where the likeliest one is looked for.
const SEARCH_POINTS: usize = 48;

/// Where no point comes to the threshold, the surface lies at this share of the largest occupancy. Occupancies that are learned
/// from pictures differ little within the visual hull: at half of the largest, the surface would be the hull.
const SHARE_OF_LARGEST: f64 = 0.8;

/// How much better the silhouette of a picture fits (intersection over union) from which on an object is not its own mirror image.
/// Thin parts, whose two places differ a little, lose some silhouette by the mean as well.
const ASYMMETRIC: f64 = 0.1;

/// A model without gradient tracking, with the configuration that it was trained by. Its surface lies where the
/// occupancy is [`ObjectsConfig::threshold`]; the last bias is shifted so that it is where the logit is 0, as everywhere.
#[derive(Clone, Debug)]
pub struct FieldsModel {
    config: ObjectsConfig,
    model: ImageModel,
}

/// Which object a model is asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Asked<'a> {
    /// The one in a picture.
    Picture(&'a InputPicture),
    /// The training object with this place among them.
    Row(usize),
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

    /// The same with its surface at another occupancy.
    pub(crate) fn with_threshold(self, threshold: f64) -> Self {
        let before = self.config.surface_logit();
        let config = ObjectsConfig { threshold, ..self.config };
        Self { model: with_surface_at(self.model, config.surface_logit() - before), config }
    }

    /// The same that takes objects for their own mirror images, or does not.
    ///
    /// # Errors
    /// When it has not learned in which mirror.
    pub(crate) fn with_symmetry(self, is_symmetric: bool) -> Result<Self> {
        if is_symmetric && self.config.mirror_axis().is_none() {
            return Err(Error::NoMirror);
        }
        let symmetry = if is_symmetric { Symmetry::On } else { Symmetry::Off };
        Ok(Self { config: ObjectsConfig { symmetry, ..self.config }, ..self })
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
    pub fn field_of_picture(&self, picture: &InputPicture) -> ObjectField {
        field_of(&self.model, Some(picture), 0, &self.config, &self.device())
    }

    /// The field of a training object, given its place among them: for models without pictures.
    pub fn field_of_row(&self, row: usize) -> ObjectField {
        field_of(&self.model, None, row as i64, &self.config, &self.device())
    }

    /// The shape of an object; empty where there is nothing to see.
    ///
    /// # Errors
    /// When a surface needs more memory than there is.
    pub(crate) fn shape(&self, of: Asked, extraction: &ExtractSettings) -> Result<Shape> {
        let options =
            MeshOptions { extraction: extraction.clone(), colors: ColorSource::Field, ..MeshOptions::default() };
        match self.mesh(of, &options) {
            Ok(extracted) => Ok(Shape::Mesh(extracted.mesh)),
            Err(Error::NoMesh(_)) => Ok(Shape::Mesh(Mesh::default())),
            Err(other) => Err(other),
        }
    }

    /// The same as a mesh, without colours where none were learned: 3D supervision has no pictures. Where no point is as likely
    /// inside as the threshold says, as of thin parts whose place a picture leaves open, the surface lies at
    /// [`SHARE_OF_LARGEST`] of the largest occupancy.
    ///
    /// # Errors
    /// When there is no surface at all, or it needs more memory than there is.
    pub(crate) fn mesh(&self, of: Asked, options: &MeshOptions) -> Result<ObjectMesh> {
        let mut extracted = match self.mesh_at_threshold(of, options) {
            Err(Error::NoMesh(reason)) => {
                let logit = largest_logit(&self.field(of)) + self.config.surface_logit();
                let threshold = SHARE_OF_LARGEST / (1.0 + (-logit).exp());
                if !(threshold > 0.0 && threshold < self.config.threshold) {
                    return Err(Error::NoMesh(reason));
                }
                let mut lower = self.clone().with_threshold(threshold).mesh_at_threshold(of, options)?;
                lower.warnings.push(format!(
                    "no point is as likely inside as the threshold of {}: the surface lies at {threshold:.3}",
                    self.config.threshold
                ));
                lower
            }
            other => other?,
        };
        if self.config.train.supervision == Supervision::Occupancy {
            extracted.mesh.colors = None;
        }
        Ok(extracted)
    }

    /// With the silhouette of the picture, where features of places tell how its camera sees the object.
    fn mesh_at_threshold(&self, of: Asked, options: &MeshOptions) -> Result<ObjectMesh> {
        let field = self.field(of);
        let surface = FieldSurface::new(&field);
        match self.silhouette_fit(&surface, of) {
            Some(fit) => object_mesh(&FittedField { field: &surface, fit: &fit }, options, fit.raised(), &[]),
            None => object_mesh(&surface, options, &[], &[]),
        }
    }

    fn silhouette_fit(&self, surface: &impl ScalarField, of: Asked) -> Option<SilhouetteFit> {
        let Asked::Picture(picture) = of else { return None };
        let (camera, mask) = known_silhouette(picture, &self.config)?;
        SilhouetteFit::new(surface, camera, mask)
    }

    fn field(&self, of: Asked) -> ObjectField {
        match of {
            Asked::Picture(picture) => self.field_of_picture(picture),
            Asked::Row(row) => self.field_of_row(row),
        }
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
pub(crate) fn skip_grid(field: &ObjectField) -> SkipGrid {
    SkipGrid::build(&FieldSurface::new(field), UnitCube::default(), SKIP_CELLS)
}

/// The largest logit on a grid of the cube.
fn largest_logit(field: &ObjectField) -> f64 {
    let half = UnitCube::default().half_extent() as f32;
    let at = |i: usize| half * (2.0 * (i as f32 + 0.5) / SEARCH_POINTS as f32 - 1.0);
    let n = SEARCH_POINTS;
    let points: Vec<Vec3> = (0..n.pow(3)).map(|i| Vec3::new(at(i % n), at(i / n % n), at(i / n / n))).collect();
    FieldSurface::new(field).logits(&points).into_iter().fold(f32::NEG_INFINITY, f32::max).into()
}

/// The field of the object in a picture, or of the training object with this place among them; with what is seen in the mirror, and of
/// its mirror image, where the configuration says so.
pub(crate) fn field_of(
    model: &ImageModel,
    picture: Option<&InputPicture>,
    row: i64,
    config: &ObjectsConfig,
    device: &Device,
) -> ObjectField {
    let mirror = config.mirror_axis();
    let in_mirror = picture.zip(mirror).map(|(picture, axis)| picture.mirrored(axis));
    let pictures: Vec<&InputPicture> = picture.into_iter().chain(&in_mirror).collect();
    let rows = vec![row; pictures.len().max(1)];
    let cameras = cameras_of(&pictures);
    let seen = model.see(image_tensor(&pictures, device), rows_tensor(&rows, device), cameras.as_deref());
    let field = ObjectField::new(seen.field, mirror.filter(|_| in_mirror.is_some()));
    let Some(axis) = config.symmetry_axis() else { return field };
    let symmetric = field.clone().symmetric(axis);
    let known = picture.and_then(|picture| known_silhouette(picture, config));
    let is_asymmetric = known.is_some_and(|(camera, mask)| {
        is_asymmetric(&FieldSurface::new(&field), &FieldSurface::new(&symmetric), camera, mask)
    });
    if is_asymmetric { field } else { symmetric }
}

/// Whether a field has the silhouette of a picture so much better than `both`, its mean with its mirror image, that the object is not
/// its own mirror image.
pub(crate) fn is_asymmetric(alone: &impl ScalarField, both: &impl ScalarField, camera: &Camera, mask: &Mask) -> bool {
    let overlaps = silhouette_overlap(alone, camera, mask).zip(silhouette_overlap(both, camera, mask));
    overlaps.is_some_and(|(alone, both)| both + ASYMMETRIC < alone)
}

/// Camera and mask of a picture, where the encoder is told how its camera sees the object.
fn known_silhouette<'a>(picture: &'a InputPicture, config: &ObjectsConfig) -> Option<(&'a Camera, &'a Mask)> {
    config.encoder.local_channels()?;
    picture.camera.as_ref().zip(picture.mask.as_ref())
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
