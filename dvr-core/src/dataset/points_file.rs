//! Files of verified points: NPZ, PLY and COLMAP's `points3D`.

use std::path::Path;

use glam::{DVec3, Vec3};

use super::layouts::read_colmap_points;
use crate::error::{Error, Result};
use crate::mesh::read_mesh;
use crate::npz::{Array, NpzFile};
use crate::verified_points::VerifiedPoints;

impl VerifiedPoints {
    /// Reads points in the world of a scene's files, by the file's extension:
    ///
    /// - `.npz`: `points` `[n, 3]`; where they are there, `views` `[n]`, by how many views each was triangulated, and
    ///   `error_px` `[n]`, its reprojection error;
    /// - `.ply`: the vertices; faces are not looked at;
    /// - `.bin`, `.txt`: COLMAP's `points3D`; with the tracks where `cameras` and `images` lie beside it and the
    ///   cameras are pinholes.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be read; [`Error::Format`] where it is of another format, is damaged, or has
    /// no points, points that are not finite, or another number of views or errors than of points.
    pub fn read(path: &Path) -> Result<Self> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let read = match extension.as_str() {
            "npz" => read_npz(path)?,
            "ply" => read_ply(path)?,
            "bin" | "txt" => read_colmap_points(path)?,
            other => {
                return Err(Error::format(
                    path,
                    format!("`{other}` is not a format of points that is known here"),
                    "Use NPZ (an array `points` of [n, 3]), PLY, or COLMAP's points3D.bin or points3D.txt.",
                ));
            }
        };
        if read.points.is_empty() {
            return Err(Error::format(path, "there are no points", "Check that this is the file that was meant."));
        }
        if let Some(point) = read.points.iter().position(|point| !point.is_finite()) {
            let problem = format!("point {point} (counted from 0) is {}", read.points[point]);
            return Err(Error::format(path, problem, "Remove points with NaN or infinite coordinates."));
        }
        Ok(read)
    }
}

fn read_npz(path: &Path) -> Result<VerifiedPoints> {
    let mut npz = NpzFile::open(path)?;
    let points = npz.read("points")?;
    let &[count, 3] = &points.shape[..] else {
        let problem = format!("`points` has shape {:?}, not [n, 3]", points.shape);
        return Err(Error::format(path, problem, "Write one point a row."));
    };
    let mut one_a_point = |name: &str| -> Result<Option<Array>> {
        let array = if npz.contains(name) { Some(npz.read(name)?) } else { None };
        match array {
            Some(array) if array.len() != count => {
                let problem = format!("`{name}` has {} values, and there are {count} points", array.len());
                Err(Error::format(path, problem, "Write one value a point."))
            }
            array => Ok(array),
        }
    };
    let track_lengths = one_a_point("views")?;
    let errors_px = one_a_point("error_px")?;
    Ok(VerifiedPoints {
        points: points.to_f64().chunks_exact(3).map(DVec3::from_slice).collect(),
        track_lengths: track_lengths.map(|views| views.to_i64().iter().map(|&n| n.max(0) as usize).collect()),
        errors_px: errors_px.map(|errors| errors.to_f64()),
        tracks: None,
    })
}

fn read_ply(path: &Path) -> Result<VerifiedPoints> {
    let vertices = read_mesh(path)?.mesh.vertices;
    Ok(VerifiedPoints { points: vertices.into_iter().map(Vec3::as_dvec3).collect(), ..VerifiedPoints::default() })
}
