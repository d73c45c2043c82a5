//! What each stage costs: `cargo bench -p dvr-train`.
//!
//! The field is the original's decoder at width 128 and 512, fitted for a moment to a ball so that rays hit something.
//! Rays are those of a camera that looks at the cube, as in training.

use std::hint::black_box;
use std::path::Path;

use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams};
use burn::tensor::activation::softplus;
use burn::tensor::{Device, Distribution, Tensor};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::{Camera, Ray, Scene, UnitCube};
use dvr_model::{Decoder, DecoderConfig};
use dvr_render::extract::{ExtractSettings, FieldSurface, extract_mesh};
use dvr_render::{
    Crossing, Field, FieldShader, MarchSettings, Marcher, Query, Rays, RenderSettings, Shader, SkipGrid, SlopeRule,
    Surface, TensorMarcher, implicit_depth,
};
use dvr_train::{Capacity, GridConfig, GridTrainer, Supervision, TrainConfig, Trainer};
use glam::{DVec3, Vec3};

const RAYS: usize = 1024;

/// A decoder that knows a ball of radius 0.3.
fn decoder(hidden: usize, device: &Device) -> Decoder {
    device.seed(0);
    let autodiff = device.clone().autodiff();
    let mut decoder = DecoderConfig::new().with_hidden(hidden).init(&autodiff);
    let mut adam = AdamConfig::new().init();
    for _ in 0..200 {
        let points = Tensor::<2>::random([512, 3], Distribution::Uniform(-0.4, 0.4), &autodiff);
        let distance = points.clone().square().sum_dim(1).sqrt().squeeze_dim::<1>(1);
        let sign = (distance - 0.3).sign();
        let loss = softplus(decoder.occupancy_logit(&Query::new(points)) * sign, 1.0).mean();
        let gradients = GradientsParams::from_grads(loss.backward(), &decoder);
        decoder = adam.step(1e-3, decoder, gradients);
    }
    decoder
}

/// Rays of a camera in front of the cube, evenly over its picture.
fn camera_rays() -> Vec<Ray> {
    let camera = Camera::look_at(32, 32, 40.0, DVec3::new(0.7, 0.5, -1.2), DVec3::ZERO, DVec3::Y);
    (0..RAYS as u32).map(|i| camera.pixel_ray(i % 32, i / 32)).collect()
}

fn rays(device: &Device) -> Rays {
    Rays::new(&camera_rays(), UnitCube::default(), device)
}

fn marching(c: &mut Criterion) {
    let device = Device::flex();
    let mut group = c.benchmark_group("march");
    group.sample_size(10).throughput(Throughput::Elements(RAYS as u64));
    for hidden in [128, 512] {
        let field = decoder(hidden, &device).valid();
        let rays = rays(&device);
        let settings = MarchSettings { steps: 128, root_steps: 8, ..MarchSettings::default() };
        let surface = FieldSurface::new(&field);
        let tensors = TensorMarcher::new(&field, settings);
        group.bench_function(format!("{hidden} wide, 128 samples + 8, tensors"), |b| {
            b.iter(|| black_box(tensors.march(&rays, None)));
        });
        let fused = surface.marcher(settings);
        group.bench_function(format!("{hidden} wide, 128 samples + 8, fused"), |b| {
            b.iter(|| black_box(fused.march(&rays, None)));
        });
        let skip = SkipGrid::build(&surface, UnitCube::default(), 64);
        let shading = RenderSettings { march: settings, ..RenderSettings::default() };
        let shader = FieldShader::new(&field, shading, Some(&skip));
        let rays = camera_rays();
        group.bench_function(format!("{hidden} wide, 128 samples + 8, fused, skipping, shaded"), |b| {
            b.iter(|| black_box(shader.shade(&rays)));
        });
    }
    group.finish();
}

/// The fused evaluator of the original's decoder. Elements are floating-point operations: reports are in (G)FLOP/s.
fn fused_decoder(c: &mut Criterion) {
    const POINTS: usize = 16_384;
    let device = Device::flex();
    let mut group = c.benchmark_group("fused decoder");
    group.sample_size(10);
    let points: Vec<Vec3> = (0..POINTS as u32)
        .map(|i| Vec3::new((i as f32).sin(), (1.7 * i as f32).cos(), (2.3 * i as f32).sin()) * 0.4)
        .collect();
    for hidden in [64, 128, 512] {
        let field = decoder(hidden, &device).valid();
        let snapshots = field.snapshots();
        // Five blocks of two layers; the first and the last layer are small.
        let operations = POINTS * (5 * 2 * 2 * hidden * hidden + 2 * hidden * (3 + 1));
        group.throughput(Throughput::Elements(operations as u64));
        group.bench_function(format!("{hidden} wide, logits"), |b| b.iter(|| black_box(snapshots[0].logits(&points))));
    }
    group.finish();
}

fn root_search(c: &mut Criterion) {
    let device = Device::flex();
    let field = decoder(128, &device).valid();
    let rays = rays(&device);
    let mut group = c.benchmark_group("root search, 128 wide, 16 samples");
    group.sample_size(10);
    for root_steps in [0, 4, 8] {
        let settings = MarchSettings { steps: 16, root_steps, ..MarchSettings::default() };
        let surface = FieldSurface::new(&field);
        let marcher = surface.marcher(settings);
        group.bench_function(format!("{root_steps} steps"), |b| b.iter(|| black_box(marcher.march(&rays, None))));
    }
    group.finish();
}

fn depth_operation(c: &mut Criterion) {
    let device = Device::flex();
    let mut group = c.benchmark_group("differentiable depth");
    group.sample_size(10);
    for hidden in [128, 512] {
        let field = decoder(hidden, &device);
        let frozen = field.valid();
        let settings = MarchSettings { steps: 64, ..MarchSettings::default() };
        let hits = TensorMarcher::new(&frozen, settings).march(&rays(&device), None).hits.expect("the ball is hit");
        group.bench_function(format!("{hidden} wide, {} hits, forward", hits.len()), |b| {
            b.iter(|| black_box(Surface::on_graph(&field, &frozen, &hits, SlopeRule::default())));
        });
        group.bench_function(format!("{hidden} wide, {} hits, forward and backward", hits.len()), |b| {
            b.iter(|| {
                let surface = Surface::on_graph(&field, &frozen, &hits, SlopeRule::default());
                black_box((surface.depth.sum() + surface.color.sum()).backward())
            });
        });
    }
    let autodiff = device.clone().autodiff();
    let logit = Tensor::<1>::random([RAYS], Distribution::Default, &autodiff).require_grad();
    let ones = Tensor::<1>::ones([RAYS], &autodiff);
    group.bench_function("the operation alone, forward and backward", |b| {
        b.iter(|| black_box(implicit_depth(logit.clone(), ones.clone(), ones.clone()).sum().backward()));
    });
    group.finish();
}

/// The project's own demo scene.
fn demo_folder() -> std::path::PathBuf {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes");
    let mut folders: Vec<_> = std::fs::read_dir(scenes)
        .expect("assets")
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.is_dir())
        .collect();
    folders.sort();
    folders.remove(0)
}

fn demo_scene() -> Scene {
    read_scene(&demo_folder(), &ReadOptions::default()).expect("the demo scene is readable")
}

fn training_step(c: &mut Criterion) {
    let device = Device::flex();
    let scene = demo_scene();
    let mut group = c.benchmark_group("training step, 1024 rays, 16 samples");
    group.sample_size(10);
    for hidden in [128, 512] {
        let config = TrainConfig {
            march: vec![dvr_train::MarchStage { from_percent: 0, samples: 16 }],
            ..TrainConfig::new(Supervision::Rgb)
        };
        let field = decoder(hidden, &device);
        let mut trainer = Trainer::new(field, scene.views.iter().collect(), Vec::new(), config, device.clone());
        group.bench_function(format!("{hidden} wide"), |b| b.iter(|| trainer.step().expect("the loss is finite")));
    }
    group.finish();
}

fn extraction(c: &mut Criterion) {
    let device = Device::flex();
    let field = decoder(128, &device).valid();
    let surface = FieldSurface::new(&field);
    let mut group = c.benchmark_group("extraction, 128 wide");
    group.sample_size(10);
    for resolution in [128, 256] {
        let settings = ExtractSettings { resolution, ..ExtractSettings::default() };
        group.bench_function(format!("{resolution}^3"), |b| {
            b.iter(|| black_box(extract_mesh(&surface, &settings, &[]).expect("the ball has a surface")));
        });
    }
    group.finish();
}

/// The fast method: its step, and rays that meet a grid.
fn grids(c: &mut Criterion) {
    let scene = demo_scene();
    let mut group = c.benchmark_group("grid field");
    for cells in [64, 128] {
        let config = GridConfig {
            capacity: Capacity::Cells(cells),
            first_cells: cells,
            steps: usize::MAX / 2,
            ..GridConfig::default()
        };
        let mut trainer =
            GridTrainer::new(scene.views.iter().collect(), Vec::new(), config).expect("the masks show the object");
        group.throughput(Throughput::Elements(2048));
        group.bench_function(format!("training step, {cells} cells, 2048 rays"), |b| {
            b.iter(|| trainer.step().expect("the loss is finite"));
        });
        let field = trainer.field().expect("the field is here");
        let camera = Camera::look_at(256, 256, 320.0, DVec3::new(0.7, 0.5, -1.2), DVec3::ZERO, DVec3::Y);
        let rays: Vec<Ray> = (0..256 * 256).map(|i| camera.pixel_ray(i % 256, i / 256)).collect();
        group.throughput(Throughput::Elements(rays.len() as u64));
        group.bench_function(format!("rays shaded, {cells} cells"), |b| b.iter(|| black_box(field.shade(&rays))));
        let settings = ExtractSettings::default();
        group.sample_size(10).bench_function(format!("extraction at 256^3, {cells} cells"), |b| {
            b.iter(|| black_box(extract_mesh(&field, &settings, &[]).expect("there is a surface")));
        });
    }
    group.finish();
}

fn reading(c: &mut Criterion) {
    let folder = demo_folder();
    c.bench_function("reading the demo scene", |b| {
        b.iter(|| black_box(read_scene(&folder, &ReadOptions::default()).expect("the demo scene is readable")));
    });
}

criterion_group!(
    benches,
    fused_decoder,
    marching,
    root_search,
    depth_operation,
    training_step,
    extraction,
    grids,
    reading
);
criterion_main!(benches);
