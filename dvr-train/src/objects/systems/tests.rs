//! Each system on objects that are rendered here.

use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use dvr_core::dataset::{InputPicture, ObjectDataset, ObjectOptions};
use dvr_core::mesh::{Mesh, TexturedMesh, shapes};
use dvr_core::synth::{SynthConfig, render_dataset};
use dvr_core::{Split, Supervision};
use dvr_model::EncoderConfig;
use dvr_render::extract::ExtractSettings;
use glam::Vec3;

use super::config::{System, SystemConfig};
use super::model::SystemModel;
use super::task::SystemTrainer;
use crate::learners::learner::Learner;
use crate::objects::shape::Shape;

/// A ball and a slab, seen from twelve sides each.
fn dataset(folder: &Path) -> Arc<ObjectDataset> {
    let config = SynthConfig {
        views: 12,
        width: 64,
        height: 64,
        surface_points: 4000,
        occupancy_points: 30_000,
        depth_maps: true,
        ..SynthConfig::default()
    };
    let mut slab = shapes::icosphere(3, 0.5);
    slab.vertices.iter_mut().for_each(|v| *v *= Vec3::new(1.0, 0.35, 0.7));
    for (name, mesh) in [("ball", shapes::icosphere(3, 0.35)), ("slab", slab)] {
        let mesh = TexturedMesh { mesh: Mesh { normals: None, ..mesh }, ..TexturedMesh::default() };
        render_dataset(&mesh, name, "round", folder, &config, &|_, _| ()).unwrap();
    }
    for list in ["train", "val", "test"] {
        std::fs::write(folder.join("round").join(format!("{list}.lst")), "ball\nslab\n").unwrap();
    }
    Arc::new(ObjectDataset::open(folder, ObjectOptions::default()).unwrap())
}

fn small(system: System, supervision: Supervision) -> SystemConfig {
    let config = SystemConfig::new(system, supervision);
    let change = serde_json::json!({
        "encoder": {"kind": "codes", "objects": 2}, "objects": 2, "validate_objects": 2, "steps": 200,
        "milestones_percent": [70], "learning_rate": 3e-3,
    });
    let mut config = config.overridden(&change).unwrap();
    config.code_dim = 8;
    if system == System::Pixel2Mesh {
        // It has no codes, but a picture.
        config.encoder = EncoderConfig::Local { image_size: 64, width: 4, channels: 16 };
    }
    config
}

#[test]
fn every_system_learns_two_objects_by_heart() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    for system in System::ALL {
        for &supervision in system.supervisions() {
            let config = small(system, supervision);
            config.check().unwrap();
            let mut trainer = SystemTrainer::new(dataset.clone(), config.clone(), Device::flex()).unwrap();
            let (steps, limit) = match system {
                // Silhouettes alone tell voxels little at a time.
                System::Drc => (200, 0.1),
                // Meshes overshoot at first, by up to two voxels with some seeds.
                System::Pixel2Mesh => (150, 0.06),
                _ => (100, 0.06),
            };
            for _ in 0..steps {
                trainer.step().unwrap();
            }
            assert!(trainer.broken().is_empty(), "{system:?}: {:?}", trainer.broken());
            let model = SystemModel::from_bytes(config, &trainer.model().unwrap(), &Device::flex()).unwrap();
            let extraction = ExtractSettings { resolution: 32, ..ExtractSettings::default() };
            for (row, object) in dataset.of_split(Split::Train).into_iter().enumerate() {
                let truth = dataset.read_ground_truth(object).unwrap();
                let picture =
                    model.config().encoder.image_size().map(|size| dataset.read_input(object, 3, size as u32));
                let picture = picture.transpose().unwrap();
                let shape = model.shape(picture.as_ref(), row as i64, &extraction);
                let score = shape.evaluate(&truth, 0).unwrap();
                let distance = score.surface.unwrap().chamfer_l1;
                // A voxel is .034 wide.
                let name = &dataset.objects()[object].name;
                assert!(distance < limit, "{system:?} by {supervision}: {name} is {distance} off");
                assert_eq!(score.volume_iou.is_some(), matches!(shape, Shape::Mesh(_)), "{system:?}");
            }
            let has_surface = system != System::Psgn;
            let validation = trainer.validate(4000);
            assert_eq!(validation.is_some(), has_surface, "{system:?}");
            if let Some(found) = validation {
                assert!(found.mask_iou > 0.6, "{system:?} by {supervision}: silhouettes {}", found.mask_iou);
            }
        }
    }
}

#[test]
fn a_picture_without_a_camera_gets_one_that_is_guessed() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let config = small(System::Pixel2Mesh, Supervision::Occupancy);
    let mut trainer = SystemTrainer::new(dataset.clone(), config.clone(), Device::flex()).unwrap();
    let mut terms = Vec::new();
    for _ in 0..60 {
        terms.push(trainer.step().unwrap().terms.iter().find(|(name, _)| *name == "camera").unwrap().1);
    }
    assert!(terms[50..].iter().sum::<f64>() < 0.7 * terms[..10].iter().sum::<f64>(), "guesses get better: {terms:?}");
    let model = SystemModel::from_bytes(config, &trainer.model().unwrap(), &Device::flex()).unwrap();
    let extraction = ExtractSettings { resolution: 32, ..ExtractSettings::default() };
    let mut picture = dataset.read_input(1, 3, 64).unwrap();
    let vertices = |picture: &InputPicture| model.shape(Some(picture), 0, &extraction).mesh().unwrap().vertices.clone();
    let known = vertices(&picture);
    picture.camera = None;
    let guessed = vertices(&picture);
    assert!(guessed != known && guessed.iter().all(|vertex| vertex.is_finite()));
}

#[test]
fn a_resumed_run_ends_as_an_unbroken_one() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    for system in [System::AtlasNet, System::Drc, System::Pixel2Mesh] {
        let start = || {
            let config = small(system, system.supervisions()[0]);
            SystemTrainer::new(dataset.clone(), config, Device::flex()).unwrap()
        };
        let mut whole = start();
        // Others may draw from the device's random numbers at the same time: both start as one does.
        let mut broken = start();
        broken.resume(&whole.state().unwrap(), 0).unwrap();
        (0..4).for_each(|_| drop(whole.step().unwrap()));
        (0..2).for_each(|_| drop(broken.step().unwrap()));
        let state = broken.state().unwrap();
        let mut resumed = start();
        resumed.resume(&state, 2).unwrap();
        (0..2).for_each(|_| drop(resumed.step().unwrap()));
        // Stored running statistics carry identifiers of their own in each instance: what is compared is what comes of them.
        let vertices = |trainer: &SystemTrainer| {
            let config = trainer.config().clone();
            let model = SystemModel::from_bytes(config, &trainer.model().unwrap(), &Device::flex()).unwrap();
            let picture = dataset.read_input(1, 3, 64).unwrap();
            let picture = model.config().encoder.image_size().map(|_| picture);
            let extraction = ExtractSettings { resolution: 32, ..ExtractSettings::default() };
            model.shape(picture.as_ref(), 1, &extraction).drawn().vertices.clone()
        };
        assert!(!vertices(&whole).is_empty() && vertices(&resumed) == vertices(&whole), "{system:?}");
        assert!(vertices(&resumed) != vertices(&broken), "{system:?}");
    }
}

#[test]
fn objects_without_what_a_system_learns_from_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    for name in ["ball", "slab"] {
        std::fs::remove_file(folder.path().join("round").join(name).join("pointcloud.npz")).unwrap();
    }
    let config = small(System::Psgn, Supervision::Occupancy);
    let mut trainer = SystemTrainer::new(dataset, config, Device::flex()).unwrap();
    let message = trainer.step().unwrap_err().to_string();
    assert!(message.contains("pointcloud.npz"), "{message}");
}

#[test]
fn a_decoder_of_another_kind_and_supervision_without_a_loss_are_refused() {
    let config = SystemConfig::new(System::Psgn, Supervision::Occupancy);
    let other = config.overridden(&serde_json::json!({"decoder": {"kind": "voxels"}})).unwrap();
    assert!(other.check().unwrap_err().to_string().contains("psgn"));
    let error = SystemConfig::new(System::SoftRas, Supervision::Depth).check().unwrap_err().to_string();
    assert!(error.contains("softras") && error.contains("rgb"), "{error}");
    let alone =
        SystemConfig::new(System::Drc, Supervision::Rgb).overridden(&serde_json::json!({"objects": 1})).unwrap();
    assert!(alone.check().unwrap_err().to_string().contains("at least 2"));
    let no_places = SystemConfig::new(System::Pixel2Mesh, Supervision::Occupancy);
    let no_places = no_places.overridden(&serde_json::json!({"encoder": {"kind": "convolutional"}})).unwrap();
    assert!(no_places.check().unwrap_err().to_string().contains("encoder.kind"));
    assert!(config.overridden(&serde_json::json!({"laplacian": 1.0})).is_err(), "points have no neighbours");
}
