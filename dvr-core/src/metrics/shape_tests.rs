use std::path::Path;

use dvr_test_support::{fixture, scene, test_with};

use super::*;
use crate::inside::points_inside;
use crate::metrics::intersection_over_union;
use crate::npz::NpzFile;
use crate::ray::UnitCube;
use crate::sampling::sample_cube;

fn vectors(file: &mut NpzFile, name: &str) -> Vec<Vec3> {
    file.read(name).unwrap().to_f32().chunks_exact(3).map(Vec3::from_slice).collect()
}

fn cloud(points: Vec<Vec3>) -> PointCloud {
    PointCloud { points, ..PointCloud::default() }
}

fn close(name: &str, ours: f64, file: &mut NpzFile) {
    let theirs = file.read(name).unwrap().to_f64()[0];
    assert!((ours - theirs).abs() < 2e-7 + 2e-6 * theirs, "{name}: {ours} against {theirs}");
}

#[test]
fn scores_are_those_of_the_original() {
    let mut file = NpzFile::open(&fixture("mesh_eval.npz")).unwrap();
    let predicted = PointCloud {
        points: vectors(&mut file, "points_pred"),
        normals: Some(vectors(&mut file, "normals_pred")),
        colors: None,
    };
    let truth = PointCloud {
        points: vectors(&mut file, "points_gt"),
        normals: Some(vectors(&mut file, "normals_gt")),
        colors: None,
    };
    let thresholds = file.read("thresholds").unwrap().to_f64();
    let score = score_surface(&predicted, &truth, &thresholds).unwrap();
    close("out.accuracy", score.accuracy, &mut file);
    close("out.completeness", score.completeness, &mut file);
    close("out.accuracy2", score.accuracy_squared, &mut file);
    close("out.completeness2", score.completeness_squared, &mut file);
    close("out.chamferL1", score.chamfer_l1, &mut file);
    close("out.chamfer", score.chamfer_l2, &mut file);
    let normals = score.normal_consistency.unwrap();
    close("out.normals_accuracy", normals.accuracy, &mut file);
    close("out.normals_completeness", normals.completeness, &mut file);
    close("out.normals", normals.mean, &mut file);

    let read = |name: &str, file: &mut NpzFile| file.read(name).unwrap().to_f64();
    let (precision, recall, f) = (read("precision", &mut file), read("recall", &mut file), read("F", &mut file));
    let mut undefined = 0;
    for (i, ours) in score.f_scores.iter().enumerate() {
        assert!((ours.precision - precision[i]).abs() < 1e-12, "precision at {}", ours.threshold);
        assert!((ours.recall - recall[i]).abs() < 1e-12, "recall at {}", ours.threshold);
        if precision[i] + recall[i] == 0.0 {
            // The original divides 0 by 0; a surface that is nowhere near has a score, and it is 0.
            undefined += 1;
            assert!(f[i].is_nan() && ours.f_score == 0.0);
        } else {
            assert!((ours.f_score - f[i]).abs() < 1e-12, "F at {}", ours.threshold);
        }
    }
    assert_eq!(undefined, 1, "only at the smallest threshold nothing is near");
}

#[test]
fn occupancies_and_their_iou_are_those_of_the_original() {
    let mut file = NpzFile::open(&fixture("mesh_eval.npz")).unwrap();
    let points = vectors(&mut file, "iou_points");
    let mut occupancies = Vec::new();
    for name in ["a", "b"] {
        let faces = file.read(&format!("faces_{name}")).unwrap().to_i64();
        let mesh = Mesh {
            vertices: vectors(&mut file, &format!("verts_{name}")),
            faces: faces.chunks_exact(3).map(|face| [face[0], face[1], face[2]].map(|i| i as u32)).collect(),
            ..Mesh::default()
        };
        let ours = points_inside(&mesh, &points);
        let theirs = file.read(&format!("occ_{name}")).unwrap().to_bool();
        // The original counts crossings of the column through a point with strict inequalities, and so puts a point
        // outside whose column meets an edge or a corner (ours are inside: the tests of `inside` say so). None of these
        // 4000 random points is such a one, so none may differ.
        let differing: Vec<Vec3> = (0..points.len()).filter(|&i| ours[i] != theirs[i]).map(|i| points[i]).collect();
        assert!(differing.is_empty(), "mesh {name} differs at {differing:?}");
        occupancies.push(ours);
    }
    close("iou", intersection_over_union(&occupancies[0], &occupancies[1]).unwrap(), &mut file);
}

#[test]
fn empty_surfaces_have_scores() {
    let normals = Some(vec![Vec3::Z; 2]);
    let something = PointCloud { points: vec![Vec3::ZERO, Vec3::X], normals, colors: None };
    let nothing = PointCloud { normals: Some(Vec::new()), ..PointCloud::default() };
    for (a, b) in [(&something, &nothing), (&nothing, &something)] {
        let score = score_surface(a, b, &[0.1, 9.0]).unwrap();
        assert_eq!(
            (score.accuracy, score.completeness, score.chamfer_l1),
            (EMPTY_DISTANCE, EMPTY_DISTANCE, EMPTY_DISTANCE)
        );
        assert!((score.chamfer_l2 - 3.0).abs() < 1e-12);
        assert_eq!(score.normal_consistency.unwrap().mean, 0.0);
        assert!(score.f_scores.iter().all(|f| (f.precision, f.recall, f.f_score) == (0.0, 0.0, 0.0)));
    }
    let score = score_surface(&nothing, &nothing, &[0.1]).unwrap();
    assert_eq!((score.chamfer_l1, score.chamfer_l2, score.f_scores[0].f_score), (0.0, 0.0, 1.0));
    assert_eq!(score.normal_consistency.unwrap().mean, 1.0);
}

#[test]
fn points_without_normals_have_no_normal_consistency() {
    let (a, b) = (cloud(vec![Vec3::ZERO]), cloud(vec![Vec3::X * 0.3]));
    let score = score_surface(&a, &b, &[0.29, 0.31]).unwrap();
    assert_eq!(score.normal_consistency, None);
    assert!((score.chamfer_l1 - 0.3).abs() < 1e-7);
    assert_eq!(score.f_scores.iter().map(|f| f.f_score).collect::<Vec<_>>(), [0.0, 1.0]);
}

#[test]
fn broken_clouds_are_refused() {
    let good = cloud(vec![Vec3::ZERO]);
    assert!(score_surface(&cloud(vec![Vec3::NAN]), &good, &[]).unwrap_err().to_string().contains("predicted"));
    let odd = PointCloud { normals: Some(Vec::new()), ..good.clone() };
    assert!(score_surface(&good, &odd, &[]).unwrap_err().to_string().contains("true"));
}

#[test]
fn neighbours_are_right_where_many_points_share_coordinates() {
    // Planes, lines, lattices and heaps: where k-d trees have been known to break.
    let random = sample_cube(UnitCube::default(), 3000, 5);
    let snapped = |step: f32| random.iter().map(|p| (p / step).round() * step).collect::<Vec<_>>();
    let clouds = [
        random.iter().map(|p| p.with_z(0.25)).collect::<Vec<_>>(),
        random.iter().map(|p| Vec3::new(0.1, p.y, 0.25)).collect(),
        random.iter().map(|p| p.with_x(if p.x < 0.0 { -0.3 } else { 0.3 })).collect(),
        vec![Vec3::splat(0.2); 3000],
        snapped(0.1),
        snapped(0.5),
        [vec![Vec3::ZERO; 1500], random[..1500].to_vec()].concat(),
    ];
    let queries = cloud(sample_cube(UnitCube::default(), 200, 6));
    for (which, points) in clouds.into_iter().enumerate() {
        let points = cloud(points);
        let found = Surface::new("", &queries).unwrap().toward(&Surface::new("", &points).unwrap());
        for (query, distance) in queries.points.iter().zip(found.distances) {
            let distances = points.points.iter().map(|p| (p.as_dvec3() - query.as_dvec3()).length());
            assert_eq!(distances.fold(f64::INFINITY, f64::min), distance, "cloud {which}");
        }
    }
}

/// A binary PLY file of triangles without other properties, as the scenes have it.
fn read_ply(path: &Path) -> Mesh {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let count = |element: &str| -> usize {
        header.lines().find_map(|line| line.strip_prefix(element)).unwrap().trim().parse().unwrap()
    };
    let (vertices, faces) = bytes[end..].split_at(12 * count("element vertex"));
    assert_eq!(faces.len(), 13 * count("element face"));
    let word = |bytes: &[u8]| [bytes[0], bytes[1], bytes[2], bytes[3]];
    Mesh {
        vertices: vertices
            .chunks_exact(12)
            .map(|v| {
                Vec3::new(
                    f32::from_le_bytes(word(v)),
                    f32::from_le_bytes(word(&v[4..])),
                    f32::from_le_bytes(word(&v[8..])),
                )
            })
            .collect(),
        faces: faces.chunks_exact(13).map(|f| [1, 5, 9].map(|i| u32::from_le_bytes(word(&f[i..])))).collect(),
        ..Mesh::default()
    }
}

#[test_with(scene("rendered/res64"))]
fn the_floor_is_that_of_the_reference_and_clouds_tell_the_same_as_meshes() {
    for (name, reference) in [("bunny", 0.0021), ("sharp", 0.0030), ("plate", 0.0025), ("rods", 0.0016)] {
        let folder = scene(&format!("rendered/res64/{name}/{name}"));
        let by_mesh =
            surface_floor(&read_ply(&folder.join("mesh.ply")), SURFACE_SAMPLES, &F_SCORE_THRESHOLDS, 0).unwrap();
        let mut file = NpzFile::open(&folder.join("pointcloud.npz")).unwrap();
        let truth = PointCloud {
            points: vectors(&mut file, "points"),
            normals: Some(vectors(&mut file, "normals")),
            colors: None,
        };
        let by_cloud = cloud_floor(&truth, SURFACE_SAMPLES, &F_SCORE_THRESHOLDS, 0).unwrap();
        assert!((by_mesh.chamfer_l1 - reference).abs() < 6e-5, "{name}: {}", by_mesh.chamfer_l1);
        assert!((by_cloud.chamfer_l1 / by_mesh.chamfer_l1 - 1.0).abs() < 0.02);
    }
}

#[test_with(scene("rendered/res64"))]
fn the_true_occupancies_are_those_of_the_true_mesh() {
    for name in ["bunny", "rods", "plate", "sharp"] {
        let folder = scene(&format!("rendered/res64/{name}/{name}"));
        let mut file = NpzFile::open(&folder.join("points.npz")).unwrap();
        let points = vectors(&mut file, "points");
        let truth = file.read("occupancies").unwrap().to_bool_of_length(points.len()).unwrap();
        let ours = points_inside(&read_ply(&folder.join("mesh.ply")), &points);
        assert_eq!(intersection_over_union(&ours, &truth).unwrap(), 1.0, "{name}");
    }
}

#[test]
fn a_cloud_has_the_floor_of_the_surface_that_it_was_sampled_from() {
    let ball = crate::mesh::shapes::icosphere(4, 0.4);
    let sample = |count, seed| PointCloud::from(crate::sampling::sample_surface(&ball, count, seed));
    // As many predicted points as the cloud has, and four times as many.
    for predicted in [4000, 16_000] {
        let truth = score_surface(&sample(predicted, 1), &sample(4000, 2), &[]).unwrap();
        let found = cloud_floor(&sample(4000, 3), predicted, &[], 0).unwrap();
        let apart = |found: f64, truth: f64| (found / truth - 1.0).abs();
        assert!(apart(found.accuracy, truth.accuracy) < 0.05, "{} {}", found.accuracy, truth.accuracy);
        assert!(apart(found.completeness, truth.completeness) < 0.05, "{} {}", found.completeness, truth.completeness);
    }
}

#[test]
fn a_cloud_of_one_point_has_no_floor() {
    assert!(cloud_floor(&cloud(vec![Vec3::ZERO]), 10, &[], 0).is_err());
    let two = cloud(vec![Vec3::ZERO, Vec3::X]);
    assert!(cloud_floor(&two, 10, &[], 0).is_ok() && cloud_floor(&two, 0, &[], 0).is_err());
    assert!(surface_floor(&Mesh::default(), 10, &[], 0).is_err());
}
