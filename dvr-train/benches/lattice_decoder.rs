//! The lattice decoder's operations beside the same in plain tensors: `cargo bench -p dvr-train --bench
//! lattice_decoder`.

use std::hint::black_box;

use burn::module::Module;
use burn::tensor::{Device, Distribution, Tensor};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use dvr_model::{LatticeDecoder, LatticeDecoderConfig};
use dvr_render::{Field, FieldValues, Query};

#[path = "../../tests/src/plain_lattice.rs"]
mod plain_lattice;

use plain_lattice::PlainCells;

/// As many as a step of some thousand rays asks for.
const POINTS: usize = 16_384;

fn sum(values: FieldValues) -> Tensor<1> {
    values.occupancy_logit.sum() + values.color.sum()
}

/// The sum of everything that a jet (or a plain evaluation) of a decoder says, in plain tensors.
fn plain(decoder: &LatticeDecoder, points: &Tensor<2>, directions: Option<&Tensor<2>>) -> Tensor<1> {
    let parts = [(decoder.shape_lattice(), &decoder.shape), (decoder.color_lattice(), &decoder.color)];
    let [shape, color] = parts.map(|(lattice, values)| {
        let (cells, values) = (PlainCells::new(lattice, points.clone()), values.val());
        let value = cells.value(&values).sum();
        directions.map_or(value.clone(), |directions| value + cells.derivative(&values, directions.clone()).sum())
    });
    shape + color
}

fn operations(c: &mut Criterion) {
    let device = Device::flex();
    let tracked = device.clone().autodiff();
    let mut group = c.benchmark_group("lattice decoder, 16384 points");
    group.sample_size(10).throughput(Throughput::Elements(POINTS as u64));
    for cells in [64, 128] {
        let decoder = LatticeDecoderConfig::new().with_cells(cells).with_color_cells(cells / 2).init(&tracked);
        let frozen = decoder.valid();
        let random = |range: f64, device: &Device| {
            Tensor::<2>::random([POINTS, 3], Distribution::Uniform(-range, range), device)
        };
        let (points, directions) = (random(0.5, &device), random(1.0, &device));
        let (on_graph, along) = (random(0.5, &tracked).require_grad(), random(1.0, &tracked));
        let query = |points: &Tensor<2>| Query::new(points.clone());
        let jet = |decoder: &LatticeDecoder, points: &Tensor<2>, directions: &Tensor<2>| {
            let jet = decoder.jet(&query(points), directions.clone());
            sum(jet.value) + sum(jet.derivative)
        };
        let mut bench = |what: &str, run: &dyn Fn() -> Tensor<1>, run_on_graph: &dyn Fn() -> Tensor<1>| {
            group.bench_function(format!("{cells} cells, {what}"), |b| b.iter(|| black_box(run().into_data())));
            group.bench_function(format!("{cells} cells, {what}, forward and backward"), |b| {
                b.iter(|| black_box(run_on_graph().backward()));
            });
        };
        bench("values", &|| sum(frozen.evaluate(&query(&points))), &|| sum(decoder.evaluate(&query(&on_graph))));
        bench("values in plain tensors", &|| plain(&frozen, &points, None), &|| plain(&decoder, &on_graph, None));
        bench("jets", &|| jet(&frozen, &points, &directions), &|| jet(&decoder, &on_graph, &along));
        let with = |decoder: &LatticeDecoder, points: &Tensor<2>, directions| plain(decoder, points, Some(directions));
        bench("jets in plain tensors", &|| with(&frozen, &points, &directions), &|| with(&decoder, &on_graph, &along));
    }
    group.finish();
}

criterion_group!(benches, operations);
criterion_main!(benches);
