//! The original's checkpoints: read, compared with what its own code computes, and written again.

use std::collections::BTreeMap;
use std::path::PathBuf;

use burn::tensor::{Device, Tensor, TensorData};
use burn_store::pytorch_reader::{DType, PytorchReader};
use dvr_model::*;
use dvr_tests::*;

fn fixture(name: &str) -> Option<PathBuf> {
    Some(shared("fixtures")?.join(name))
}

/// Tensors of a PyTorch file as the numbers they are, by name below `prefix`; counts too.
fn in_file(path: &PathBuf, prefix: &str) -> BTreeMap<String, Vec<f64>> {
    let file = PytorchReader::with_top_level_key(path, "model").unwrap();
    let tensors = file.tensors().iter().filter_map(|(name, tensor)| {
        let bytes = tensor.read().unwrap();
        let numbers = match tensor.dtype() {
            DType::F32 => bytes.chunks_exact(4).map(|b| f32::from_ne_bytes(b.try_into().unwrap()).into()).collect(),
            DType::F16 => bytes.chunks_exact(2).map(|b| half(u16::from_ne_bytes(b.try_into().unwrap()))).collect(),
            DType::I64 => bytes.chunks_exact(8).map(|b| i64::from_ne_bytes(b.try_into().unwrap()) as f64).collect(),
            other => panic!("{name}: {other:?}"),
        };
        Some((name.strip_prefix(prefix)?.to_owned(), numbers))
    });
    tensors.collect()
}

/// A number of 16 bits.
fn half(bits: u16) -> f64 {
    let (sign, exponent, fraction) = (bits >> 15, i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    let magnitude =
        if exponent == 0 { fraction * 2f64.powi(-24) } else { (1.0 + fraction / 1024.0) * 2f64.powi(exponent - 15) };
    if sign == 1 { -magnitude } else { magnitude }
}

/// Tensors of a safetensors file of ours, with their shapes left out.
fn exported(bytes: &[u8]) -> BTreeMap<String, Vec<f64>> {
    let file = safetensors::SafeTensors::deserialize(bytes).unwrap();
    let tensors = file.iter().map(|(name, tensor)| {
        let numbers = match tensor.dtype() {
            safetensors::Dtype::F32 => {
                tensor.data().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()).into()).collect()
            }
            _ => tensor.data().chunks_exact(8).map(|b| i64::from_le_bytes(b.try_into().unwrap()) as f64).collect(),
        };
        (name.to_owned(), numbers)
    });
    tensors.collect()
}

fn decoder_of(checkpoint: PytorchCheckpoint) -> Imported<DecoderConfig> {
    match checkpoint.network {
        ImportedNetwork::Decoder(imported) => *imported,
        ImportedNetwork::ImageModel(_) => panic!("there is no encoder in it"),
    }
}

#[test]
fn a_decoder_comes_out_bit_for_bit_as_it_went_in_zip_and_legacy() {
    let device = Device::flex();
    for code_dim in [0, 32] {
        let Some((config, expected)) = fixture_decoder(code_dim, &device) else { return };
        for ending in ["", "_legacy"] {
            let path = fixture(&format!("decoder_c{code_dim}_h64{ending}.pt")).unwrap();
            let checkpoint = read_pytorch(&path, false, &device).unwrap();
            assert_eq!((checkpoint.epoch, checkpoint.iteration), (Some(41), Some(1234)));
            assert_eq!(checkpoint.best_validation, Some(0.875));
            assert!(checkpoint.notes.is_empty(), "{:?}", checkpoint.notes);
            let imported = decoder_of(checkpoint);
            assert_eq!(imported.config, config, "c{code_dim}{ending}");
            let again = exported(&to_safetensors(&imported.network, &imported.config).unwrap());
            assert!(again == in_file(&path, "decoder."), "c{code_dim}{ending}");
            assert!(again == exported(&to_safetensors(&expected, &config).unwrap()));
        }
    }
}

#[test]
fn a_resnet_comes_out_bit_for_bit_as_it_went_in_and_gives_the_originals_codes() {
    let (Some(path), Some(mut truth)) = (fixture("resnet18_c256_fp16.pt"), Fixture::open("resnet18_io")) else {
        return;
    };
    let device = Device::flex();
    let config =
        ImageModelConfig { decoder: DecoderConfig::new().with_code_dim(256).with_hidden(4), ..Default::default() };
    let mut model = config.init(&device);
    model.encoder = load_pretrained(model.encoder, &path, &device).unwrap();
    let mut again = exported(&to_safetensors(&model, &config).unwrap());
    again.retain(|name, _| name.starts_with("encoder."));
    assert!(again == in_file(&path, ""));

    let Encoder::Resnet18(resnet) = &model.encoder else { panic!("as configured") };
    let images = |numbers: Vec<f64>, size: usize| {
        let count = numbers.len() / (3 * size * size);
        Tensor::<4>::from_data(TensorData::new(numbers, [count, 3, size, size]), &device)
    };
    let small = images(truth.numbers("images64"), 64);
    let large = images(truth.numbers("images224_u8").iter().map(|v| v / 255.0).collect(), 224);
    for (name, codes) in [("c64", resnet.forward(small)), ("c224", resnet.forward(large))] {
        let difference = max_difference(&numbers(codes), &truth.numbers(name));
        assert!(difference < 1e-4, "{name}: {difference}");
    }
    assert!(read_pytorch(&path, false, &device).unwrap_err().to_string().contains("no decoder"));
}

#[test]
fn adams_moments_are_those_of_the_file_in_the_files_order() {
    let device = Device::flex();
    for name in ["decoder_c0_h64", "decoder_c32_h64"] {
        for ending in ["", "_legacy"] {
            let Some(path) = fixture(&format!("{name}{ending}.pt")) else { return };
            let imported = decoder_of(read_pytorch(&path, false, &device).unwrap());
            let adam = imported.adam.unwrap();
            assert!(adam.steps > 0);
            let file = PytorchReader::with_top_level_key(&path, "optimizer").unwrap();
            let floats = |key: &str| -> Vec<f64> {
                let bytes = file.get(key).unwrap_or_else(|| panic!("{key}")).read().unwrap();
                bytes.chunks_exact(4).map(|b| f32::from_ne_bytes(b.try_into().unwrap()).into()).collect()
            };
            // The first two parameters are fc_p's, the next two fc_out's.
            assert_eq!(numbers(adam.first.fc_p.weight.val().transpose()), floats("state.0.exp_avg"));
            assert_eq!(numbers(adam.second.fc_out.weight.val().transpose()), floats("state.2.exp_avg_sq"));
            assert_eq!(adam.first.fc_p.weight.id, imported.network.fc_p.weight.id);
        }
    }
}
