//! The lattice decoder against plain tensors in single precision, and as the field that it is made of.

use burn::tensor::Device;
use dvr_model::{LatticeDecoder, LatticeDecoderConfig};
use dvr_render::extract::{ExtractSettings, FieldSurface, ScalarField, extract_mesh};
use dvr_render::{Field, Query};
use dvr_tests::{devices, lattice_suite, numbers, tensor3};
use glam::Vec3;

#[test]
fn the_lattice_decoder_is_trilinear_interpolation_with_exact_derivatives() {
    for (name, device) in devices() {
        println!("{name}");
        lattice_suite::agrees_with_plain_tensors(&device, 2e-5);
    }
}

#[test]
fn a_field_is_the_same_before_and_after_it_was_a_module() {
    let device = Device::flex();
    let decoder = LatticeDecoderConfig::new().with_cells(12).with_color_cells(6).with_radius(0.3).init(&device);
    let field = decoder.to_field();
    let again = LatticeDecoder::from_field(&field, &device);
    assert_eq!(again.to_field().shape(), field.shape());
    assert_eq!(again.to_field().color(), field.color());
    let points = [[0.1, 0.2, -0.3], [0.0, 0.44, 0.1]];
    let logits = numbers(decoder.occupancy_logit(&Query::new(tensor3(&points, &device))));
    let points = points.map(|p: [f64; 3]| Vec3::from_array(p.map(|x| x as f32)));
    for (a, b) in logits.iter().zip(field.logits(&points)) {
        assert!((a - f64::from(b)).abs() < 1e-5);
    }
}

#[test]
fn it_starts_as_a_grey_ball() {
    let decoder = LatticeDecoderConfig::new().with_cells(24).with_radius(0.3).init(&Device::flex());
    assert_eq!(decoder.snapshots().len(), 1);
    let settings = ExtractSettings { resolution: 48, upsampling_steps: 1, ..ExtractSettings::default() };
    let mesh = extract_mesh(&FieldSurface::new(&decoder), &settings, &[]).unwrap().mesh;
    assert!(mesh.vertices.iter().all(|v| (v.length() - 0.3).abs() < 5e-3));
    assert!(mesh.colors.unwrap().iter().flatten().all(|c| (c - 0.5).abs() < 1e-5));
}
