//! A trained system: from a picture to a shape.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::PointCloud;
use dvr_core::dataset::InputPicture;
use dvr_core::mesh::Mesh;
use dvr_core::mesh::shapes::vertex_normals;
use dvr_model::{GraphDecoder, PatchDecoder, ShapeDecoder, ShapeModel, SphereDecoder, VoxelDecoder};
use dvr_render::extract::ExtractSettings;
use dvr_render::{MeshShader, ViewMetrics, view_metrics};
use glam::Vec3;

use super::config::SystemConfig;
use crate::error::{Error, Result};
use crate::learners::module_state::{check_holds, restore_module};
use crate::objects::model::{cameras_of, image_tensor, rows_tensor};
use crate::objects::shape::Shape;
use crate::objects::validate::ValidationView;
use crate::objects::voxel_values::VoxelValues;

/// Vertices along an edge of each piece of surface.
const PATCH_VERTICES: usize = 14;

/// Cells along an edge at which voxels become a surface in validation.
const VALIDATION_CELLS: usize = 32;

/// A model without gradient tracking, with the configuration that it was trained by.
#[derive(Clone, Debug)]
pub struct SystemModel {
    config: SystemConfig,
    model: ShapeModel,
}

impl SystemModel {
    /// The model of a configuration, as its learner stores it.
    ///
    /// # Errors
    /// When its parameters are damaged.
    pub(crate) fn from_bytes(config: SystemConfig, model: &[u8], device: &Device) -> Result<Self> {
        check_holds(model, config.model().parameters())?;
        let model = restore_module(model, config.model().init(device))?.valid();
        Ok(Self { config, model })
    }

    /// One in training, as it is now.
    pub(crate) fn of(config: SystemConfig, model: ShapeModel) -> Self {
        Self { config, model }
    }

    /// The same with its surface at another occupancy of voxels.
    pub(crate) fn with_threshold(self, threshold: f64) -> Result<Self> {
        match &self.model.decoder {
            ShapeDecoder::Voxels(_) => Ok(Self { config: SystemConfig { threshold, ..self.config }, ..self }),
            ShapeDecoder::Points(_) | ShapeDecoder::Patches(_) | ShapeDecoder::Graph(_) | ShapeDecoder::Sphere(_) => {
                Err(Error::NoOccupancies { method: self.config.system.name().to_owned() })
            }
        }
    }

    /// The configuration.
    pub fn config(&self) -> &SystemConfig {
        &self.config
    }

    /// Encoder and decoder.
    pub fn model(&self) -> &ShapeModel {
        &self.model
    }

    /// The shape of the object in a picture as [`dvr_core::dataset::input_picture`] makes them, or of the training object
    /// with this place among them.
    pub(crate) fn shape(&self, picture: Option<&InputPicture>, row: i64, extraction: &ExtractSettings) -> Shape {
        let device = self.device();
        let images: Vec<&InputPicture> = picture.into_iter().collect();
        if let Some((stages, _)) = self.model.deformed(image_tensor(&images, &device), cameras_of(&images).as_deref()) {
            let finest = stages.into_iter().zip(GraphDecoder::meshes()).next_back();
            let mesh = finest.map(|(stage, mesh)| with_normals(points(stage.vertices), mesh.faces.clone()));
            return Shape::Mesh(mesh.unwrap_or_default());
        }
        let codes = self.model.codes(image_tensor(&images, &device), rows_tensor(&[row], &device));
        match &self.model.decoder {
            ShapeDecoder::Voxels(decoder) => {
                let logits: Vec<f32> = numbers(decoder.forward(codes)).collect();
                let surface = surface_logit(&logits, self.config.threshold);
                let values = logits.into_iter().map(|logit| logit - surface).collect();
                let voxels = VoxelValues { voxels: VoxelDecoder::RESOLUTION, values };
                Shape::Mesh(voxels.surface(extraction))
            }
            ShapeDecoder::Points(decoder) => {
                Shape::Cloud(PointCloud { points: points(decoder.forward(codes)), ..PointCloud::default() })
            }
            ShapeDecoder::Patches(decoder) => Shape::OpenMesh(pieces(decoder, codes)),
            // It takes no codes.
            ShapeDecoder::Graph(_) => Shape::Mesh(Mesh::default()),
            ShapeDecoder::Sphere(decoder) => {
                let vertices = points(decoder.forward(codes));
                Shape::Mesh(with_normals(vertices, SphereDecoder::sphere().faces.clone()))
            }
        }
    }

    fn device(&self) -> Device {
        self.model.devices().into_iter().next().unwrap_or_else(Device::flex)
    }
}

impl SystemModel {
    /// How well the shape explains a validation view, on about so many pixels; `None` where it is no surface.
    pub(crate) fn view_metrics(&self, validation: &ValidationView, pixels: usize) -> Option<ViewMetrics> {
        let extraction = ExtractSettings { resolution: VALIDATION_CELLS, ..ExtractSettings::default() };
        let shape = self.shape(validation.input.as_ref(), validation.row, &extraction);
        view_metrics(&MeshShader::new(shape.mesh()?), &[&validation.view], pixels)
    }
}

/// The logit at which the surface of voxels lies: that of the threshold, or of half of the largest occupancy where no voxel
/// comes to the threshold, as of thin parts whose place the picture leaves open. No object is empty.
fn surface_logit(logits: &[f32], threshold: f64) -> f32 {
    let most = logits.iter().copied().fold(f32::MIN, f32::max);
    let most = 1.0 / (1.0 + f64::from(-most).exp());
    let level = if most > threshold { threshold } else { 0.5 * most };
    (level / (1.0 - level)).ln() as f32
}

/// A regular grid of each piece, as a mesh.
fn pieces(decoder: &PatchDecoder, codes: Tensor<2>) -> Mesh {
    let (patches, n) = (decoder.patches(), PATCH_VERTICES);
    let at = |i: usize| i as f32 / (n - 1) as f32;
    let places: Vec<f32> = (0..n * n).flat_map(|i| [at(i % n), at(i / n)]).collect();
    let places = places.repeat(patches);
    let places = Tensor::from_data(TensorData::new(places, [patches, n * n, 2]), &codes.device());
    let vertices = points(decoder.forward(codes, places));
    let corners = (0..patches * (n - 1) * (n - 1)).map(|cell| {
        let (piece, cell) = (cell / ((n - 1) * (n - 1)), cell % ((n - 1) * (n - 1)));
        (piece * n * n + cell / (n - 1) * n + cell % (n - 1)) as u32
    });
    let n = n as u32;
    let faces = corners.flat_map(|a| [[a, a + 1, a + n + 1], [a, a + n + 1, a + n]]).collect();
    with_normals(vertices, faces)
}

fn with_normals(vertices: Vec<Vec3>, faces: Vec<[u32; 3]>) -> Mesh {
    let normals = Some(vertex_normals(&vertices, &faces));
    Mesh { vertices, faces, normals, ..Mesh::default() }
}

fn numbers<const D: usize>(tensor: Tensor<D>) -> impl Iterator<Item = f32> {
    tensor.into_data().iter::<f32>().collect::<Vec<_>>().into_iter()
}

fn points(tensor: Tensor<3>) -> Vec<Vec3> {
    numbers(tensor).collect::<Vec<_>>().chunks_exact(3).map(Vec3::from_slice).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_that_do_not_come_to_the_threshold_have_a_surface_all_the_same() {
        let logit = |share: f64| (share / (1.0 - share)).ln() as f32;
        let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-5, "{a} {b}");
        near(surface_logit(&[logit(0.1), logit(0.9)], 0.4), logit(0.4));
        near(surface_logit(&[logit(0.1), logit(0.3)], 0.4), logit(0.15));
        let surface = surface_logit(&[-30.0, -20.0], 0.5);
        assert!(surface < -20.0 && surface > -30.0, "{surface}");
    }
}
