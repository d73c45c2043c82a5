//! What a dataset of objects costs to read, however large: `cargo bench -p dvr-train --bench objects`.
//!
//! One object is rendered, and links to it make the datasets of 10, 100 and 1000 objects.

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use dvr_core::dataset::{ObjectDataset, ObjectOptions};
use dvr_core::mesh::{TexturedMesh, shapes};
use dvr_core::synth::{SynthConfig, render_dataset};

/// Links `count` objects to the one in `root/rings/torus`.
fn linked(root: &Path, count: usize) -> std::path::PathBuf {
    let category = root.join(format!("of_{count}/rings"));
    std::fs::create_dir_all(&category).expect("the temporary folder can be written");
    for i in 0..count {
        std::os::unix::fs::symlink(root.join("rings/torus"), category.join(format!("{i:04}")))
            .expect("links can be made");
    }
    root.join(format!("of_{count}"))
}

fn reading(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let torus = TexturedMesh { mesh: shapes::torus(1.0, 0.4, 48, 24), ..TexturedMesh::default() };
    let config = SynthConfig { surface_points: 1000, occupancy_points: 1000, ..SynthConfig::default() };
    render_dataset(&torus, "torus", "rings", folder.path(), &config, &|_, _| ()).expect("a torus can be rendered");
    let mut group = c.benchmark_group("objects");
    group.sample_size(20).throughput(Throughput::Elements(64));
    for count in [10, 100, 1000] {
        let root = linked(folder.path(), count);
        let dataset = ObjectDataset::open(&root, ObjectOptions::default()).expect("the dataset is sound");
        // What an object's files are called, and its cameras, is found out once: about 3 ms an object.
        for object in 0..count {
            dataset.views(object).expect("the object is sound");
        }
        let mut next = 0;
        group.bench_function(format!("a batch of 64 pictures and views, of {count} objects"), |b| {
            b.iter(|| {
                for _ in 0..64 {
                    // Strides that visit all objects and views.
                    next += 37;
                    let (object, view) = (next % count, next % 24);
                    black_box(dataset.read_input(object, view, 64).expect("the picture is sound"));
                    black_box(dataset.read_view(object, (view + 12) % 24).expect("the view is sound"));
                }
            });
        });
    }
    group.finish();
}

criterion_group!(benches, reading);
criterion_main!(benches);
