//! Points on a surface about as far apart as asked for.

use glam::DVec3;
use rayon::prelude::*;

use super::DENSITY;
use crate::error::{ComparisonError, Result};
use crate::mesh::Mesh;

/// More points than this are not made of a mesh: a table of two square metres has as many.
const MOST_SAMPLES: f64 = 1e8;

/// The vertices of a mesh, then points of a lattice on each triangle: two edges of a corner are divided so that the
/// parallelogram of a cell has the area of a square of [`DENSITY`]. A mesh without faces is a cloud of points.
///
/// # Errors
/// When the mesh is so large that there would be more than a hundred million.
pub(super) fn surface_points(mesh: &Mesh) -> Result<Vec<DVec3>> {
    let lattices = (0..mesh.faces.len()).into_par_iter().filter_map(|face| Lattice::new(mesh.triangle(face)));
    let count: f64 = lattices.clone().map(|lattice| 0.5 * lattice.cells[0] * lattice.cells[1]).sum();
    let samples = mesh.vertices.len() as f64 + count;
    if samples > MOST_SAMPLES || samples.is_nan() {
        let problem = "has more area than 4 square metres: its coordinates must be in millimetres";
        return Err(ComparisonError::Surface { which: "predicted", problem }.into());
    }
    let mut points: Vec<DVec3> = mesh.vertices.iter().map(|vertex| vertex.as_dvec3()).collect();
    points.par_extend(lattices.flat_map_iter(|lattice| lattice.points()));
    Ok(points)
}

/// A lattice on a triangle.
struct Lattice {
    corner: DVec3,
    edges: [DVec3; 2],
    /// Cells along the two edges.
    cells: [f64; 2],
}

impl Lattice {
    /// `None` for a triangle without area.
    fn new(corners: [glam::Vec3; 3]) -> Option<Self> {
        let [corner, b, c] = corners.map(|corner| corner.as_dvec3());
        let edges = [b - corner, c - corner];
        let lengths = edges.map(|edge| edge.length());
        let area = edges[0].cross(edges[1]).length();
        let step = DENSITY * (lengths[0] * lengths[1] / area).sqrt();
        (area > 0.0).then(|| Self { corner, edges, cells: lengths.map(|length| (length / step).floor()) })
    }

    /// The centres of the cells, as far as they lie within the triangle; none where an edge is shorter than a cell.
    fn points(self) -> impl Iterator<Item = DVec3> {
        let Self { corner, edges: [along, across], cells: [n, m] } = self;
        let (columns, rows) = if n >= 1.0 && m >= 1.0 { (n as usize, m as usize) } else { (0, 0) };
        let shares = move |i: usize| {
            let s = (i as f64 + 0.5) / n;
            (0..rows).map(move |j| (s, (j as f64 + 0.5) / m)).take_while(|(s, t)| s + t < 1.0)
        };
        (0..columns).flat_map(shares).map(move |(s, t)| corner + s * along + t * across)
    }
}
