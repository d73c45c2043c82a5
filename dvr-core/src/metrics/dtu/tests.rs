//! A made scene of which an independent evaluation in Python knows the figures.

use glam::{DVec3, Vec3};
use image::{GrayImage, Luma};

use super::*;
use crate::camera::Camera;
use crate::mesh::{Mesh, shapes};
use crate::raster::Mask;

fn wave(x: f64, y: f64) -> f64 {
    3.0 * (x / 4.0).sin() * (y / 5.0).cos()
}

/// Waves of 40 mm, a point every quarter of a millimetre; a clump far above them, and one far below. The scanner saw about
/// half of the cells, and the table cuts off a third of the points.
pub(super) fn reference() -> DtuReference {
    let waves = (0..160 * 160).map(|n| {
        let (x, y) = (-20.0 + 0.25 * f64::from(n / 160), -20.0 + 0.25 * f64::from(n % 160));
        DVec3::new(x, y, wave(x, y))
    });
    let clump = (0..400).map(|k| DVec3::new(0.1 * f64::from(k % 20), 0.1 * f64::from(k / 20), 90.0));
    let below = (0..100).map(|k| DVec3::new(1.0 + 0.1 * f64::from(k % 10), 1.0 + 0.1 * f64::from(k / 10), -75.0));
    let shape = [41, 41, 37];
    let seen = |n: usize| n % 41 + n / 41 % 41 / 2 < 32;
    DtuReference {
        observed: ObservationMask {
            low: DVec3::new(-30.0, -30.0, -10.0),
            high: DVec3::new(30.0, 30.0, 45.0),
            cell: 1.5,
            shape,
            seen: (0..shape.iter().product()).map(seen).collect(),
        },
        plane: [0.3, 1.0, 0.0, 8.0],
        scan: Mesh { vertices: waves.chain(clump).chain(below).map(|p| p.as_vec3()).collect(), ..Mesh::default() },
    }
}

/// The waves a little higher and rougher, with a hole in a corner; a plate above them that is too far to count, and a
/// triangle below the box and its margin.
pub(super) fn surface() -> Mesh {
    let place = |n: u32| (-22.3 + f64::from(n / 45), -22.3 + f64::from(n % 45));
    let height = |x: f64, y: f64| wave(x, y) + 0.4 + 0.1 * (3.0 * x).sin();
    let waves = (0..45 * 45).map(place).map(|(x, y)| DVec3::new(x, y, height(x, y)).as_vec3());
    let corners = [[-3, -3, 35], [3, -3, 35], [3, 3, 35], [-3, 3, 35], [0, 0, -80], [9, 0, -80], [0, 9, -80]];
    let corners = corners.map(|corner| Vec3::from_array(corner.map(|x| x as f32)));
    let cells = (0..44 * 44).map(|n| (n / 44, n % 44)).filter(|&(i, j)| i < 32 || j < 32);
    let faces = cells.map(|(i, j)| i * 45 + j).flat_map(|p| [[p, p + 45, p + 46], [p, p + 46, p + 1]]);
    let first = 45 * 45;
    let more = [[0, 1, 2], [0, 2, 3], [4, 5, 6]].map(|face| face.map(|corner| first + corner));
    Mesh { vertices: waves.chain(corners).collect(), faces: faces.chain(more).collect(), ..Mesh::default() }
}

fn agrees(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-3, "{found}, expected {expected}");
}

#[test]
fn figures_are_those_of_an_independent_evaluation() {
    // Means of eight orders of the points; those of one vary by .0006.
    let (surface, reference) = (surface(), reference());
    let scores = [0, 1, 2, 3]
        .map(|seed| score_dtu(&surface, &reference, &DtuSettings { seed, ..DtuSettings::default() }).unwrap());
    let mean = |figure: fn(&DtuScore) -> f64| scores.iter().map(figure).sum::<f64>() / 4.0;
    agrees(mean(|score| score.accuracy.mean), 0.566837);
    agrees(mean(|score| score.completeness.mean), 0.398494);
    agrees(mean(|score| score.overall), 0.482665);
    agrees(mean(|score| score.accuracy.median), 0.387908);
    agrees(mean(|score| score.completeness.median), 0.389251);
    assert!((mean(|score| score.accuracy.points as f64) - 15_242.0).abs() < 60.0);
    assert!((mean(|score| score.accuracy.beyond as f64) - 346.0).abs() < 8.0);
    assert_eq!((scores[0].completeness.points, scores[0].completeness.beyond), (18_308, 500));
    assert_eq!(scores[0].alignment, None);
}

#[test]
fn a_mesh_without_faces_is_a_cloud() {
    let cloud = Mesh { faces: Vec::new(), ..surface() };
    let score = score_dtu(&cloud, &reference(), &DtuSettings { seed: 3, ..DtuSettings::default() }).unwrap();
    agrees(score.accuracy.mean, 0.637944);
    agrees(score.completeness.mean, 0.553008);
}

#[test]
fn a_surface_that_was_moved_is_brought_back_where_that_is_asked_for() {
    let mut reference = reference();
    let normal = |p: &Vec3| {
        let (x, y) = (f64::from(p.x), f64::from(p.y));
        let slope = [0.75 * (x / 4.0).cos() * (y / 5.0).cos(), -0.6 * (x / 4.0).sin() * (y / 5.0).sin()];
        DVec3::new(-slope[0], -slope[1], 1.0).normalize().as_vec3()
    };
    reference.scan.normals = Some(reference.scan.vertices.iter().map(normal).collect());
    let exact = DtuSettings::default();
    let still = score_dtu(&surface(), &reference, &exact).unwrap();
    let shift = Vec3::new(0.8, -0.5, 0.6);
    let moved = Mesh { vertices: surface().vertices.iter().map(|&p| 1.003 * p + shift).collect(), ..surface() };
    let off = score_dtu(&moved, &reference, &exact).unwrap();
    let aligned = score_dtu(&moved, &reference, &DtuSettings { align: true, ..exact }).unwrap();
    assert!(off.accuracy.mean > still.accuracy.mean + 0.1, "{} {}", off.accuracy.mean, still.accuracy.mean);
    assert!(aligned.accuracy.mean < still.accuracy.mean, "{aligned:?}");
    assert!(aligned.accuracy.beyond > 0, "what is too far away pulls nothing");
    let found = aligned.alignment.unwrap();
    assert!((found.scale - 1.0).abs() < 0.02 && found.translation.length() < 2.0, "{found:?}");
    reference.scan.normals = None;
    let estimated = score_dtu(&moved, &reference, &DtuSettings { align: true, ..exact }).unwrap();
    assert!((estimated.accuracy.mean - aligned.accuracy.mean).abs() < 0.01, "{estimated:?}");
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let (reference, settings) = (reference(), DtuSettings::default());
    let says = |mesh: Mesh, words: &str| {
        let error = score_dtu(&mesh, &reference, &settings).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    let moved = |by: f32, factor: f32| Mesh {
        vertices: surface().vertices.iter().map(|&p| factor * p + by).collect(),
        ..surface()
    };
    says(Mesh::default(), "no points within the observation mask");
    says(moved(1000.0, 1.0), "no points within the observation mask");
    says(moved(0.0, 1000.0), "must be in millimetres");
    says(moved(f32::NAN, 1.0), "not finite");
    let table = DtuReference { plane: [0.0, 0.0, 1.0, -1000.0], ..reference.clone() };
    assert!(score_dtu(&surface(), &table, &settings).is_err());
}

#[test]
fn points_that_stay_are_apart_and_those_that_go_are_near_one() {
    let points: Vec<DVec3> =
        (0..4000).map(|i| DVec3::new(f64::from(i * 37 % 100), f64::from(i * 53 % 89), 0.0) * 0.03 - 1.0).collect();
    let kept = thinning::thinned(&points, 0.2);
    let near = |a: &DVec3, b: &DVec3| a.distance(*b) <= 0.2;
    assert!(kept.iter().enumerate().all(|(i, a)| !kept[..i].iter().any(|b| near(a, b))));
    assert!(points.iter().all(|a| kept.iter().any(|b| near(a, b))));
    assert_eq!(kept[0], points[0]);
}

#[test]
fn culling_keeps_what_all_masks_show_with_their_dilation_and_what_no_frame_holds() {
    // A ball of 40 pixels across, seen from two sides; its mask lacks the upper half in one of them.
    let ball = shapes::icosphere(4, 1.0);
    let camera = |eye: DVec3| Camera::look_at(100, 100, 200.0, eye, DVec3::ZERO, DVec3::Y);
    let mask = |covers: fn(u32, u32) -> bool| {
        Mask::from(GrayImage::from_fn(100, 100, |u, v| Luma([if covers(u, v) { 255 } else { 0 }])))
    };
    let (whole, half) = (mask(|_, _| true), mask(|_, v| v >= 50));
    let views = [(camera(DVec3::Z * 10.0), &whole), (camera(DVec3::X * 10.0), &half)];
    let highest = |mesh: &Mesh| mesh.vertices.iter().fold(-2.0f32, |most, vertex| most.max(vertex.y));
    let [tight, loose, all] = [0.0, 10.0, 30.0].map(|dilation| cull(&ball, &views, dilation));
    assert!(highest(&tight).abs() < 0.05, "{}", highest(&tight));
    assert!((highest(&loose) - 0.5).abs() < 0.06, "{}", highest(&loose));
    assert_eq!((all.vertices.len(), all.faces.len()), (ball.vertices.len(), ball.faces.len()));
    assert!(tight.faces.iter().flatten().all(|&corner| (corner as usize) < tight.vertices.len()));
    assert!(tight.faces.len() < loose.faces.len() && loose.faces.len() < all.faces.len());
    let far = Mesh { vertices: ball.vertices.iter().map(|&vertex| vertex + 100.0 * Vec3::Y).collect(), ..ball };
    assert_eq!(cull(&far, &views, 0.0).faces.len(), far.faces.len());
}
