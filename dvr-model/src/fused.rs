//! The decoder without gradients, off the tensors: tiles of points through all layers at once.

use std::sync::Arc;

use burn::nn::Linear;
use burn::tensor::{DType, Device, Tensor};
use dvr_render::Snapshot;
use dvr_render::extract::ScalarField;
use glam::Vec3;

use crate::aligned_features::AlignedFeatures;
use crate::decoder::{Decoder, LEAK};
use crate::mlp::{LinearWeights, ResidualMlp};
use crate::pixel_aligned::PicturePlane;

/// A decoder as it was when this was made, for one latent code.
#[derive(Clone, Debug)]
pub struct FusedDecoder {
    network: ResidualMlp,
}

impl FusedDecoder {
    /// Packs the parameters of a decoder without codes.
    pub fn new(decoder: &Decoder) -> Self {
        Self::with_inputs(decoder, None)
    }

    /// The same of a decoder whose first layer takes features of a picture too: they are 0 until [`FusedDecoder::with_picture`]
    /// says what they are.
    pub(crate) fn with_inputs(decoder: &Decoder, aligned: Option<&AlignedFeatures>) -> Self {
        let layer = |linear: &Linear| {
            let weight: Vec<f32> = linear.weight.val().into_data().iter::<f32>().collect();
            let bias = linear.bias.as_ref().map_or_else(
                || vec![0.0; linear.weight.dims()[1]],
                |bias| bias.val().into_data().iter::<f32>().collect(),
            );
            (weight, bias)
        };
        let mut input = layer(&decoder.fc_p);
        input
            .0
            .extend(aligned.iter().flat_map(|aligned| aligned.weights().into_data().iter::<f32>().collect::<Vec<_>>()));
        let blocks: Vec<_> = decoder.blocks.iter().map(|block| [layer(&block.fc_0), layer(&block.fc_1)]).collect();
        let output = layer(&decoder.fc_out);
        let blocks: Vec<_> = blocks.iter().map(|block| block.each_ref().map(weights)).collect();
        let leak = if decoder.leaky { LEAK as f32 } else { 0.0 };
        Self { network: ResidualMlp::new(weights(&input), &blocks, weights(&output), decoder.octaves, leak) }
    }

    /// The same for each of some objects, given what their codes make of the layer before each block, as
    /// [`Decoder::conditions`] has it.
    pub(crate) fn with_conditions(&self, conditions: &[Tensor<2>]) -> Vec<Self> {
        let [objects, width] = conditions.first().map_or([0, 0], Tensor::dims);
        let rows: Vec<Vec<f32>> =
            conditions.iter().map(|condition| condition.clone().into_data().iter::<f32>().collect()).collect();
        let of_object = |object: usize| -> Vec<&[f32]> {
            rows.iter().map(|rows| &rows[object * width..(object + 1) * width]).collect()
        };
        (0..objects).map(|object| Self { network: self.network.conditioned(&of_object(object)) }).collect()
    }

    /// The same for an object that this picture shows.
    pub(crate) fn with_picture(self, plane: PicturePlane) -> Self {
        Self { network: self.network.with_features(Arc::new(plane)) }
    }

    /// Whether a parameter is a number that the CPU computes with in single precision.
    pub(crate) fn suits(parameter: &Tensor<2>) -> bool {
        parameter.device() == Device::flex() && parameter.dtype() == DType::F32
    }
}

/// A layer's numbers as the kernels take them.
fn weights((weight, bias): &(Vec<f32>, Vec<f32>)) -> LinearWeights<'_> {
    LinearWeights { weight, bias, inputs: weight.len() / bias.len().max(1) }
}

/// As a field hands them out.
pub(crate) fn snapshots(decoders: Vec<FusedDecoder>) -> Vec<Snapshot> {
    decoders.into_iter().map(|decoder| Box::new(decoder) as Snapshot).collect()
}

impl ScalarField for FusedDecoder {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        let mut logits = vec![0.0; points.len()];
        self.network.evaluate(points, 1, &mut logits);
        logits
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        Some(self.network.value_and_gradient(points).into_iter().map(|(_, gradient)| gradient).collect())
    }

    fn colors(&self, points: &[Vec3], _normals: &[Vec3], _: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        let mut values = vec![0.0; 4 * points.len()];
        self.network.evaluate(points, 4, &mut values);
        let sigmoid = |x: f32| 1.0 / (1.0 + (-x).exp());
        Some(values.as_chunks().0.iter().map(|&[_, r, g, b]| [r, g, b].map(sigmoid)).collect())
    }
}

#[cfg(test)]
mod tests {
    use burn::module::{Module, ModuleMapper, Param};
    use burn::tensor::{Int, Tensor, TensorData};
    use dvr_core::{Camera, Ray, UnitCube};
    use dvr_render::extract::FieldSurface;
    use dvr_render::{
        Crossing, Differentiable, Field, March, MarchSettings, Marcher, Query, RayStatus, Rays, SnapshotMarcher,
        TensorMarcher,
    };
    use dvr_test_support::largest;
    use glam::DVec3;

    use super::*;
    use crate::decoder::DecoderConfig;

    /// Uniform numbers that no other test can disturb: a device's own generator is one for the whole process.
    struct Drawn(u64);

    impl Drawn {
        /// Numbers in `[-1, 1)` (Knuth's linear congruence).
        fn draw<const D: usize>(&mut self, shape: [usize; D], device: &Device) -> Tensor<D> {
            let mut next = || {
                self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (self.0 >> 40) as f32 / (1u64 << 23) as f32 - 1.0
            };
            let values: Vec<f32> = (0..shape.iter().product()).map(|_| next()).collect();
            Tensor::from_data(TensorData::new(values, shape), device)
        }
    }

    impl ModuleMapper for Drawn {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            param.map(|tensor| {
                let shape = tensor.dims();
                self.draw(shape, &tensor.device()) / (shape[0] as f64).sqrt()
            })
        }
    }

    /// A random decoder with a surface in the cube, on the side of [`rays`]' camera: its mean logit is taken from the
    /// bias, and all signs are turned where that side would be inside.
    fn decoder(config: &DecoderConfig) -> Decoder {
        let device = Device::flex();
        let mut drawn = Drawn(5);
        let mut decoder = config.init(&device).map(&mut drawn);
        let points = drawn.draw([2000, 3], &device) * 0.5;
        let code = (config.code_dim > 0).then(|| Tensor::zeros([2000, config.code_dim], &device));
        let mean = decoder.forward(points, code).mean_dim(0).slice([0..1, 0..1]).into_scalar::<f32>();
        let bias = decoder.fc_out.bias.take().map(|bias| bias.val() - mean);
        decoder.fc_out.bias = bias.map(Param::from_tensor);
        let near = Tensor::from_floats([[0.35, 0.22, -0.5]], &device);
        let code = (config.code_dim > 0).then(|| Tensor::zeros([1, config.code_dim], &device));
        if decoder.forward(near, code).slice([0..1, 0..1]).into_scalar::<f32>() > 0.0 {
            decoder.fc_out.weight = decoder.fc_out.weight.map(Tensor::neg);
            decoder.fc_out.bias = decoder.fc_out.bias.map(|bias| bias.map(Tensor::neg));
        }
        decoder
    }

    fn rays(n: u32) -> Rays {
        let camera = Camera::look_at(n, n, 45.0, DVec3::new(0.8, 0.5, -1.2), DVec3::ZERO, DVec3::Y);
        let rays: Vec<Ray> = (0..n * n).map(|i| camera.pixel_ray(i % n, i / n)).collect();
        Rays::new(&rays, UnitCube::default(), &Device::flex())
    }

    /// Depth of each hit by ray, what starts inside, and the depth of the largest logit of rays that miss.
    fn compare(ours: &March, truth: &March) {
        let indices = |march: &March| march.hits.as_ref().map(|hits| hits.index.clone().into_data());
        assert!(indices(truth).is_some_and(|hits| hits.num_elements() > 20), "too few hits to compare");
        assert_eq!(indices(ours), indices(truth));
        assert_eq!(ours.status, truth.status);
        let depths = |march: &March| march.hits.as_ref().map(|hits| hits.depth.clone()).expect("hits");
        let apart = (depths(ours) - depths(truth)).abs().max().into_scalar::<f32>();
        assert!(apart < 2e-5, "depths are {apart} apart");
        let missed: Vec<f32> =
            truth.status.iter().map(|&status| f32::from(u8::from(status == RayStatus::Misses))).collect();
        let missed = Tensor::<1>::from_floats(missed.as_slice(), &truth.max_logit_depth.device());
        let apart = (ours.max_logit_depth.clone() - truth.max_logit_depth.clone()) * missed;
        // Two samples may have the same logit, to rounding: few rays may differ.
        let differ = apart.abs().greater_elem(1e-4).float().sum().into_scalar::<f32>();
        assert!(differ <= 2.0, "{differ} rays have another largest logit");
    }

    #[test]
    fn a_snapshot_answers_as_the_decoder_does() {
        for config in [DecoderConfig::new().with_hidden(40).with_octaves(3), DecoderConfig::new().with_leaky(true)] {
            let decoder = decoder(&config);
            let surface = FieldSurface::new(&decoder);
            let device = Device::flex();
            let tensor = Drawn(7).draw([300, 3], &device) * 0.5;
            let flat: Vec<f32> = tensor.clone().into_data().iter::<f32>().collect();
            let points: Vec<Vec3> = flat.as_chunks().0.iter().map(|&p| Vec3::from_array(p)).collect();
            let query = Query::new(tensor);
            let expected = decoder.evaluate(&query);
            let close = |ours: Vec<f32>, truth: Vec<f32>, what: &str| {
                assert_eq!(ours.len(), truth.len(), "{what}");
                let worst = largest(ours.iter().zip(&truth).map(|(a, b)| (a - b).abs() / b.abs().max(1.0)));
                assert!(worst < 1e-4, "{what}: {worst}");
            };
            close(surface.logits(&points), expected.occupancy_logit.into_data().iter::<f32>().collect(), "logits");
            let colors = surface.colors(&points, &[], None).expect("colours").concat();
            close(colors, expected.color.into_data().iter::<f32>().collect(), "colours");
            let gradients = surface.gradients(&points).expect("gradients");
            let gradients = gradients.iter().flat_map(|g| g.to_array()).collect();
            close(gradients, decoder.occupancy_gradient(&query).into_data().iter::<f32>().collect(), "gradients");
        }
    }

    #[test]
    fn marching_snapshots_finds_what_marching_tensors_finds() {
        let decoder = decoder(&DecoderConfig::new().with_hidden(32).with_octaves(2));
        let rays = rays(24);
        let device = Device::flex();
        let jitter = Drawn(6).draw([rays.len()], &device) * 0.5 + 0.5;
        for (steps, jitter) in [(128, None), (17, None), (33, Some(jitter))] {
            let settings = MarchSettings { steps, ..MarchSettings::default() };
            let snapshots = decoder.snapshots();
            let ours = SnapshotMarcher::new(&snapshots, settings).march(&rays, jitter.clone());
            compare(&ours, &TensorMarcher::new(&decoder, settings).march(&rays, jitter));
        }
    }

    #[test]
    fn rays_of_many_objects_each_meet_their_own() {
        let config = DecoderConfig::new().with_hidden(32).with_code_dim(4);
        rays_meet_their_own(&config);
        rays_meet_their_own(&config.with_octaves(2).with_film(true));
    }

    fn rays_meet_their_own(config: &DecoderConfig) {
        let decoder = decoder(config);
        let device = Device::flex();
        let codes = Drawn(8).draw([3, 4], &device) * 0.1;
        let field = decoder.with_codes(codes);
        let mut rays = rays(24);
        rays.object = Some(Tensor::<1, Int>::arange(0..rays.len() as i64, &device).remainder_scalar(3));
        let settings = MarchSettings { steps: 32, ..MarchSettings::default() };
        let snapshots = field.snapshots();
        assert_eq!(snapshots.len(), 3);
        let ours = SnapshotMarcher::new(&snapshots, settings).march(&rays, None);
        compare(&ours, &TensorMarcher::new(&field, settings).march(&rays, None));
    }
}
