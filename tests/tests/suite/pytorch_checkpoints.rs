//! Checkpoints of DVR's reference code: read, compared with what that code computes, and written again.

use std::collections::BTreeMap;
use std::path::PathBuf;

use burn::tensor::{Device, Tensor, TensorData};
use burn_store::pytorch_reader::{DType, PytorchReader};
use dvr_model::*;
use dvr_tests::{seeded, *};

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
        let (config, expected) = fixture_decoder(code_dim, &device);
        for ending in ["", "_legacy"] {
            let path = fixture(&format!("decoder_c{code_dim}_h64{ending}.pt"));
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

#[test_with(large_fixture("resnet18_c256_fp16.pt"))]
fn a_resnet_round_trips_bit_for_bit_and_gives_the_reference_codes() {
    let (path, mut truth) = (large_fixture("resnet18_c256_fp16.pt"), Fixture::open("resnet18_io"));
    let device = Device::flex();
    let config =
        ImageModelConfig { decoder: DecoderConfig::new().with_code_dim(256).with_hidden(4), ..Default::default() };
    let mut model = seeded(0, || config.init(&device));
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
            let path = fixture(&format!("{name}{ending}.pt"));
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

/// Names, shapes and values of tensors.
type StateDict = Vec<(String, Vec<usize>, Vec<f32>)>;

/// A network's tensors as a state dict, by way of the safetensors file that it exports.
fn state_dict<C: NetworkConfig>(network: &C::Network, config: &C) -> StateDict {
    let bytes = to_safetensors(network, config).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let floats = file.iter().filter(|(_, tensor)| tensor.dtype() == safetensors::Dtype::F32);
    let tensors = floats.map(|(name, tensor)| {
        let values = tensor.data().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        (name.to_owned(), tensor.shape().to_vec(), values)
    });
    let mut tensors: Vec<_> = tensors.collect();
    tensors.sort_by(|a, b| a.0.cmp(&b.0));
    tensors
}

/// Writes tensors as the reference code writes a checkpoint, and reads it.
fn read_model(tensors: StateDict) -> Result<PytorchCheckpoint, RecordError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.pt");
    let entries = vec![("model".to_owned(), Entry::tensors(tensors)), ("it".to_owned(), Entry::Whole(7))];
    write_pytorch(&path, &Entry::Dict(entries));
    read_pytorch(&path, true, &Device::flex())
}

fn small() -> ImageModelConfig {
    let decoder = DecoderConfig::new().with_code_dim(3).with_hidden(4).with_blocks(2).with_leaky(true);
    ImageModelConfig { encoder: EncoderConfig::Convolutional { image_size: 224, width: 2 }, decoder }
}

#[test]
fn encoder_and_decoder_come_out_as_they_went_in_and_the_shapes_tell_the_configuration() {
    let kinds = [small().encoder, EncoderConfig::Codes { objects: 5 }, EncoderConfig::Resnet18 { image_size: 224 }];
    for encoder in kinds {
        let config = ImageModelConfig { encoder, ..small() };
        let tensors = state_dict(&seeded(0, || config.init(&Device::flex())), &config);
        let checkpoint = read_model(tensors.clone()).unwrap();
        assert_eq!(checkpoint.iteration, Some(7));
        let ImportedNetwork::ImageModel(imported) = checkpoint.network else { panic!("it has an encoder") };
        assert_eq!(imported.config, config);
        assert!(state_dict(&imported.network, &config) == tensors);
        assert!(imported.adam.is_none());
    }
}

#[test]
fn a_network_without_texture_is_grey() {
    let config = small();
    let mut tensors = state_dict(&seeded(0, || config.init(&Device::flex())), &config);
    for (name, shape, values) in &mut tensors {
        if name.starts_with("decoder.fc_out") {
            values.truncate(values.len() / 4);
            shape[0] = 1;
        }
    }
    let checkpoint = read_model(tensors).unwrap();
    assert!(checkpoint.notes[0].contains("no texture"), "{:?}", checkpoint.notes);
    let ImportedNetwork::ImageModel(imported) = checkpoint.network else { panic!("it has an encoder") };
    let points = tensor3(&[[0.1, 0.2, 0.3]], &Device::flex());
    let out = numbers(imported.network.decoder.forward(points, Some(Tensor::ones([1, 3], &Device::flex()))));
    assert!(out[0] != 0.0 && out[1..] == [0.0; 3], "{out:?}");
}

/// What is wrong with a state dict.
type Change<'a> = &'a dyn Fn(&mut StateDict);

#[test]
fn tensors_that_the_reference_code_does_not_have_are_named() {
    let config = small();
    let good = state_dict(&seeded(0, || config.init(&Device::flex())), &config);
    let refusal = |change: Change| {
        let mut tensors = good.clone();
        change(&mut tensors);
        read_model(tensors).map(|_| ()).unwrap_err().to_string()
    };
    let cases: [(Change, &str); 6] = [
        (&|t| t.retain(|(name, ..)| name != "decoder.blocks.1.fc_1.bias"), "blocks.1.fc_1.bias"),
        (&|t| t.push(("decoder.fc_z.weight".into(), vec![1], vec![0.0])), "decoder.fc_z.weight"),
        (&|t| t.retain(|(name, ..)| !name.starts_with("decoder.")), "no decoder"),
        (&|t| t.retain(|(name, ..)| !name.starts_with("encoder.conv0")), "an encoder whose tensors begin with"),
        (&|t| t.push(("encoder.conv4.bias".into(), vec![2], vec![0.0; 2])), "encoder.conv4.bias"),
        (&|t| t.push(("decoder.fc_p.weight".into(), vec![4, 9], vec![0.0; 36])), "has the shape [4, 9]"),
    ];
    for (change, named) in cases {
        let message = refusal(change);
        assert!(message.contains(named), "{named}: {message}");
    }
    let larger = refusal(&|t| {
        t.retain(|(name, ..)| name.starts_with("decoder."));
        t.push(("encoder.features.layer1.0.conv1.weight".into(), vec![1], vec![0.0]));
        t.push(("encoder.features.layer1.2.conv1.weight".into(), vec![1], vec![0.0]));
    });
    assert!(larger.contains("larger ResNet"), "{larger}");
}

#[test]
fn a_checkpoint_that_is_cut_short_is_refused() {
    for ending in ["", "_legacy"] {
        let path = fixture(&format!("decoder_c0_h64{ending}.pt"));
        let bytes = std::fs::read(path).unwrap();
        let folder = tempfile::tempdir().unwrap();
        for share in [1, 5, 9] {
            let path = folder.path().join("cut.pt");
            std::fs::write(&path, &bytes[..bytes.len() * share / 10]).unwrap();
            let message = read_pytorch(&path, false, &Device::flex()).map(|_| ()).unwrap_err().to_string();
            assert!(message.contains("not a readable file of tensors"), "{message}");
        }
    }
}

#[test]
fn an_encoder_starts_from_torchvisions_features_whatever_the_classifier() {
    let device = Device::flex();
    let config = ImageModelConfig { encoder: EncoderConfig::default(), ..small() };
    let donor = seeded(0, || config.init(&device));
    let prefix = "encoder.features.";
    let features = state_dict(&donor, &config).into_iter().filter(|(name, ..)| name.starts_with(prefix));
    let features: Vec<_> =
        features.map(|(name, shape, values)| (name[prefix.len()..].to_owned(), shape, values)).collect();
    let mut file = features.clone();
    file.push(("fc.weight".into(), vec![10, 512], vec![0.5; 5120]));
    file.push(("fc.bias".into(), vec![10], vec![0.5; 10]));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("resnet18.pth");
    write_pytorch(&path, &Entry::tensors(file));

    let mut model = seeded(0, || config.init(&device));
    let last =
        |model: &ImageModel| state_dict(model, &config).into_iter().find(|t| t.0 == "encoder.fc.weight").unwrap();
    let before = last(&model);
    model.encoder = load_pretrained(model.encoder, &path, &device).unwrap();
    assert!(last(&model) == before, "the last layer is not the classifier");
    let taken = state_dict(&model, &config).into_iter().filter(|(name, ..)| name.starts_with(prefix));
    assert!(taken.map(|(name, shape, values)| (name[prefix.len()..].to_owned(), shape, values)).eq(features));

    // And it is trained on from there.
    let tracking = device.clone().autodiff();
    let Encoder::Resnet18(trained) =
        load_pretrained(seeded(0, || config.init(&tracking)).encoder, &path, &tracking).unwrap()
    else {
        panic!("as configured");
    };
    let gradients = trained.forward(Tensor::ones([1, 3, 32, 32], &tracking)).sum().backward();
    assert!(trained.features.conv1.weight.val().grad(&gradients).is_some());

    let other = seeded(0, || small().init(&device)).encoder;
    assert!(load_pretrained(other, &path, &device).unwrap_err().to_string().contains("the encoder is another"));
}
