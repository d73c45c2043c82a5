//! Cameras that are off come back, and those that are right stay.

use dvr_core::mesh::shapes;
use dvr_core::{Cancellation, Scene, Similarity};
use dvr_tests::rendered_scene;
use dvr_train::{GridConfig, refine_cameras};
use glam::{DMat3, DVec3};

/// A turned cuboid with a bump, from sixteen sides.
fn scene() -> Scene {
    let box_and_bump = shapes::union([
        shapes::cuboid(glam::Vec3::new(-0.3, -0.2, -0.25), glam::Vec3::new(0.3, 0.2, 0.25)),
        shapes::cuboid(glam::Vec3::new(0.05, 0.1, -0.1), glam::Vec3::new(0.2, 0.35, 0.15)),
    ]);
    let colors = |vertex: &glam::Vec3| [vertex.x + 0.5, vertex.y + 0.5, vertex.z + 0.5];
    let mesh =
        dvr_core::mesh::Mesh { colors: Some(box_and_bump.vertices.iter().map(colors).collect()), ..box_and_bump };
    rendered_scene(mesh, 16, 48)
}

/// Turns each camera on the spot by a degree about an axis of its own.
fn disturbed(scene: &Scene) -> Scene {
    let mut wrong = scene.clone();
    for (i, view) in wrong.views.iter_mut().enumerate() {
        let i = i as f64;
        let axis = DVec3::new((2.1 * i).sin(), (3.7 * i).cos(), (1.3 * i + 1.0).sin()).normalize();
        let center = view.camera.center();
        view.camera.rotation = DMat3::from_axis_angle(axis, 1f64.to_radians()) * view.camera.rotation;
        view.camera.translation = -(view.camera.rotation * center);
    }
    wrong
}

/// Pixels between the pictures of the cube's corners, pulled in, in two scenes; the second is first brought to where
/// its cameras are nearest to the first's.
fn distance(exact: &Scene, other: &Scene) -> f64 {
    let cameras = |scene: &Scene| scene.views.iter().map(|view| view.camera.clone()).collect::<Vec<_>>();
    let gauge = Similarity::between_cameras(&cameras(other), &cameras(exact)).unwrap();
    let corners = (0..8).map(|i| 0.25 * DVec3::new([-1.0, 1.0][i & 1], [-1.0, 1.0][i >> 1 & 1], [-1.0, 1.0][i >> 2]));
    let corners: Vec<DVec3> = corners.collect();
    let views = || exact.views.iter().zip(&other.views);
    let squares = views().flat_map(|(a, b)| {
        let b = b.camera.into_world(&gauge);
        corners.iter().map(move |&point| (a.camera.project(point).0 - b.project(point).0).length_squared())
    });
    (squares.sum::<f64>() / (8 * exact.views.len()) as f64).sqrt()
}

#[test]
fn cameras_that_are_off_come_back_and_right_ones_stay() {
    let exact = scene();
    let config = GridConfig { rays: 512, ..GridConfig::default() };
    let refine = |scene: &mut Scene| refine_cameras(scene, &config, 5, &Cancellation::default(), &mut ()).unwrap();

    let mut wrong = disturbed(&exact);
    let before = distance(&exact, &wrong);
    let refined = refine(&mut wrong);
    let after = distance(&exact, &wrong);
    println!("{before:.3} pixels before, {after:.3} after");
    assert!(after < 0.75 * before, "{before} pixels before, {after} after; {}", refined.note());
    assert_eq!(refined.cameras.len(), exact.views.len());
    assert!(refined.loss[1] < refined.loss[0]);

    let mut right = exact.clone();
    let refined = refine(&mut right);
    assert!(refined.cameras.is_empty(), "{}", refined.note());
    let is_same = |(a, b): (&dvr_core::View, &dvr_core::View)| a.camera == b.camera;
    assert!(exact.views.iter().zip(&right.views).all(is_same));
}

#[test]
fn an_interruption_leaves_the_cameras_as_they_were() {
    let exact = scene();
    let mut scene = exact.clone();
    let cancellation = Cancellation::default();
    cancellation.cancel();
    let refined = refine_cameras(&mut scene, &GridConfig::default(), 6, &cancellation, &mut ());
    assert!(matches!(refined, Err(dvr_train::Error::Cancelled(_))));
    assert!(exact.views.iter().zip(&scene.views).all(|(a, b)| a.camera == b.camera));
}
