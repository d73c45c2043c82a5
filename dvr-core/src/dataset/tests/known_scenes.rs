//! The scenes of `DVR_SCENES`: real photographs, other people's files, and renders whose truth is known.

use dvr_test_support::{scene, test_with};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::*;
use crate::hull::{Bounds, HullSettings, VisualHull, silhouette_consistency};
use crate::scene::{Split, View};

/// Whether the masks' hull lies within the cube, is not small, and explains the masks.
///
/// Where the object leaves the pictures, a hull of what few views see has spurs: `min_seeing` cuts them off.
#[track_caller]
fn assert_placed(scene: &Scene, min_seeing: usize) {
    let views: Vec<_> = scene.views.iter().filter_map(View::training_pair).collect();
    let settings = HullSettings { min_seeing, ..HullSettings::default() };
    let hull = VisualHull::carve(&views, Bounds::cube(DVec3::ZERO, 0.6), 96, &settings).unwrap();
    let found = hull.bounding_box().expect("the hull is empty");
    let reach = found.min.abs().max(found.max.abs()).max_element();
    println!("{}: hull {:.3} .. {:.3} of the cube", scene.name, found.min, found.max);
    assert!(reach < 0.5, "{}: the hull reaches {reach}", scene.name);
    assert!(found.size().max_element() > 0.8, "{}: the hull is {} wide", scene.name, found.size());
    let mut consistency = silhouette_consistency(&views, &hull).unwrap();
    consistency.sort_by(f64::total_cmp);
    println!("{}: median {:?}, worst {:?}", scene.name, consistency[consistency.len() / 2], consistency.last());
}

#[test_with(scene("rendered"))]
fn rendered_surfaces_fall_on_their_masks_at_their_depths() {
    let root = scene("rendered");
    for (resolution, object) in ["bunny", "rods", "plate", "sharp"].iter().flat_map(|o| [(64, o), (128, o)]) {
        let category = root.join(format!("res{resolution}/{object}"));
        let scene = read(&category);
        assert_eq!((scene.name.as_str(), scene.views.len(), scene.format), (*object, 24, "DVR"));
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        let occupancy = scene.ground_truth.occupancy.as_ref().unwrap();
        assert_eq!((occupancy.points.len(), occupancy.inside.len()), (100_000, 100_000));
        let surface = scene.ground_truth.surface.as_ref().unwrap();
        assert_eq!(surface.points.len(), 100_000);
        let points = || surface.points.par_iter().step_by(20).map(|point| point.as_dvec3());
        let (mut on_mask, mut seen, mut in_front, mut total) = (0, 0, 0, 0);
        for view in &scene.views {
            let pixel_size = 2.0 / f64::from(resolution) / 1.75 * 1.5;
            let depth = view.depth.as_ref().unwrap();
            let of_point = |point: DVec3| {
                let (pixel, z) = view.camera.project(point);
                let (u, v) = (pixel.x as u32, pixel.y as u32);
                // A surface point may fall just beside a pixel whose centre is background.
                let near = |test: &dyn Fn(u32, u32) -> bool| {
                    (u.saturating_sub(1)..=(u + 1).min(resolution - 1))
                        .any(|u| (v.saturating_sub(1)..=(v + 1).min(resolution - 1)).any(|v| test(u, v)))
                };
                let on_mask = view.camera.sees(pixel) && near(&|u, v| view.is_object(u, v));
                // Nothing of the surface is in front of the depth map, and about half is right on it.
                let nearest = near(&|u, v| f64::from(depth.get(u, v)) < z + 3.0 * pixel_size);
                let at = (f64::from(depth.get(u.min(resolution - 1), v.min(resolution - 1))) - z).abs();
                (usize::from(on_mask), usize::from(at < 1.5 * pixel_size), usize::from(!nearest), 1)
            };
            let sums =
                points().map(of_point).reduce(|| (0, 0, 0, 0), |a, b| (a.0 + b.0, a.1 + b.1, a.2 + b.2, a.3 + b.3));
            (on_mask, seen, in_front, total) = (on_mask + sums.0, seen + sums.1, in_front + sums.2, total + sums.3);
        }
        let share = |count: usize| count as f64 / total as f64;
        println!(
            "{object} at {resolution}: {:.4} on the mask, {:.3} at the depth, {:.5} in front of it",
            share(on_mask),
            share(seen),
            share(in_front)
        );
        // A rod is 0.8 pixels wide at 64: parts of it fall between the pixels.
        let thin = *object == "rods" && resolution == 64;
        assert!(share(on_mask) > if thin { 0.98 } else { 0.99 });
        assert!((0.2..0.8).contains(&share(seen)));
        assert!(share(in_front) < if thin { 0.02 } else { 0.01 });
    }
}

/// Mean distance of a depth map's points from the planes of the true surface, for rays `shift` pixels off the centres.
fn plane_distance(scene: &Scene, tree: &ImmutableKdTree<f64, 3>, shift: f64) -> f64 {
    let surface = scene.ground_truth.surface.as_ref().unwrap();
    let normals = surface.normals.as_ref().unwrap();
    let distances: Vec<f64> = scene.views[..6]
        .par_iter()
        .flat_map_iter(|view| {
            let depth = view.depth.as_ref().unwrap();
            let pixels = (0..depth.height).flat_map(|v| (0..depth.width).map(move |u| (u, v)));
            pixels.filter(|&(u, v)| depth.get(u, v).is_finite()).map(|(u, v)| {
                let pixel = DVec2::new(u.into(), v.into()) + 0.5 + shift;
                let point = view.camera.ray(pixel).at(depth.get(u, v).into());
                let nearest = tree.query(&point.to_array()).nearest_one::<SquaredEuclidean<f64>>().execute();
                let nearest = nearest.item as usize;
                (point - surface.points[nearest].as_dvec3()).dot(normals[nearest].as_dvec3()).abs()
            })
        })
        .collect();
    distances.iter().sum::<f64>() / distances.len() as f64
}

#[test_with(scene("rendered/res64/bunny"))]
fn depth_maps_are_exact_at_pixel_centres_and_nowhere_else() {
    let root = scene("rendered/res64/bunny");
    let scene = read(&root);
    let points = scene.ground_truth.surface.as_ref().unwrap().points.iter().map(|p| p.as_dvec3().to_array());
    let tree = ImmutableKdTree::new_from_slice(&points.collect::<Vec<_>>()).unwrap();
    let [centre, corner, next] = [0.0, -0.5, 0.5].map(|shift| plane_distance(&scene, &tree, shift));
    println!("bunny: {centre:.5} from the surface at pixel centres, {corner:.5} and {next:.5} at corners");
    assert!(centre < 5e-4, "in units of the object cube");
    assert!(corner > 5.0 * centre && next > 5.0 * centre);
}

#[test_with(scene("dino_sparse_ring"), scene("temple_sparse_ring"))]
fn the_dinosaur_and_the_temple_fill_the_cube() {
    for name in ["dino_sparse_ring", "temple_sparse_ring"] {
        let scene = read(&scene(name));
        assert_eq!((scene.views.len(), scene.format, scene.name.as_str()), (16, "Middlebury", name));
        assert_eq!(scene.views[0].image.dimensions(), (640, 480));
        assert!(scene.object_to_world.scale > 0.05 && scene.object_to_world.scale < 0.3, "metres");
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        assert_placed(&scene, 12);
    }
}

#[test_with(scene("dtu_scan65"))]
fn the_skull_fills_the_cube() {
    let root = scene("dtu_scan65");
    let scene = read(&root);
    assert_eq!((scene.views.len(), scene.format), (49, "IDR/NeuS"));
    assert!(scene.object_to_world.scale > 100.0 && scene.object_to_world.scale < 500.0, "millimetres");
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert_placed(&scene, 25);
    let by_idr = read(&root.join("cameras.npz"));
    assert!((by_idr.object_to_world.translation - scene.object_to_world.translation).length() < 1e-3);
    let options = ReadOptions { normalise: Normalise::Files, n_views: Some(4), ..ReadOptions::default() };
    assert!((read_scene(&root, &options).unwrap().object_to_world.scale - 2.0 * 164.60439).abs() < 1e-3);
}

#[test_with(scene("nerf_chair"))]
fn the_chair_fills_the_cube() {
    let root = scene("nerf_chair");
    let scene = read(&root);
    let count = |split| scene.views_of(split).count();
    assert_eq!((count(Split::Train), count(Split::Val), count(Split::Test)), (100, 10, 20));
    assert_eq!(scene.warnings.len(), 2, "pictures of two lists are missing: {:?}", scene.warnings);
    assert_placed(&scene, 1);
}
