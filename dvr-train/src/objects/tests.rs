//! Drawing, training and resuming on a dataset of two categories with four balls and rings each.

use std::path::Path;
use std::sync::Arc;

use burn::module::Module;
use burn::tensor::Device;
use dvr_core::Split;
use dvr_core::dataset::{ObjectDataset, ObjectOptions};
use dvr_core::mesh::{Mesh, TexturedMesh, shapes};
use dvr_core::synth::{SynthConfig, render_dataset};
use dvr_model::EncoderConfig;
use dvr_render::Field;
use dvr_render::Query;
use dvr_render::extract::{ExtractSettings, FieldSurface};
use dvr_test_support::max_difference;
use glam::Vec3;

use super::config::ObjectsConfig;
use super::draw::{BatchDrawer, KnownPoints, ObjectsBatch, Targets};
use super::loader::Loader;
use super::mean_shape::MeanShapes;
use super::mirror::Mirror;
use super::nearest_picture::NearestPicture;
use super::predictor::{Predictor, evaluated_input};
use super::shape::Shape;
use super::trainer::ObjectsTrainer;
use crate::config::MarchStage;
use crate::export::mesh::{MeshOptions, object_mesh};
use crate::learners::learner::Learner;
use dvr_core::Supervision;

fn write_dataset(root: &Path) {
    let config = SynthConfig {
        views: 4,
        width: 16,
        height: 16,
        surface_points: 500,
        occupancy_points: 8000,
        ..SynthConfig::default()
    };
    for i in 0..4 {
        let stretched = |mesh: Mesh| {
            let stretch = Vec3::new(1.0, 0.5 + 0.2 * i as f32, 1.0);
            let vertices = mesh.vertices.iter().map(|vertex| *vertex * stretch).collect();
            TexturedMesh { mesh: Mesh { vertices, normals: None, ..mesh }, ..TexturedMesh::default() }
        };
        let shapes = [("balls", shapes::icosphere(2, 1.0)), ("rings", shapes::torus(1.0, 0.4, 24, 12))];
        for (category, mesh) in shapes {
            render_dataset(&stretched(mesh), &format!("o{i}"), category, root, &config, &|_, _| ()).unwrap();
        }
    }
    for category in ["balls", "rings"] {
        let lists = [("train.lst", "o0\no1\no3\n"), ("val.lst", "o2\n"), ("test.lst", "o2\n")];
        lists.iter().for_each(|(list, names)| std::fs::write(root.join(category).join(list), names).unwrap());
    }
}

pub(super) fn dataset() -> (tempfile::TempDir, Arc<ObjectDataset>) {
    let folder = tempfile::tempdir().unwrap();
    write_dataset(folder.path());
    let dataset = open(folder.path());
    (folder, dataset)
}

fn open(root: &Path) -> Arc<ObjectDataset> {
    Arc::new(ObjectDataset::open(root, ObjectOptions::default()).unwrap())
}

pub(super) fn small(supervision: Supervision) -> ObjectsConfig {
    let mut config = ObjectsConfig::new(supervision);
    config.encoder = EncoderConfig::Convolutional { image_size: 63, width: 2 };
    (config.hull_occupancy, config.mirror) = (0.0, Mirror::Off);
    (config.objects, config.points, config.validate_objects) = (4, 32, 2);
    (config.train.rays, config.train.steps) = (16, 6);
    config.train.march = vec![MarchStage { from_percent: 0, samples: 8 }];
    (config.train.model.hidden, config.train.model.code_dim, config.train.model.octaves) = (16, 8, 1);
    config
}

#[test]
fn batches_come_in_the_order_of_steps_and_every_epoch_has_every_object_once() {
    let (_folder, dataset) = dataset();
    let drawer = Arc::new(BatchDrawer::new(dataset, small(Supervision::Rgb)).unwrap());
    let draw = || {
        let drawer = drawer.clone();
        move |step| drawer.draw(step)
    };
    let mut loader = Loader::start(draw(), 1);
    let mut rows = Vec::new();
    for step in 1..=6 {
        let (ahead, alone) = (loader.next_batch().unwrap(), drawer.draw(step).unwrap());
        let pictures = |batch: &ObjectsBatch| batch.inputs.iter().map(|input| input.image.clone()).collect::<Vec<_>>();
        assert!(ahead.rows == alone.rows && pictures(&ahead) == pictures(&alone), "step {step}");
        let Targets::Pixels { pixels, owner, .. } = ahead.targets else { panic!("pixels") };
        let Targets::Pixels { pixels: again, .. } = alone.targets else { panic!("pixels") };
        assert_eq!((&pixels.color, &pixels.rays), (&again.color, &again.rays));
        assert_eq!(owner.chunks(16).map(|chunk| chunk[0]).collect::<Vec<_>>(), [0, 1, 2, 3]);
        rows.extend(ahead.rows);
    }
    for epoch in rows.chunks(6) {
        let mut epoch = epoch.to_vec();
        epoch.sort_unstable();
        assert_eq!(epoch, [0, 1, 2, 3, 4, 5]);
    }
    assert_ne!(rows[..6], rows[6..12], "each in an order of its own");
    let mut later = Loader::start(draw(), 4);
    assert_eq!(later.next_batch().unwrap().rows, drawer.draw(4).unwrap().rows, "a resumed run goes on there");
}

#[test]
fn with_one_view_an_object_always_learns_from_the_same_view() {
    let (_folder, dataset) = dataset();
    let config = ObjectsConfig { one_view: true, ..small(Supervision::Depth) };
    let drawer = BatchDrawer::new(dataset, config).unwrap();
    let mut origin = std::collections::BTreeMap::new();
    for step in 1..=12 {
        let batch = drawer.draw(step).unwrap();
        let Targets::Pixels { pixels, owner, .. } = batch.targets else { panic!("pixels") };
        for (ray, &place) in pixels.rays.iter().zip(&owner) {
            let row = batch.rows[place as usize];
            assert_eq!(*origin.entry(row).or_insert(ray.origin), ray.origin, "object {row}, step {step}");
        }
    }
}

#[test]
fn in_the_place_of_a_broken_object_another_one_is_drawn_and_it_is_named_once() {
    let (folder, _) = dataset();
    std::fs::write(folder.path().join("rings/o1/cameras.npz"), "broken").unwrap();
    let dataset = open(folder.path());
    let mut trainer = ObjectsTrainer::new(dataset, small(Supervision::Rgb), Device::flex()).unwrap();
    let notes: Vec<String> = (0..4)
        .flat_map(|_| {
            trainer.step().unwrap();
            trainer.notes()
        })
        .collect();
    assert!(notes.len() == 1 && notes[0].contains("rings/o1") && notes[0].contains("cameras.npz"), "{notes:?}");
    assert_eq!(trainer.broken().len(), 1);

    for object in ["balls/o0", "balls/o1", "balls/o3", "rings/o0", "rings/o3"] {
        std::fs::remove_file(folder.path().join(object).join("cameras.npz")).unwrap();
    }
    let message = BatchDrawer::new(open(folder.path()), small(Supervision::Rgb)).unwrap().draw(1).unwrap_err();
    assert!(message.to_string().contains("in a row"), "{message}");
}

/// A mesh, rendered, in a dataset of its own: pictures of so many views, and pixels.
pub(super) fn rendered(mesh: Mesh, views: usize, pixels: u32) -> (tempfile::TempDir, Arc<ObjectDataset>) {
    let folder = tempfile::tempdir().unwrap();
    let config = SynthConfig {
        views,
        width: pixels,
        height: pixels,
        surface_points: 500,
        occupancy_points: 20_000,
        ..SynthConfig::default()
    };
    let mesh = TexturedMesh { mesh, ..TexturedMesh::default() };
    render_dataset(&mesh, "only", "alone", folder.path(), &config, &|_, _| ()).unwrap();
    let dataset = open(folder.path());
    (folder, dataset)
}

/// A thin plate.
fn plate() -> (tempfile::TempDir, Arc<ObjectDataset>) {
    rendered(shapes::cuboid(Vec3::new(-0.5, -0.4, -0.02), Vec3::new(0.5, 0.4, 0.02)), 4, 16)
}

#[test]
fn points_are_drawn_in_the_padded_box_of_the_object_as_often_as_asked_for() {
    let (_folder, dataset) = plate();
    for (share, least, most) in [(0.0, 0.0, 0.25), (0.5, 0.45, 0.7), (1.0, 1.0, 1.0)] {
        let mut config = ObjectsConfig { box_share: share, inside_share: 0.0, ..small(Supervision::Occupancy) };
        (config.objects, config.points) = (1, 2000);
        let batch = BatchDrawer::new(dataset.clone(), config).unwrap().draw(1).unwrap();
        let Targets::Points(KnownPoints { points, inside, .. }) = batch.targets else { panic!("points") };
        // The plate is .9 long, and .036 thick.
        let near = points.iter().filter(|point| point.abs().cmple(Vec3::new(0.496, 0.406, 0.064)).all()).count();
        let found = near as f64 / points.len() as f64;
        assert!((least..=most).contains(&found), "{found} of the points for a share of {share}");
        let thin = |point: &Vec3| point.abs().cmple(Vec3::new(0.45, 0.36, 0.018)).all();
        assert!(points.iter().zip(&inside).all(|(point, &inside)| thin(point) == inside));
    }
}

#[test]
fn points_are_drawn_inside_the_object_as_often_as_asked_for() {
    let (_folder, dataset) = plate();
    for (share, least, most) in [(0.0, 0.0, 0.03), (0.25, 0.25, 0.28), (1.0, 1.0, 1.0)] {
        let mut config = ObjectsConfig { box_share: 0.0, inside_share: share, ..small(Supervision::Occupancy) };
        (config.objects, config.points) = (1, 2000);
        config.check().unwrap();
        let batch = BatchDrawer::new(dataset.clone(), config).unwrap().draw(1).unwrap();
        let Targets::Points(KnownPoints { inside, .. }) = batch.targets else { panic!("points") };
        let found = inside.iter().filter(|inside| **inside).count() as f64 / inside.len() as f64;
        assert!((least..=most).contains(&found), "{found} of the points for a share of {share}");
    }
    let both = ObjectsConfig { box_share: 0.6, inside_share: 0.5, ..small(Supervision::Occupancy) };
    assert!(both.check().unwrap_err().to_string().contains("inside_share"));
}

#[test]
fn the_surface_lies_at_the_threshold_in_validation_and_in_what_a_checkpoint_gives() {
    let (_folder, dataset) = dataset();
    let config = small(Supervision::Occupancy);
    assert_eq!(config.threshold, 0.5);
    let mut trainer = ObjectsTrainer::new(dataset.clone(), config.clone(), Device::flex()).unwrap();
    trainer.step().unwrap();
    let logits = |threshold: f64| {
        let config = ObjectsConfig { threshold, ..config.clone() };
        let model =
            super::model::FieldsModel::from_bytes(config, &Learner::model(&trainer).unwrap(), &Device::flex()).unwrap();
        let picture = dataset.read_input(0, 0, 63).unwrap();
        let points = burn::tensor::Tensor::from_floats([[0.0f32, 0.0, 0.0], [0.3, 0.2, 0.1]], &Device::flex());
        let field = model.field_of_picture(&picture);
        field.occupancy_logit(&Query::new(points)).into_data().iter::<f32>().collect::<Vec<f32>>()
    };
    let (half, fifth) = (logits(0.5), logits(0.2));
    let shifted: Vec<f32> = half.iter().map(|logit| logit + 4.0f32.ln()).collect();
    assert!(max_difference(&fifth, &shifted) < 1e-5, "{half:?} {fifth:?}");
}

#[test]
fn a_field_that_nowhere_comes_to_its_threshold_has_a_surface_all_the_same() {
    let (_folder, dataset) = dataset();
    let config = small(Supervision::Rgb);
    let trainer = ObjectsTrainer::new(dataset.clone(), config.clone(), Device::flex()).unwrap();
    let bytes = Learner::model(&trainer).unwrap();
    let model = super::model::FieldsModel::from_bytes(config, &bytes, &Device::flex()).unwrap();
    let picture = dataset.read_input(0, 0, 63).unwrap();
    let extraction = ExtractSettings { resolution: 16, ..ExtractSettings::default() };
    // As fresh, a network holds nothing for certain.
    let sure = model.with_threshold(0.999);
    let options = MeshOptions { extraction: extraction.clone(), ..MeshOptions::default() };
    let none = object_mesh(&FieldSurface::new(sure.field_of_picture(&picture)), &options, &[], &[]);
    assert!(matches!(none, Err(crate::error::Error::NoMesh(_))));
    let Shape::Mesh(mesh) = sure.shape(super::model::Asked::Picture(&picture), &extraction).unwrap() else {
        panic!("a surface")
    };
    assert!(!mesh.is_empty());
}

/// The model that a checkpoint holds.
fn fields(checkpoint: crate::run::checkpoint::Checkpoint) -> super::model::FieldsModel {
    match super::object_model::ObjectModel::load(&checkpoint, &Device::flex()).unwrap() {
        super::object_model::ObjectModel::Fields(model) => model,
        super::object_model::ObjectModel::System(_) => panic!("not a system"),
    }
}

/// What a model says of some points of an object: codes, and with them running statistics, show in it.
fn answers(trainer: &ObjectsTrainer, dataset: &ObjectDataset) -> Vec<f32> {
    let state = trainer.state().unwrap();
    let model = fields(crate::run::checkpoint::Checkpoint { header: header(trainer), state });
    let field = match model.config().encoder.image_size() {
        Some(size) => model.field_of_picture(&dataset.read_input(2, 1, size as u32).unwrap()),
        None => model.field_of_row(2),
    };
    let points = burn::tensor::Tensor::from_floats([[0.1, 0.2, 0.3], [-0.2, 0.0, 0.4]], &Device::flex());
    let values = field.evaluate(&Query::new(points));
    let flat = |data: burn::tensor::TensorData| data.iter::<f32>().collect::<Vec<_>>();
    [flat(values.occupancy_logit.into_data()), flat(values.color.into_data())].concat()
}

fn header(trainer: &ObjectsTrainer) -> crate::run::checkpoint::CheckpointHeader {
    use crate::methods::method::Method;
    let method: Box<dyn Method> = Box::new(crate::methods::objects::ObjectsMethod::new(trainer.config().clone()));
    crate::run::checkpoint::CheckpointHeader {
        version: crate::run::checkpoint::CHECKPOINT_VERSION,
        method: method.record().unwrap(),
        common: method.common(),
        step: trainer.steps_done(),
        seconds: 0.0,
        best: None,
        scene: std::path::PathBuf::new(),
        reading: serde_json::Value::Null,
        object_to_world: dvr_core::Similarity::default(),
        views: None,
        cameras: std::collections::BTreeMap::new(),
        refine_cameras: 0,
        exposures: Default::default(),
        lengths: Vec::new(),
        support: None,
        notes: Vec::new(),
    }
}

/// Makes trainers that all start from the same parameters: tests that run at the same time share burn's random numbers.
fn newborn(dataset: &Arc<ObjectDataset>, config: &ObjectsConfig) -> impl Fn() -> ObjectsTrainer {
    let new = |dataset: &Arc<ObjectDataset>, config: &ObjectsConfig| {
        ObjectsTrainer::new(dataset.clone(), config.clone(), Device::flex()).unwrap()
    };
    let start = new(dataset, config).state().unwrap();
    move || {
        let mut trainer = new(dataset, config);
        trainer.resume(&start, 0).unwrap();
        trainer
    }
}

#[test]
fn training_goes_on_after_a_break_as_if_there_had_been_none() {
    let (_folder, dataset) = dataset();
    let resnet = EncoderConfig::Resnet18 { image_size: 16 };
    let codes = EncoderConfig::Codes { objects: 6 };
    let convolutional = small(Supervision::Rgb).encoder;
    let local = EncoderConfig::Local { image_size: 63, width: 2, channels: 3 };
    let local_bn = EncoderConfig::LocalBn { image_size: 32, width: 2, channels: 3 };
    for (encoder, supervision) in [
        (convolutional, Supervision::RgbDepth),
        (resnet, Supervision::Rgb),
        (local, Supervision::Rgb),
        (local_bn, Supervision::Rgb),
        (codes, Supervision::Occupancy),
    ] {
        let config =
            ObjectsConfig { encoder, mirror: Mirror::Z, hull_occupancy: 1.0, color_jitter: 0.4, ..small(supervision) };
        let new = newborn(&dataset, &config);
        let mut whole = new();
        (0..4).for_each(|_| drop(whole.step().unwrap()));
        let mut first = new();
        (0..2).for_each(|_| drop(first.step().unwrap()));
        let mut second = new();
        second.step().unwrap();
        second.resume(&first.state().unwrap(), 2).unwrap();
        (0..2).for_each(|_| drop(second.step().unwrap()));
        assert_eq!(answers(&whole, &dataset), answers(&second, &dataset), "{supervision}");
        assert_ne!(answers(&whole, &dataset), answers(&first, &dataset));
        assert_eq!(whole.validate(100), second.validate(100));
    }
}

#[test]
fn devices_that_share_the_objects_of_a_step_learn_what_one_does() {
    let (_folder, dataset) = dataset();
    let convolutional = small(Supervision::Rgb).encoder;
    let codes = EncoderConfig::Codes { objects: 6 };
    for (encoder, supervision) in
        [(codes.clone(), Supervision::Rgb), (codes, Supervision::Occupancy), (convolutional, Supervision::Rgb)]
    {
        let mut config = ObjectsConfig { encoder, ..small(supervision) };
        // Its points are drawn among a device's own hits.
        config.train.losses.normal = 0.0;
        let new = newborn(&dataset, &config);
        let learn = |others: usize| {
            let mut trainer = new().data_parallel(vec![Device::flex(); others]);
            (0..3).for_each(|_| drop(trainer.step().unwrap()));
            answers(&trainer, &dataset)
        };
        let alone = learn(0);
        // More devices than objects are no problem.
        for others in [1, 2, 20] {
            let apart = max_difference(&learn(others), &alone);
            assert!(apart < 1e-4, "{supervision}, {others} others: {apart:e}");
        }
    }
}

#[test]
fn occupancies_are_learned_and_two_objects_distinguished() {
    let (_folder, dataset) = dataset();
    let mut config = ObjectsConfig { encoder: EncoderConfig::Codes { objects: 6 }, ..small(Supervision::Occupancy) };
    (config.points, config.objects, config.train.steps, config.train.learning_rate) = (256, 6, 300, 1e-2);
    let mut trainer = ObjectsTrainer::new(dataset.clone(), config, Device::flex()).unwrap();
    let first = trainer.step().unwrap().loss;
    let last = (0..300).map(|_| trainer.step().unwrap().loss).last().unwrap();
    assert!(last < 0.5 * first, "{first} to {last}");
    // The middle of a ball is inside; that of a ring is not, or less surely so.
    let state = trainer.state().unwrap();
    let model = fields(crate::run::checkpoint::Checkpoint { header: header(&trainer), state });
    let middle = |row| {
        let points = burn::tensor::Tensor::zeros([1, 3], &Device::flex());
        model.field_of_row(row).occupancy_logit(&Query::new(points)).into_scalar::<f32>()
    };
    // Rows 0 to 2 are balls, 3 to 5 rings.
    let (balls, rings) = ((0..3).map(middle).sum::<f32>() / 3.0, (3..6).map(middle).sum::<f32>() / 3.0);
    assert!(balls > 0.0 && rings < balls - 0.1, "{balls} and {rings}");
    assert!(model.model().num_params() > 0);
}

#[test]
fn baselines_know_the_training_objects_alone() {
    let (_folder, dataset) = dataset();
    let test = dataset.of_split(Split::Test);
    let nobody = |_: usize, problem: String| panic!("{problem}");
    let mean = Predictor::MeanShape(MeanShapes::read(&dataset, |_| (), nobody).unwrap());
    let nearest = Predictor::NearestPicture(NearestPicture::read(&dataset, |_| (), nobody).unwrap());
    let extraction = dvr_render::extract::ExtractSettings { resolution: 32, ..Default::default() };
    for object in test {
        let truth = dataset.read_ground_truth(object).unwrap();
        let input = evaluated_input(&dataset, object, 0).unwrap();
        for predictor in [&mean, &nearest] {
            let shape = predictor.shape(&dataset, object, input, &extraction).unwrap();
            let score = shape.evaluate(&truth, 0).unwrap();
            // The objects are alike, but no training object is the same.
            let (iou, chamfer) = (score.volume_iou.unwrap(), score.surface.unwrap().chamfer_l1);
            assert!(iou > 0.3 && iou < 0.99, "{iou}");
            assert!(chamfer > 0.01 && chamfer < 0.1, "{chamfer}");
            if let Shape::Samples(samples) = shape {
                assert_eq!(samples.surface.unwrap().points.len(), 500);
            }
        }
    }
}
