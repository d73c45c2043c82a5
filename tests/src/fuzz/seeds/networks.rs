//! Networks, fields and checkpoints.

use std::collections::HashMap;

use burn::tensor::Device;
use dvr_core::files::encoded_jpeg;
use dvr_core::voxel::VoxelGrid;
use dvr_grid::{GridField, GridValues, grid_file};
use dvr_model::{DecoderConfig, EncoderConfig, ImageModelConfig, read_pytorch, to_safetensors};
use dvr_train::{Checkpoint, ImportOptions, LearnerState, Supervision, import, method_by_name};
use image::{Rgb, RgbImage};
use safetensors::serialize;
use safetensors::tensor::{Dtype, TensorView};

use super::written;
use crate::pytorch_file::{Entry, legacy_pytorch, write_pytorch};
use crate::seeded;

/// The tensors of a decoder of width 4 with two blocks, as a state dict, and Adam's state of them.
fn checkpoint_of_decoder(prefix: &str) -> Entry {
    let layers = [("fc_p", 4, 3), ("fc_out", 4, 4)];
    let blocks = (0..2).flat_map(|i| [format!("blocks.{i}.fc_0"), format!("blocks.{i}.fc_1")]);
    let layers = layers.map(|(name, out, input)| (name.to_owned(), out, input));
    let layers = layers.into_iter().chain(blocks.map(|name| (name, 4, 4)));
    let tensors: Vec<(String, Vec<usize>, Vec<f32>)> = layers
        .flat_map(|(name, out, input)| {
            let values = |count: usize| (0..count).map(|i| (i as f32).sin()).collect::<Vec<f32>>();
            let weight = (format!("{prefix}{name}.weight"), vec![out, input], values(out * input));
            [weight, (format!("{prefix}{name}.bias"), vec![out], values(out))]
        })
        .collect();
    let count = tensors.len() as i32;
    let moments = tensors.iter().enumerate().map(|(i, (_, shape, values))| {
        let moment = |name: &str| (name.to_owned(), Entry::Tensor(shape.clone(), values.clone()));
        let step = ("step".to_owned(), Entry::Whole(7));
        (i.to_string(), Entry::Dict(vec![step, moment("exp_avg"), moment("exp_avg_sq")]))
    });
    let state = Entry::Dict(moments.collect());
    let group = Entry::Dict(vec![
        ("lr".into(), Entry::Number(1e-4)),
        ("params".into(), Entry::List((0..count).map(Entry::Whole).collect())),
    ]);
    let optimizer = Entry::Dict(vec![("state".into(), state), ("param_groups".into(), Entry::List(vec![group]))]);
    Entry::Dict(vec![
        ("model".into(), Entry::tensors(tensors)),
        ("optimizer".into(), optimizer),
        ("epoch_it".into(), Entry::Whole(3)),
        ("it".into(), Entry::Whole(77)),
        ("loss_val_best".into(), Entry::Number(0.25)),
    ])
}

pub(in crate::fuzz) fn pt() -> Vec<Vec<u8>> {
    vec![written("a.pt", |path| write_pytorch(path, &checkpoint_of_decoder("decoder.")))]
}

pub(in crate::fuzz) fn pt_legacy() -> Vec<Vec<u8>> {
    vec![legacy_pytorch(&checkpoint_of_decoder("decoder."))]
}

pub(in crate::fuzz) fn safetensors() -> Vec<Vec<u8>> {
    let device = Device::flex();
    let decoder = DecoderConfig::new().with_hidden(4).with_blocks(2).with_octaves(1);
    let network = seeded(1, || decoder.init(&device));
    let coded = DecoderConfig::new().with_hidden(4).with_blocks(1).with_code_dim(3);
    let model = ImageModelConfig { encoder: EncoderConfig::Codes { objects: 2 }, decoder: coded };
    let codes = seeded(2, || model.init(&device));
    let bytes = [to_safetensors(&network, &decoder), to_safetensors(&codes, &model)];
    bytes.map(|bytes| bytes.unwrap_or_else(|e| panic!("{e}"))).into()
}

/// A ball on a grid.
fn ball(nodes: usize, color_nodes: usize) -> GridField {
    let (shape, color) = (VoxelGrid::new(nodes, 0.55), VoxelGrid::new(color_nodes, 0.55));
    let values = (0..shape.len()).map(|node| 0.3 - shape.position(node).length()).collect();
    let colors = (0..3 * color.len()).map(|i| (i % 7) as f32 / 7.0).collect();
    GridField::new(GridValues { grid: shape, values }, GridValues { grid: color, values: colors })
}

/// A field that is inside at some nodes.
pub(in crate::fuzz) fn field_of(nodes: usize, color_nodes: usize, is_inside: fn([usize; 3]) -> bool) -> Vec<u8> {
    let (shape, color) = (VoxelGrid::new(nodes, 0.55), VoxelGrid::new(color_nodes, 0.55));
    let side = |node: usize| if is_inside(shape.coordinates(node)) { shape.spacing() } else { -shape.spacing() };
    let values = (0..shape.len()).map(side).collect();
    let colors = vec![0.5; 3 * color.len()];
    let field = GridField::new(GridValues { grid: shape, values }, GridValues { grid: color, values: colors });
    grid_file::to_bytes(&field).unwrap_or_else(|e| panic!("{e}"))
}

pub(in crate::fuzz) fn scene_dvr() -> Vec<Vec<u8>> {
    [(9, 5), (5, 3), (3, 2)]
        .map(|(nodes, colors)| grid_file::to_bytes(&ball(nodes, colors)).unwrap_or_else(|e| panic!("{e}")))
        .into()
}

/// Colour that depends on the direction: at two nodes, at none, and with a photograph.
pub(in crate::fuzz) fn view_color() -> Vec<Vec<u8>> {
    vec![colors_at(&[3, 17], 4, None), colors_at(&[], 32, None), colors_at(&[3], 4, Some([8, 6]))]
}

/// The same at these nodes of a grid of so many cells, and with a photograph of 8 x 6 pixels that claims this size.
fn colors_at(nodes: &[u32], cells: usize, photograph: Option<[u32; 2]>) -> Vec<u8> {
    let count = nodes.len();
    let nodes: Vec<u8> = nodes.iter().flat_map(|node| node.to_le_bytes()).collect();
    // Ones, in 16 bits.
    let numbers = [0x00, 0x3c].repeat(27 * count);
    let view = |dtype, shape, bytes| TensorView::new(dtype, shape, bytes).unwrap_or_else(|e| panic!("{e}"));
    let mut tensors = vec![
        ("nodes", view(Dtype::U32, vec![count], &nodes)),
        ("coefficients", view(Dtype::F16, vec![count, 9, 3], &numbers)),
    ];
    let projection = [8.0f32, 0.0, 4.0, 8.0, 0.0, 8.0, 3.0, 6.0, 0.0, 0.0, 1.0, 2.0].map(f32::to_le_bytes).concat();
    let pixels = RgbImage::from_fn(8, 6, |u, v| Rgb([30 * u as u8, 40 * v as u8, 90]));
    let jpeg = encoded_jpeg(&pixels, 90, None).unwrap_or_else(|e| panic!("{e}"));
    let [width, height] = photograph.unwrap_or_default();
    let size = [width, height, 4, jpeg.len() as u32].map(u32::to_le_bytes).concat();
    // Twos, at three times three nodes.
    let depths = [0x00, 0x40].repeat(9);
    if photograph.is_some() {
        tensors.extend([
            ("photograph_projections", view(Dtype::F32, vec![1, 3, 4], &projection)),
            ("photograph_sizes", view(Dtype::U32, vec![1, 4], &size)),
            ("photograph_depths", view(Dtype::F16, vec![9], &depths)),
            ("photographs", view(Dtype::U8, vec![jpeg.len()], &jpeg)),
        ]);
    }
    let metadata = HashMap::from([("cells".to_owned(), cells.to_string())]);
    serialize(tensors, Some(metadata)).unwrap_or_else(|e| panic!("{e}"))
}

/// Cells, and pixels, that would take all memory, over no numbers.
pub(in crate::fuzz) fn claiming_cells() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("128 cells", colors_at(&[], 128, None)),
        ("1000 cells", colors_at(&[], 1000, None)),
        ("pixels of photographs", colors_at(&[], 4, Some([1 << 16, 1 << 16]))),
    ]
}

/// A grid's, an imported network's, and that of a model of two objects with codes.
pub(in crate::fuzz) fn checkpoints() -> Vec<Vec<u8>> {
    let saved =
        |checkpoint: &Checkpoint| written("a.ckpt", |path| checkpoint.save(path).unwrap_or_else(|e| panic!("{e}")));
    let network = imported();
    let method = method_by_name("grid", Supervision::Rgb).unwrap_or_else(|e| panic!("{e}"));
    let mut grid = network.clone();
    grid.header.method = method.record().unwrap_or_else(|e| panic!("{e}"));
    grid.header.common = method.common();
    grid.state = LearnerState { model: scene_dvr().remove(0), training: Vec::new() };
    vec![saved(&grid), saved(&network)]
}

fn imported() -> Checkpoint {
    let folder = tempfile::tempdir().unwrap_or_else(|e| panic!("no temporary folder: {e}"));
    let path = folder.path().join("a.pt");
    write_pytorch(&path, &checkpoint_of_decoder("decoder."));
    let device = Device::flex();
    let mut found = read_pytorch(&path, false, &device).unwrap_or_else(|e| panic!("{e}"));
    import(&mut found, ImportOptions::default(), &device).unwrap_or_else(|e| panic!("{e}"))
}

/// Headers of networks that would take all memory, over few numbers.
pub(in crate::fuzz) fn claiming() -> Vec<(&'static str, Vec<u8>)> {
    let file = |format: &str, config: &str| {
        let config = serde_json::to_string(config).unwrap_or_else(|e| panic!("{e}"));
        let header = format!(
            "{{\"__metadata__\":{{\"format\":\"{format}\",\"version\":\"1\",\"config\":{config}}},\
             \"a\":{{\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[0,4]}}}}"
        );
        [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &[0; 4]].concat()
    };
    let decoder = |hidden: u64, blocks: u64, octaves: u64| {
        format!("{{\"code_dim\":0,\"hidden\":{hidden},\"blocks\":{blocks},\"leaky\":false,\"octaves\":{octaves}}}")
    };
    let model = |encoder: &str| {
        let decoder = decoder(4, 1, 0).replace("\"code_dim\":0", "\"code_dim\":3");
        file("dvr-image-model", &format!("{{\"encoder\":{encoder},\"decoder\":{decoder}}}"))
    };
    vec![
        ("a width of a million", file("dvr-decoder", &decoder(1 << 20, 5, 0))),
        ("1e12 blocks of no width", file("dvr-decoder", &decoder(0, 1_000_000_000_000, 0))),
        ("a width that overflows", file("dvr-decoder", &decoder(u64::MAX, u64::MAX, u64::MAX))),
        ("1e12 codes", model("{\"kind\":\"codes\",\"objects\":1000000000000}")),
        ("a convolution of width 1e9", model("{\"kind\":\"convolutional\",\"image_size\":64,\"width\":1000000000}")),
    ]
}
