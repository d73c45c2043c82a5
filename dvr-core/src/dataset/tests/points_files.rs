//! Files of verified points.

use super::*;
use crate::mesh::{Mesh, write_mesh};
use crate::verified_points::VerifiedPoints;

fn file(folder: &tempfile::TempDir, arrays: &[(&str, Array)]) -> PathBuf {
    let path = folder.path().join("points.npz");
    write_npz(&path, &arrays.iter().map(|(name, array)| (*name, array)).collect::<Vec<_>>()).unwrap();
    path
}

fn refusal(path: &Path) -> String {
    VerifiedPoints::read(path).unwrap_err().to_string()
}

#[test]
fn points_come_from_arrays_with_what_is_known_of_each() {
    let folder = tempfile::tempdir().unwrap();
    let positions = vec![1.0, 2.0, 0.1 + 0.2, -4.0, 5.0, 6e8];
    let points = ("points", Array::f64(&[2, 3], positions));
    let views = ("views", Array { shape: vec![2], values: crate::npz::Values::I64(vec![4, 17]) });
    let read = VerifiedPoints::read(&file(&folder, &[points.clone(), views])).unwrap();
    assert_eq!(read.points, [DVec3::new(1.0, 2.0, 0.1 + 0.2), DVec3::new(-4.0, 5.0, 6e8)]);
    assert_eq!((read.track_lengths, read.errors_px), (Some(vec![4, 17]), None));
    let errors = ("error_px", Array::f32(&[2], vec![0.25, 0.5]));
    assert_eq!(VerifiedPoints::read(&file(&folder, &[points, errors])).unwrap().errors_px, Some(vec![0.25, 0.5]));
}

#[test]
fn points_come_from_the_vertices_of_a_ply_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cloud.PLY");
    let vertices = vec![glam::Vec3::new(1.5, -2.0, 300.25), glam::Vec3::Y];
    write_mesh(&path, &Mesh { vertices, ..Mesh::default() }).unwrap();
    assert_eq!(VerifiedPoints::read(&path).unwrap().points, [DVec3::new(1.5, -2.0, 300.25), DVec3::Y]);
}

#[test]
fn files_that_hold_no_sound_points_are_refused_by_name_value_and_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let flat = Array::f64(&[6], vec![0.0; 6]);
    assert!(refusal(&file(&folder, &[("points", flat)])).contains("shape [6], not [n, 3]"));
    let none = Array::f64(&[0, 3], Vec::new());
    assert!(refusal(&file(&folder, &[("points", none)])).contains("no points"));
    let broken = Array::f64(&[2, 3], vec![0.0, 0.0, 0.0, 1.0, f64::NAN, 0.0]);
    assert!(refusal(&file(&folder, &[("points", broken)])).contains("point 1 (counted from 0) is [1, NaN, 0]"));
    let one = ("points", Array::f64(&[1, 3], vec![0.0; 3]));
    let two = ("error_px", Array::f64(&[2], vec![0.0; 2]));
    assert!(refusal(&file(&folder, &[one, two])).contains("`error_px` has 2 values, and there are 1 points"));
    let other = folder.path().join("points.xyz");
    std::fs::write(&other, "1 2 3").unwrap();
    let said = refusal(&other);
    assert!(said.contains("points.xyz") && said.contains("`xyz`") && said.contains("NPZ"), "{said}");
    assert!(refusal(&folder.path().join("nowhere.npz")).contains("nowhere.npz"));
}
