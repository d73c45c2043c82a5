//! What every encoder promises.

use burn::store::ModuleRecord;
use burn::tensor::{Distribution, TensorData};

use super::resnet18::normalised;
use super::*;
use crate::ImageModelConfig;

fn images(count: usize, size: usize, device: &Device) -> Tensor<4> {
    let inner = device.clone().inner();
    inner.seed(7);
    let random = Tensor::<4>::random([count, 3, size, size], Distribution::Uniform(0.0, 1.0), &inner);
    if device.is_autodiff() { Tensor::from_inner(random) } else { random }
}

fn objects(rows: &[i64], device: &Device) -> Tensor<1, Int> {
    Tensor::from_data(TensorData::new(rows.to_vec(), [rows.len()]), device)
}

fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().iter::<f32>().collect()
}

#[test]
fn every_kind_makes_a_code_a_row() {
    let device = Device::flex();
    let kinds = [
        (EncoderConfig::Resnet18 { image_size: 32 }, 32),
        (EncoderConfig::Convolutional { image_size: 63, width: 2 }, 63),
        (EncoderConfig::ConvolutionalBn { image_size: 64, width: 2 }, 64),
        (EncoderConfig::ConvolutionalBn { image_size: 100, width: 2 }, 100),
        (EncoderConfig::ConvolutionalBn { image_size: 16, width: 2 }, 16),
        (EncoderConfig::Local { image_size: 64, width: 2, channels: 3 }, 64),
        (EncoderConfig::LocalBn { image_size: 16, width: 2, channels: 3 }, 16),
        (EncoderConfig::Codes { objects: 5 }, 16),
    ];
    for (config, size) in kinds {
        let encoder = config.init(6, &device);
        let codes = encoder.forward(images(2, size, &device), objects(&[4, 0], &device));
        assert_eq!(codes.dims(), [2, 6], "{config:?}");
    }
}

#[test]
fn a_learned_code_is_that_of_its_object_whatever_the_image() {
    let device = Device::flex();
    let Encoder::Codes(codes) = EncoderConfig::Codes { objects: 3 }.init(4, &device) else { unreachable!() };
    let table = values(codes.weight.val());
    assert_eq!(values(codes.forward(objects(&[2, 2, 0], &device))), [&table[8..], &table[8..], &table[..4]].concat());
    assert!(table.iter().all(|v| v.abs() < 0.06) && table.iter().any(|v| *v != 0.0), "{table:?}");
}

#[test]
fn training_normalises_by_the_batch_and_prediction_by_what_training_has_seen() {
    let device = Device::flex();
    let tracking = device.clone().autodiff();
    let encoder = Resnet18::new(4, &tracking);
    let two = images(2, 32, &tracking);
    let first = two.clone().narrow(0, 0, 1);
    // In training the other image of the batch matters, in prediction it does not.
    let [alone, together] = [first.clone(), two.clone()].map(|batch| encoder.forward(batch).narrow(0, 0, 1));
    assert!(values((alone - together).abs().max()) > [1e-3].to_vec());
    let frozen = encoder.valid();
    let [alone, together] =
        [first, two.clone()].map(|batch| values(frozen.forward(batch.without_autodiff()).narrow(0, 0, 1)));
    for (a, b) in alone.iter().zip(&together) {
        assert!((a - b).abs() < 1e-4, "{alone:?} {together:?}");
    }
    // Statistics that have seen this batch often are this batch's.
    for _ in 0..60 {
        encoder.forward(two.clone());
    }
    let channels = values(encoder.features.conv1.forward(normalised(two)).mean_dims(&[0, 2, 3]));
    for (running, batch) in values(encoder.features.bn1.running_mean.value()).iter().zip(&channels) {
        assert!((running - batch).abs() < 5e-3 * batch.abs().max(1.0), "{running} {batch}");
    }
    assert_eq!(values(encoder.features.batches_tracked.value()), [62.0]);
}

#[test]
fn a_record_taken_right_after_a_step_holds_that_steps_statistics() {
    let device = Device::flex().autodiff();
    let encoder = Resnet18::new(4, &device);
    encoder.forward(images(2, 32, &device));
    let record = encoder.clone().into_record().into_bytes().unwrap();
    let read = Resnet18::new(4, &device).try_load_record(ModuleRecord::from_bytes(record).unwrap()).unwrap();
    let mean = |of: &Resnet18| values(of.features.layer4[1].bn2.running_mean.value_sync());
    assert!(mean(&encoder).iter().any(|m| *m != 0.0));
    assert_eq!(mean(&encoder), mean(&read));
    assert_eq!(values(read.features.batches_tracked.value()), [1.0]);
}

#[test]
fn the_small_encoder_normalises_by_the_batch_in_training_and_by_what_it_has_seen_in_prediction() {
    let tracking = Device::flex().autodiff();
    let encoder = ConvolutionalBn::new(2, 4, &tracking);
    let two = images(2, 64, &tracking);
    let first = two.clone().narrow(0, 0, 1);
    let [alone, together] = [first.clone(), two.clone()].map(|batch| encoder.forward(batch).narrow(0, 0, 1));
    assert!(values((alone - together.clone()).abs().max()) > [1e-3].to_vec());
    // What has seen a batch often takes it as training does, all at once or one by one.
    for _ in 0..60 {
        encoder.forward(two.clone());
    }
    let frozen = encoder.valid();
    let record = encoder.into_record().into_bytes().unwrap();
    let read =
        ConvolutionalBn::new(2, 4, &tracking).try_load_record(ModuleRecord::from_bytes(record).unwrap()).unwrap();
    for encoder in [frozen, read.valid()] {
        let code = values(encoder.forward(first.clone().without_autodiff()));
        for (found, expected) in code.iter().zip(values(together.clone())) {
            assert!((found - expected).abs() < 0.05 * expected.abs().max(0.5), "{found} {expected}");
        }
    }
}

#[test]
fn where_an_object_stands_in_the_picture_changes_the_small_encoder_s_code() {
    let device = Device::flex();
    let encoder = ConvolutionalBn::new(4, 4, &device);
    let square = |left: usize| {
        let white = Tensor::<4>::ones([1, 3, 64, 64], &device);
        white.slice_assign([0..1, 0..3, 16..32, left..left + 16], Tensor::zeros([1, 3, 16, 16], &device))
    };
    let [left, right] = [square(0), square(32)].map(|image| values(encoder.forward(image)));
    assert!(left.iter().zip(&right).any(|(a, b)| (a - b).abs() > 1e-3), "{left:?} {right:?}");
}

#[test]
fn configurations_read_like_json_with_defaults() {
    let read = |json: &str| serde_json::from_str::<EncoderConfig>(json);
    let normalised = EncoderConfig::ConvolutionalBn { image_size: 64, width: 32 };
    assert_eq!(read(r#"{"kind": "convolutional-bn"}"#).unwrap(), normalised);
    assert_eq!(read(r#"{"kind": "resnet18"}"#).unwrap(), EncoderConfig::default());
    let small = EncoderConfig::Convolutional { image_size: 64, width: 32 };
    assert_eq!(read(r#"{"kind": "convolutional", "image_size": 64}"#).unwrap(), small);
    assert_eq!(read(r#"{"kind": "codes"}"#).unwrap(), EncoderConfig::Codes { objects: 0 });
    assert!(read(r#"{"kind": "resnet101"}"#).unwrap_err().to_string().contains("resnet18"));
    assert!(read(r#"{"kind": "codes", "width": 3}"#).unwrap_err().to_string().contains("width"));
    let json = serde_json::to_string(&ImageModelConfig::default()).unwrap();
    assert_eq!(serde_json::from_str::<ImageModelConfig>(&json).unwrap(), ImageModelConfig::default());
}

#[test]
fn values_without_a_model_are_refused_by_name() {
    let with = |change: fn(&mut ImageModelConfig)| {
        let mut config = ImageModelConfig::default();
        change(&mut config);
        config.check().map_err(|e| e.to_string())
    };
    assert_eq!(with(|_| ()), Ok(()));
    assert!(with(|c| c.decoder.code_dim = 0).unwrap_err().contains("code_dim"));
    assert!(with(|c| c.encoder = EncoderConfig::Resnet18 { image_size: 8 }).unwrap_err().contains("image_size"));
    let small = |c: &mut ImageModelConfig| c.encoder = EncoderConfig::Convolutional { image_size: 62, width: 32 };
    assert!(with(small).unwrap_err().contains("image_size"));
}
