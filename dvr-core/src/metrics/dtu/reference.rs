//! The evaluation data: the scan, what was observed of the scene, and the table.

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::error::{Error, Result};
use crate::mat::{MatArray, read_mat};
use crate::mesh::{Mesh, read_mesh};

const REMEDY: &str = "Copy the file again from the data set's SampleSet.";

/// What a surface of a scan is measured by, in millimetres.
#[derive(Clone, Debug, PartialEq)]
pub struct DtuReference {
    /// Where the scanner saw anything.
    pub observed: ObservationMask,
    /// The plane of the table: `a x + b y + c z + d` is positive above it.
    pub plane: [f64; 4],
    /// The scanner's points, as vertices without faces; with normals where the file has them.
    pub scan: Mesh,
}

/// Cells that the scanner saw.
#[derive(Clone, Debug, PartialEq)]
pub struct ObservationMask {
    /// The lowest corner of the box; the centre of the first cell.
    pub low: DVec3,
    /// The highest corner.
    pub high: DVec3,
    /// Edge of a cell.
    pub cell: f64,
    /// Cells along x, y and z.
    pub shape: [usize; 3],
    /// Whether each cell was seen; x runs fastest.
    pub seen: Vec<bool>,
}

impl ObservationMask {
    /// Whether the cell of a point was seen; a point half way between two belongs to the even one.
    pub fn sees(&self, point: DVec3) -> bool {
        let place = ((point - self.low) / self.cell).to_array().map(f64::round_ties_even);
        let is_within = |axis: usize| place[axis] >= 0.0 && place[axis] < self.shape[axis] as f64;
        let [x, y, z] = place.map(|i| i as usize);
        (0..3).all(is_within) && self.seen[x + self.shape[0] * (y + self.shape[1] * z)]
    }
}

impl DtuReference {
    /// Reads the data of a scan from a folder in the data set's layout: `ObsMask/ObsMask24_10.mat`, `ObsMask/Plane24.mat`
    /// and `Points/stl/stl024_total.ply`.
    ///
    /// # Errors
    /// [`Error::Format`] where a file is missing or damaged, and the errors of [`read_mat`] and [`read_mesh`].
    pub fn read(folder: &Path, scan: u32) -> Result<Self> {
        let [mask, plane, points] = Self::files(folder, scan);
        for path in [&mask, &plane, &points] {
            if !path.is_file() {
                let name = path.strip_prefix(folder).unwrap_or(path).display();
                let problem = format!("there is no {name}, which the evaluation of scan {scan} needs");
                let remedy =
                    "Give the folder that holds DTU's `ObsMask` and `Points` (SampleSet and Points, unpacked).";
                return Err(Error::format(folder, problem, remedy));
            }
        }
        Ok(Self { observed: read_mask(&mask)?, plane: read_plane(&plane)?, scan: read_scan(&points)? })
    }

    /// Mask, plane and points of a scan.
    pub fn files(folder: &Path, scan: u32) -> [PathBuf; 3] {
        [
            folder.join(format!("ObsMask/ObsMask{scan}_10.mat")),
            folder.join(format!("ObsMask/Plane{scan}.mat")),
            folder.join(format!("Points/stl/stl{scan:03}_total.ply")),
        ]
    }

    /// The scans whose files are all in such a folder, in ascending order; none where there is no such folder.
    pub fn scans(folder: &Path) -> Vec<u32> {
        let Ok(entries) = std::fs::read_dir(folder.join("ObsMask")) else { return Vec::new() };
        let scan_of = |name: &str| name.strip_prefix("ObsMask")?.strip_suffix("_10.mat")?.parse().ok();
        let scan = |entry: std::fs::DirEntry| scan_of(&entry.file_name().to_string_lossy());
        let has_all = |scan: &u32| Self::files(folder, *scan).iter().all(|path| path.is_file());
        let mut scans: Vec<u32> = entries.flatten().filter_map(scan).filter(has_all).collect();
        scans.sort_unstable();
        scans
    }

    /// Whether a point is above the table.
    pub fn is_above_table(&self, point: DVec3) -> bool {
        let [a, b, c, d] = self.plane;
        a * point.x + b * point.y + c * point.z + d > 0.0
    }
}

fn read_mask(path: &Path) -> Result<ObservationMask> {
    let wrong = |problem: String| Error::format(path, problem, REMEDY);
    let [cell, corners, seen]: [MatArray; 3] =
        read_mat(path, &["Res", "BB", "ObsMask"])?.try_into().map_err(|_| wrong("an array is missing".to_owned()))?;
    let shape: [usize; 3] = (seen.shape.as_slice().try_into())
        .map_err(|_| wrong(format!("`ObsMask` has shape {:?}, expected three axes", seen.shape)))?;
    // The Python evaluation has the box in single precision.
    let corners: Vec<f64> = corners.to_f64().into_iter().map(|x| f64::from(x as f32)).collect();
    let &[x0, x1, y0, y1, z0, z1] = corners.as_slice() else {
        return Err(wrong(format!("`BB` has {} numbers, expected the corners of a box, [2, 3]", corners.len())));
    };
    let (low, high) = (DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1));
    if !low.is_finite() || !high.is_finite() || !low.cmple(high).all() {
        return Err(wrong(format!("`BB` goes from {low} to {high}, expected a box")));
    }
    let cell = cell.to_f64();
    let cell = cell.first().copied().filter(|&cell| cell.is_finite() && cell > 0.0 && cell.recip().is_finite());
    let cell = cell.ok_or_else(|| wrong("`Res` is no length, expected the edge of a cell".to_owned()))?;
    Ok(ObservationMask { low, high, cell, shape, seen: seen.into_truths() })
}

fn read_plane(path: &Path) -> Result<[f64; 4]> {
    let plane = read_mat(path, &["P"])?.iter().flat_map(MatArray::to_f64).collect::<Vec<_>>();
    let numbers: Option<[f64; 4]> = plane.as_slice().try_into().ok();
    numbers
        .filter(|numbers| numbers.iter().all(|number| number.is_finite()))
        .ok_or_else(|| Error::format(path, format!("`P` is {plane:?}, expected the four numbers of a plane"), REMEDY))
}

fn read_scan(path: &Path) -> Result<Mesh> {
    let scan = read_mesh(path)?.mesh;
    if scan.vertices.is_empty() {
        return Err(Error::format(path, "there are no points", REMEDY));
    }
    Ok(Mesh { vertices: scan.vertices, normals: scan.normals, ..Mesh::default() })
}
