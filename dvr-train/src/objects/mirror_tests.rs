//! Objects in the mirror, and points of their hulls: what is drawn belongs together.

use std::sync::Arc;

use burn::tensor::{Device, Tensor};
use dvr_core::dataset::{InputPicture, ObjectDataset};
use dvr_core::mesh::Mesh;
use dvr_core::{MirrorAxis, Supervision};
use dvr_model::EncoderConfig;
use dvr_render::{Field, Query};
use dvr_test_support::max_difference;
use glam::Vec3;

use super::config::ObjectsConfig;
use super::draw::{BatchDrawer, Targets};
use super::mirror::{Mirror, Symmetry};
use super::model::{FieldsModel, is_asymmetric};
use super::tests::{dataset, rendered, small};
use super::trainer::ObjectsTrainer;
use crate::error::Error;
use crate::learners::learner::Learner;

/// A wedge that no mirror leaves as it is.
fn wedge() -> (tempfile::TempDir, Arc<ObjectDataset>) {
    let mesh = Mesh {
        vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
        faces: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        ..Mesh::default()
    };
    rendered(mesh, 12, 64)
}

/// Whether a picture has its object where it sees a point.
fn shows(picture: &InputPicture, point: Vec3) -> bool {
    let camera = picture.camera.as_ref().unwrap();
    let (place, _) = camera.project(point.as_dvec3());
    camera.sees(place) && picture.image.get_pixel(place.x as u32, place.y as u32).0 != [255; 3]
}

#[test]
fn in_the_mirror_pictures_rays_and_points_show_the_same_object() {
    let (_folder, dataset) = wedge();
    for supervision in [Supervision::Rgb, Supervision::Depth] {
        let mut config = ObjectsConfig { mirror: Mirror::X, hull_occupancy: 1.0, ..small(supervision) };
        config.encoder = EncoderConfig::Convolutional { image_size: 64, width: 2 };
        (config.objects, config.points, config.train.rays, config.train.hull.resolution) = (1, 1500, 64, 48);
        let drawer = BatchDrawer::new(dataset.clone(), config).unwrap();
        let mut left = 0;
        for step in 1..=16 {
            let batch = drawer.draw(step).unwrap();
            let Targets::Pixels { pixels, hull, .. } = batch.targets else { panic!("pixels") };
            let picture = &batch.inputs[0];
            assert_eq!(hull.points.len(), 1500);
            let inside = || hull.points.iter().zip(&hull.inside).filter_map(|(point, inside)| inside.then_some(*point));
            assert!(inside().count() > 50);
            // A voxel's middle may lie in the pixel beside the outline.
            let shown = inside().filter(|point| shows(picture, *point)).count();
            assert!(shown * 100 >= inside().count() * 95, "{supervision}: {shown} of {}", inside().count());
            // The corner with most of the wedge lies where x is small, or in the mirror where it is large.
            let mean = inside().map(|point| point.x).sum::<f32>() / inside().count() as f32;
            left += usize::from(mean < 0.0);
            for (ray, depth) in pixels.rays.iter().zip(&pixels.z_depth).filter(|(_, depth)| depth.is_finite()) {
                let point = ray.at(f64::from(*depth) + 0.02).as_vec3();
                let near = inside().map(|other| other.distance(point)).fold(f32::INFINITY, f32::min);
                assert!(near < 0.15, "{supervision}, step {step}: a hit {near} from all of the hull");
            }
        }
        assert!((3..=13).contains(&left), "{left} of 16 as they are");
    }
}

#[test]
fn without_a_mirror_nothing_is_drawn_in_one() {
    let (_folder, dataset) = wedge();
    let mut config = ObjectsConfig { hull_occupancy: 1.0, ..small(Supervision::Rgb) };
    (config.objects, config.points) = (1, 200);
    let drawer = BatchDrawer::new(dataset, config).unwrap();
    for step in 1..=8 {
        let Targets::Pixels { hull, .. } = drawer.draw(step).unwrap().targets else { panic!("pixels") };
        let inside = || hull.points.iter().zip(&hull.inside).filter_map(|(point, inside)| inside.then_some(point.x));
        assert!(inside().sum::<f32>() < 0.0);
    }
}

#[test]
fn the_mirror_is_the_one_in_which_objects_change_least_and_none_where_they_change() {
    let found = |dataset: &ObjectDataset, mirror: Mirror, symmetry: Symmetry| {
        let encoder = EncoderConfig::Local { image_size: 64, width: 2, channels: 3 };
        ObjectsConfig { encoder, mirror, symmetry, ..small(Supervision::Rgb) }.found_mirror(dataset)
    };
    let (_balls, balls_and_rings) = dataset();
    // Alike in all of them, but for what four views tell.
    let (mirror, symmetry) = found(&balls_and_rings, Mirror::Auto, Symmetry::Auto);
    assert!(mirror.axis().is_some());
    assert_eq!(symmetry, Symmetry::On);
    assert_eq!(found(&balls_and_rings, Mirror::Y, Symmetry::Off), (Mirror::Y, Symmetry::Off));
    assert_eq!(found(&balls_and_rings, Mirror::Off, Symmetry::Auto), (Mirror::Off, Symmetry::Off));
    let (_wedge, wedge) = wedge();
    assert_eq!(found(&wedge, Mirror::Auto, Symmetry::Auto), (Mirror::Off, Symmetry::Off));
    assert_eq!(found(&wedge, Mirror::X, Symmetry::Auto), (Mirror::X, Symmetry::Off));
    // Codes know no camera, by which a silhouette could tell what is not symmetric.
    let codes = ObjectsConfig { mirror: Mirror::Auto, symmetry: Symmetry::Auto, ..small(Supervision::Rgb) };
    assert_eq!(codes.found_mirror(&balls_and_rings), (mirror, Symmetry::Off));
    // Where one view of each is all that is known, nothing is.
    let one_view = ObjectsConfig { one_view: true, ..codes };
    assert_eq!(one_view.found_mirror(&balls_and_rings), (Mirror::Off, Symmetry::Off));
}

#[test]
fn a_symmetric_model_makes_symmetric_shapes() {
    let (_folder, dataset) = wedge();
    let local = EncoderConfig::Local { image_size: 64, width: 2, channels: 3 };
    let config = ObjectsConfig { encoder: local, mirror: Mirror::X, ..small(Supervision::Rgb) };
    let mut trainer = ObjectsTrainer::new(dataset.clone(), config.clone(), Device::flex()).unwrap();
    (0..3).for_each(|_| drop(trainer.step().unwrap()));
    let bytes = Learner::model(&trainer).unwrap();
    let model = || FieldsModel::from_bytes(config.clone(), &bytes, &Device::flex()).unwrap();
    let picture = dataset.read_input(0, 1, 64).unwrap();
    let apart = |model: &FieldsModel, picture: &InputPicture| {
        let logits = |sign: f32| {
            let points = Tensor::from_floats([[0.3 * sign, 0.1, 0.2], [0.2 * sign, 0.0, 0.1]], &Device::flex());
            let logits = model.field_of_picture(picture).occupancy_logit(&Query::new(points));
            logits.into_data().iter::<f32>().collect::<Vec<_>>()
        };
        max_difference(&logits(1.0), &logits(-1.0))
    };
    let symmetric = model().with_symmetry(true).unwrap();
    assert!(apart(&model(), &picture) > 1e-4);
    assert!(apart(&symmetric, &picture) < 1e-5);
    let flat =
        FieldsModel::from_bytes(ObjectsConfig { mirror: Mirror::Off, ..config.clone() }, &bytes, &Device::flex());
    assert!(matches!(flat.unwrap().with_symmetry(true), Err(Error::NoMirror)));
}

#[test]
fn the_silhouette_of_a_picture_says_which_objects_are_not_symmetric() {
    let (_folder, dataset) = wedge();
    let picture = dataset.read_input(0, 1, 64).unwrap();
    let camera = picture.camera.clone().unwrap();
    // Two balls, and a single one.
    let ball = |point: Vec3| 10.0 * (0.15 - point.distance(Vec3::new(0.25, 0.0, 0.0)));
    let of = |points: &[Vec3], field: &dyn Fn(Vec3) -> f32| points.iter().map(|point| field(*point)).collect();
    let two = |points: &[Vec3]| -> Vec<f32> { of(points, &|p| ball(p).max(ball(MirrorAxis::X.mirrored(p)))) };
    let one = |points: &[Vec3]| -> Vec<f32> { of(points, &ball) };
    let mean =
        |points: &[Vec3]| -> Vec<f32> { of(points, &|p| 0.5 * (ball(p) + ball(MirrorAxis::X.mirrored(p))).min(1.0)) };
    let shown = |field: &dyn Fn(&[Vec3]) -> Vec<f32>| {
        let is_met = |u: u32, v: u32| {
            let ray = camera.pixel_ray(u, v);
            let points: Vec<Vec3> = (0..400).map(|i| ray.at(f64::from(i) * 0.01).as_vec3()).collect();
            field(&points).iter().any(|logit| *logit > 0.0)
        };
        dvr_core::Mask::from(image::GrayImage::from_fn(camera.width, camera.height, |u, v| {
            image::Luma([if is_met(u, v) { 255 } else { 0 }])
        }))
    };
    // Where one is shown, the mean of it and its mirror image has nothing; where both are, both fields have them.
    assert!(is_asymmetric(&one, &mean, &camera, &shown(&one)));
    assert!(!is_asymmetric(&two, &two, &camera, &shown(&two)));
    assert!(!is_asymmetric(&one, &two, &camera, &shown(&two)));
}

#[test]
fn a_picture_and_its_mirror_image_give_shapes_that_are_mirror_images() {
    let (_folder, dataset) = wedge();
    let local = EncoderConfig::Local { image_size: 63, width: 2, channels: 3 };
    let local_bn = EncoderConfig::LocalBn { image_size: 63, width: 2, channels: 3 };
    for encoder in [small(Supervision::Rgb).encoder, local, local_bn] {
        let config = ObjectsConfig { encoder, mirror: Mirror::X, ..small(Supervision::Rgb) };
        let mut trainer = ObjectsTrainer::new(dataset.clone(), config.clone(), Device::flex()).unwrap();
        (0..3).for_each(|_| drop(trainer.step().unwrap()));
        let bytes = Learner::model(&trainer).unwrap();
        let logits = |mirror: Mirror, flipped: bool| {
            let config = ObjectsConfig { mirror, ..config.clone() };
            let model = FieldsModel::from_bytes(config, &bytes, &Device::flex()).unwrap();
            let picture = dataset.read_input(0, 1, 63).unwrap();
            let picture = if flipped { picture.mirrored(MirrorAxis::X) } else { picture };
            let sign = if flipped { -1.0 } else { 1.0 };
            let points = Tensor::from_floats([[0.3 * sign, 0.1, 0.2], [-0.2 * sign, 0.0, 0.1]], &Device::flex());
            let logits = model.field_of_picture(&picture).occupancy_logit(&Query::new(points));
            logits.into_data().iter::<f32>().collect::<Vec<_>>()
        };
        let apart = |mirror| max_difference(&logits(mirror, false), &logits(mirror, true));
        assert!(apart(Mirror::X) < 1e-5, "{}", apart(Mirror::X));
        assert!(apart(Mirror::Off) > 1e-4, "{}", apart(Mirror::Off));
    }
}
