//! Every field passes the same suite: a closed form, the decoder, the grid; on the CPU and on the GPU.

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::voxel::VoxelGrid;
use dvr_core::{Camera, Ray};
use dvr_grid::{GpuGridField, GridField, GridValues};
use dvr_model::{Decoder, DecoderConfig};
use dvr_render::extract::{ExtractSettings, FieldSurface, ScalarField, extract_mesh};
use dvr_render::{
    Crossing, Differentiable, Field, FieldShader, FieldValues, Query, RenderSettings, Shaded, Shader, Snapshot,
};
use dvr_tests::{check_field, gpu, seeded, test_with};
use glam::{DVec3, Vec3};

/// A ball of radius 0.3, coloured by the viewing direction, grey without one.
struct Ball;

impl Field for Ball {
    fn evaluate(&self, query: &Query) -> FieldValues {
        let radius = query.points.clone().square().sum_dim(1).sqrt().squeeze_dim::<1>(1);
        let color = match &query.directions {
            Some(directions) => directions.clone() * 0.5 + 0.5,
            None => Tensor::full_like(&query.points, 0.5),
        };
        FieldValues { occupancy_logit: radius.neg() + 0.3, color }
    }

    fn device(&self) -> Device {
        Device::flex()
    }
}

impl Differentiable for Ball {}
impl Crossing for Ball {}

/// The same on the CPU without tensors.
#[derive(Clone)]
struct FastBall;

impl ScalarField for FastBall {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        points.iter().map(|p| 0.3 - p.length()).collect()
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        Some(points.iter().map(|p| -p.normalize()).collect())
    }

    fn colors(&self, points: &[Vec3], _: &[Vec3], directions: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        let color = |i: usize| directions.map_or([0.5; 3], |directions| (directions[i] * 0.5 + 0.5).to_array());
        Some((0..points.len()).map(color).collect())
    }
}

impl Field for FastBall {
    fn evaluate(&self, query: &Query) -> FieldValues {
        Ball.evaluate(query)
    }

    fn device(&self) -> Device {
        Ball.device()
    }
}

impl Differentiable for FastBall {}

impl Crossing for FastBall {
    fn snapshots(&self) -> Vec<Snapshot> {
        vec![Box::new(self.clone())]
    }
}

/// Adds waves to parameters, so that no layer of a fresh network is zero.
struct Waves(f32);

impl ModuleMapper for Waves {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|tensor| {
            let shape = tensor.dims();
            let width = (shape[0] as f32).sqrt();
            let mut wave = || {
                self.0 += 1.0;
                (self.0 * 12.9898).sin() / width
            };
            let waves: Vec<f32> = (0..shape.iter().product()).map(|_| wave()).collect();
            tensor.clone() + Tensor::from_data(TensorData::new(waves, shape), &tensor.device())
        })
    }
}

/// A decoder whose surface lies in the cube and whose corners are outside.
fn decoder() -> Decoder {
    let device = Device::flex();
    let config = DecoderConfig::new().with_hidden(32).with_blocks(2).with_octaves(1);
    let mut decoder = seeded(3, || config.init(&device)).map(&mut Waves(0.0));
    let at = |decoder: &Decoder, points: [[f32; 3]; 3]| {
        decoder
            .occupancy_logit(&Query::new(Tensor::from_floats(points, &device)))
            .into_data()
            .iter::<f32>()
            .collect::<Vec<_>>()
    };
    // The middle of the cube is made as much inside as a point in front of the camera is outside.
    let logits = at(&decoder, [[0.0; 3], [0.1, 0.1, -0.5], [0.3, 0.3, -0.5]]);
    let middle = 0.5 * (logits[0] + logits[1]);
    decoder.fc_out.bias = decoder.fc_out.bias.map(|bias| bias.map(|bias| bias - middle));
    if logits[0] < logits[1] {
        decoder.fc_out.weight = decoder.fc_out.weight.map(Tensor::neg);
        decoder.fc_out.bias = decoder.fc_out.bias.map(|bias| bias.map(Tensor::neg));
    }
    decoder
}

/// Waves around a ball, coloured by place.
fn grid() -> GridField {
    let (shape, color) = (VoxelGrid::new(49, 0.55), VoxelGrid::new(17, 0.55));
    let logit = |node| {
        let p: Vec3 = shape.position(node);
        0.3 - p.length() + 0.03 * (11.0 * p.x).sin() * (9.0 * p.y).cos() * (10.0 * p.z).sin()
    };
    let values = (0..shape.len()).map(logit).collect();
    let colors = (0..color.len()).flat_map(|node| (color.position(node) * 0.8 + 0.5).to_array()).collect();
    GridField::new(GridValues { grid: shape, values }, GridValues { grid: color, values: colors })
}

#[test]
fn a_closed_form_is_a_field() {
    check_field("ball", &Ball);
    check_field("ball behind a pointer", &(Box::new(Ball) as Box<dyn Crossing>));
    check_field("ball with a snapshot", &FastBall);
}

#[test]
fn a_decoder_is_a_field() {
    check_field("decoder", &decoder());
}

#[test]
fn a_grid_is_a_field() {
    check_field("grid", &grid());
}

#[test_with(gpu)]
fn on_the_gpu_they_are_fields_too() {
    let gpu = gpu();
    check_field("grid on the GPU", &GpuGridField::new(grid(), &gpu).unwrap());
    check_field("decoder on the GPU", &decoder().to_device(&gpu));
}

/// What a camera sees of a field, and the rays that saw it.
fn seen(field: &impl Crossing) -> Vec<(Ray, Shaded)> {
    let camera = Camera::look_at(16, 16, 40.0, DVec3::new(0.3, 0.4, -1.6), DVec3::ZERO, DVec3::Y);
    let rays: Vec<Ray> = (0..256).map(|i| camera.pixel_ray(i % 16, i / 16)).collect();
    let shaded = FieldShader::new(field, RenderSettings::default(), None).shade(&rays);
    rays.into_iter().zip(shaded).filter_map(|(ray, shaded)| Some((ray, shaded?))).collect()
}

#[test]
fn colour_is_asked_with_the_direction_of_the_ray_and_in_extraction_without_one() {
    for shown in [seen(&Ball), seen(&FastBall)] {
        assert!(shown.len() > 40);
        for (ray, shaded) in shown {
            let expected = ray.direction.normalize().as_vec3() * 0.5 + 0.5;
            assert!(Vec3::from(shaded.color).distance(expected) < 1e-5);
        }
    }
    let settings = ExtractSettings { resolution: 16, upsampling_steps: 0, ..ExtractSettings::default() };
    let mesh = extract_mesh(&FieldSurface::new(&Ball), &settings, &[]).unwrap().mesh;
    assert!(mesh.colors.unwrap().iter().all(|color| *color == [0.5; 3]));
}
