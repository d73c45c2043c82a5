use glam::{DVec2, DVec3, Vec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::camera::Camera;
use crate::mesh::{Mesh, shapes};
use crate::sampling::sample_surface;
use crate::verified_points::{TrackSight, Tracks, VerifiedPoints};

fn verified(points: Vec<DVec3>) -> VerifiedPoints {
    VerifiedPoints { points, ..VerifiedPoints::default() }
}

#[test]
fn points_beside_a_box_are_as_far_as_they_were_put() {
    let mesh = shapes::cuboid(Vec3::splat(-100.0), Vec3::splat(100.0));
    // Ten points above the top face, 1 to 10 units above it; one inside, 3 below it.
    let mut points: Vec<DVec3> = (1..=10).map(|i| DVec3::new(9.0 * f64::from(i), 0.0, 100.0 + f64::from(i))).collect();
    points.push(DVec3::new(50.0, 50.0, 97.0));
    let settings = PointsSettings { thresholds: vec![3.5, 20.0], ..PointsSettings::default() };
    let score = score_points(&mesh, &verified(points), &[], &settings).unwrap();
    assert_eq!(score.points, 11);
    assert!((score.distances.mean - 58.0 / 11.0).abs() < 1e-9 && (score.distances.max - 10.0).abs() < 1e-9);
    assert_eq!(score.distances.below[0].share, 4.0 / 11.0);
    assert_eq!(score.distances.below[1].share, 1.0);
}

#[test]
fn points_on_the_mesh_are_at_no_distance_where_vertices_are_far() {
    let mesh = shapes::cuboid(Vec3::ZERO, Vec3::splat(300.0));
    let points = sample_surface(&mesh, 2000, 4).points.into_iter().map(Vec3::as_dvec3).collect();
    let score = score_points(&mesh, &verified(points), &[], &PointsSettings::default()).unwrap();
    assert!(score.distances.max < 1e-4, "{}", score.distances.max);
    // A thousandth of an extent of some 500.
    assert_eq!(score.distances.below[0].threshold, 0.5);
    assert_eq!(score.distances.below.len(), 5);
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let mesh = shapes::icosphere(1, 1.0);
    let settings = PointsSettings::default();
    let message = |mesh: &Mesh, points| score_points(mesh, &verified(points), &[], &settings).unwrap_err().to_string();
    assert!(message(&Mesh::default(), vec![DVec3::ZERO]).contains("no faces"));
    assert!(message(&mesh, Vec::new()).contains("no points"));
    assert!(message(&mesh, vec![DVec3::NAN]).contains("not finite"));
}

/// Six cameras in a half circle before the origin, 10 units away.
fn cameras() -> Vec<Camera> {
    let at = |i: i32| {
        let (x, z) = (0.25 * f64::from(i) - 0.625).sin_cos();
        Camera::look_at(800, 600, 900.0, 10.0 * DVec3::new(x, 0.1 * f64::from(i), -z), DVec3::ZERO, DVec3::Y)
    };
    (0..6).map(at).collect()
}

/// Tracks of all cameras, with features off by a normal deviation of so many pixels.
fn tracks(points: &[DVec3], pixels: f64, rng: &mut ChaCha8Rng) -> Tracks {
    let cameras = cameras();
    // Box and Muller (1958).
    let mut normal = || {
        let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
        radius * (std::f64::consts::TAU * rng.random::<f64>()).cos()
    };
    let mut sights = Vec::new();
    for &point in points {
        let sight = |(index, camera): (usize, &Camera)| {
            let p = camera.rotation * point + camera.translation;
            let noise = DVec2::new(normal(), normal()) * pixels / 900.0;
            TrackSight { camera: index, bearing: Some(DVec2::new(p.x, p.y) / p.z + noise) }
        };
        sights.push(cameras.iter().enumerate().map(sight).collect());
    }
    Tracks { sights, cameras }
}

/// A wall in the plane z = 0, six units wide, and a plate before a part of it.
fn wall(plate: Option<(Vec3, Vec3)>) -> Mesh {
    let wall = shapes::cuboid(Vec3::new(-3.0, -3.0, 0.0), Vec3::new(3.0, 3.0, 0.5));
    shapes::union([wall].into_iter().chain(plate.map(|(low, high)| shapes::cuboid(low, high))))
}

/// Two by two units, one unit in front of the wall.
const PLATE: (Vec3, Vec3) = (Vec3::new(-1.0, -1.0, -1.0), Vec3::new(1.0, 1.0, -0.9));

/// Points of the wall in rows.
fn on_wall() -> Vec<DVec3> {
    let at = |i: i32, j: i32| DVec3::new(0.25 * f64::from(i) - 2.5, 0.25 * f64::from(j) - 2.5, 0.0);
    (0..=20).flat_map(|i| (0..=20).map(move |j| at(i, j))).collect()
}

#[test]
fn the_floor_is_the_error_that_triangulated_points_have() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut coordinate = || rng.random_range(-2.0..2.0);
    let truth: Vec<DVec3> = (0..3000).map(|_| DVec3::new(coordinate(), coordinate(), 0.0)).collect();
    let tracks = tracks(&truth, 0.4, &mut rng);
    let triangulated = |sights: &Vec<TrackSight>| {
        let sighting = |sight: &TrackSight| crate::triangulation::Sighting {
            camera: &tracks.cameras[sight.camera],
            bearing: sight.bearing.unwrap(),
        };
        crate::triangulation::triangulate(&sights.iter().map(sighting).collect::<Vec<_>>()).unwrap().point
    };
    let points: Vec<DVec3> = tracks.sights.iter().map(triangulated).collect();
    let verified = VerifiedPoints { tracks: Some(tracks), ..verified(points) };
    // Against the true surface.
    let score = score_points(&wall(None), &verified, &[], &PointsSettings::default()).unwrap();
    let floor = score.floor.unwrap();
    assert_eq!(floor.points, 3000);
    assert!((floor.mean / score.distances.mean - 1.0).abs() < 0.06, "{} {}", floor.mean, score.distances.mean);
    assert!((floor.median / score.distances.median - 1.0).abs() < 0.08, "{} {}", floor.median, score.distances.median);
    assert!((floor.quantile_90 / score.distances.quantile_90 - 1.0).abs() < 0.08);
    assert!((floor.feature_px / 0.4 - 1.0).abs() < 0.06, "{}", floor.feature_px);
}

#[test]
fn short_tracks_and_tracks_without_pictures_have_no_floor() {
    let floor = |change: &dyn Fn(&mut Vec<TrackSight>)| {
        let mut tracks = tracks(&on_wall(), 0.4, &mut ChaCha8Rng::seed_from_u64(5));
        tracks.sights.iter_mut().for_each(change);
        let verified = VerifiedPoints { tracks: Some(tracks), ..verified(on_wall()) };
        score_points(&wall(None), &verified, &[], &PointsSettings::default()).unwrap().floor
    };
    assert!(floor(&|_| ()).is_some());
    assert_eq!(floor(&|sights| sights.truncate(3)), None);
    assert_eq!(floor(&|sights| sights.iter_mut().for_each(|sight| sight.bearing = None)), None);
}

#[test]
fn a_plate_before_the_wall_hides_what_lies_behind_it() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let verified = VerifiedPoints { tracks: Some(tracks(&on_wall(), 0.0, &mut rng)), ..verified(on_wall()) };
    let settings = PointsSettings { margin: Some(0.2), ..PointsSettings::default() };
    let hidden = |mesh: &Mesh| score_points(mesh, &verified, &[], &settings).unwrap().hidden.unwrap();
    let free = hidden(&wall(None));
    assert_eq!((free.points, free.sights, free.witnesses), (441, 6 * 441, Witnesses::Tracks));
    assert_eq!((free.hidden_from_all, free.blocked_sights, free.lump_area), (0.0, Some(0.0), 0.0));
    let blocked = hidden(&wall(Some(PLATE)));
    // The plate's shadow from each camera is some 2.2 units wide, of the 5 by 5 that have points, and moves with it.
    let share = blocked.blocked_sights.unwrap();
    assert!((0.13..0.25).contains(&share), "{share}");
    assert!(blocked.hidden_from_all > 0.03 && blocked.hidden_from_all < share, "{}", blocked.hidden_from_all);
    assert!(blocked.hidden_from_half.unwrap() > blocked.hidden_from_all);
    assert!(blocked.gap.median > 0.95 && blocked.gap.max < 1.7, "{:?}", blocked.gap);
    // Both faces of the plate, 4 square units each, and its narrow sides: all lies within the margin of what blocks.
    assert!((7.5..9.5).contains(&blocked.lump_area), "{}", blocked.lump_area);
}

#[test]
fn without_tracks_a_point_is_hidden_when_no_camera_sees_it() {
    let cameras = cameras();
    let cameras: Vec<&Camera> = cameras.iter().collect();
    let settings = PointsSettings { margin: Some(0.2), ..PointsSettings::default() };
    let score = |verified: &VerifiedPoints, cameras: &[&Camera]| {
        score_points(&wall(Some(PLATE)), verified, cameras, &settings).unwrap().hidden
    };
    assert_eq!(score(&verified(on_wall()), &[]), None, "nobody is there to look");
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let by_tracks = VerifiedPoints { tracks: Some(tracks(&on_wall(), 0.0, &mut rng)), ..verified(on_wall()) };
    let by_tracks = score(&by_tracks, &[]).unwrap();
    let lengths = VerifiedPoints { track_lengths: Some(vec![6; 441]), ..verified(on_wall()) };
    let by_lengths = score(&lengths, &cameras).unwrap();
    assert_eq!(by_lengths.witnesses, Witnesses::Frames);
    assert_eq!(by_lengths.hidden_from_all, by_tracks.hidden_from_all);
    assert_eq!(by_lengths.blocked_sights, by_tracks.blocked_sights, "all six views triangulated each point");
    assert_eq!(score(&verified(on_wall()), &cameras).unwrap().blocked_sights, None);
    // Points on the back of the wall: all cameras have them in the frame, and none sees them.
    let behind: Vec<DVec3> = on_wall().into_iter().map(|point| point.with_z(0.5)).collect();
    assert_eq!(score(&verified(behind), &cameras).unwrap().hidden_from_all, 1.0);
}
