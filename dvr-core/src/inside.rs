//! Whether points lie inside a mesh, by generalised winding numbers.
//!
//! The winding number (Jacobson et al. 2013) counts how often the surface goes around a point: an integer for a
//! watertight mesh, and a smooth guess where there are holes. Groups of triangles that are far away are replaced by the
//! first terms of their multipole expansion, in a tree (Barill et al. 2018, "Fast Winding Numbers for Soups and
//! Clouds").

use std::f64::consts::PI;

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use crate::mesh::Mesh;

/// A group of triangles is expanded when it is farther than this many of its radii: the paper's beta, and its choice.
/// The winding number is then wrong by 0.0045 at worst on spheres, and by 0.07 without the second-order terms.
const FAR: f64 = 2.0;

/// Triangles in a leaf of the tree.
const LEAF: usize = 8;

/// Triangles longer than this share of the mesh are split, as a group is never far from what it spans: without it, the
/// bars of a wire frame are summed up one triangle at a time.
const LONG: f64 = 1.0 / 32.0;

/// Most triangles that splitting may make; a mesh of more than an eighth of it may become eight times as many.
const MOST_PIECES: usize = 1 << 21;

/// Meshes of fewer triangles than this are not worth splitting.
const FEW: usize = 256;

/// For each point, whether it is inside the mesh: [`WindingNumbers::contains`] for many points, in parallel.
///
/// ```
/// use dvr_core::{inside::points_inside, mesh::Mesh};
/// use glam::Vec3;
///
/// let tetrahedron = Mesh {
///     vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
///     faces: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
///     ..Mesh::default()
/// };
/// assert_eq!(points_inside(&tetrahedron, &[Vec3::splat(0.1), Vec3::splat(0.5)]), [true, false]);
/// ```
pub fn points_inside(mesh: &Mesh, points: &[Vec3]) -> Vec<bool> {
    let winding_numbers = WindingNumbers::new(mesh);
    points.par_iter().map(|&point| winding_numbers.contains(point)).collect()
}

/// A mesh, prepared to be asked for its winding number at many points.
#[derive(Clone, Debug)]
pub struct WindingNumbers {
    triangles: Vec<[DVec3; 3]>,
    /// The root first, children always after their parent.
    nodes: Vec<Node>,
}

/// A group of triangles that are consecutive in the list, and its expansion around `center`.
#[derive(Clone, Debug)]
struct Node {
    first: usize,
    end: usize,
    /// The second child, or 0 for a leaf; the first child is the next node.
    second_child: usize,
    /// Area-weighted mean of the triangles' centroids.
    center: DVec3,
    /// The farthest corner's distance.
    radius: f64,
    /// Sum of the triangles' area vectors `a n`.
    dipole: DVec3,
    /// Integral of `n d^T`, `d` being positions relative to the centre.
    quadrupole: DMat3,
    /// Integrals of `n_i d d^T`, for each `i`.
    octupole: [DMat3; 3],
    /// Integral of `2 d (d . n) + n |d|^2`, the traces of the octupole.
    octupole_trace: DVec3,
}

impl WindingNumbers {
    /// Builds the tree. Triangles with a corner that is not finite are left out.
    pub fn new(mesh: &Mesh) -> Self {
        let mut triangles: Vec<[DVec3; 3]> = (0..mesh.faces.len())
            .map(|face| mesh.triangle(face).map(|corner| corner.as_dvec3()))
            .filter(|corners| corners.iter().all(|corner| corner.is_finite()))
            .collect();
        if triangles.len() >= FEW {
            triangles = split_long(triangles);
        }
        let mut nodes = Vec::new();
        if !triangles.is_empty() {
            let count = triangles.len();
            build(&mut triangles, 0, count, &mut nodes);
        }
        Self { triangles, nodes }
    }

    /// The winding number: 1 inside, 0 outside of a watertight mesh (to about 0.005), -1
    /// inside one that is turned inside out, a half on the surface, and sums where solids overlap.
    pub fn at(&self, point: Vec3) -> f64 {
        let point = point.as_dvec3();
        let mut solid_angle = 0.0;
        let mut stack = if self.nodes.is_empty() { Vec::new() } else { vec![0] };
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index];
            if (node.center - point).length_squared() > (FAR * node.radius).powi(2) {
                solid_angle += node.expansion(point);
            } else if node.second_child == 0 {
                let triangles = &self.triangles[node.first..node.end];
                solid_angle += triangles.iter().map(|&corners| triangle_solid_angle(corners, point)).sum::<f64>();
            } else {
                stack.extend([node.second_child, index + 1]);
            }
        }
        solid_angle / (4.0 * PI)
    }

    /// Whether the surface goes around the point at least half a time, in whichever sense: a mesh that is turned inside
    /// out has the same inside, and solids that overlap are united.
    pub fn contains(&self, point: Vec3) -> bool {
        self.at(point).abs() > 0.5
    }
}

/// Halves the longest edges until none is long. This changes no solid angle but for rounding.
///
/// Where that would make too many triangles, as of a mesh that consists of long ones alone, longer ones are left.
fn split_long(triangles: Vec<[DVec3; 3]>) -> Vec<[DVec3; 3]> {
    let start = triangles[0][0];
    let corners = triangles.iter().flatten();
    let (low, high) = corners.fold((start, start), |(low, high), corner| (low.min(*corner), high.max(*corner)));
    let most = MOST_PIECES.max(8 * triangles.len());
    let mut length = (high - low).length() * LONG;
    loop {
        match split_above(triangles.clone(), length * length, most) {
            Some(short) => return short,
            None => length *= 2.0,
        }
    }
}

/// The triangles with edges of squared length `limit` at most, or `None` where these are more than `most`.
fn split_above(mut pending: Vec<[DVec3; 3]>, limit: f64, most: usize) -> Option<Vec<[DVec3; 3]>> {
    let mut short = Vec::with_capacity(pending.len());
    while let Some([a, b, c]) = pending.pop() {
        if short.len() + pending.len() >= most {
            return None;
        }
        let (ab, bc, ca) = (a.distance_squared(b), b.distance_squared(c), c.distance_squared(a));
        // Turned so that the longest edge comes first.
        let [a, b, c] = if ab >= bc.max(ca) {
            [a, b, c]
        } else if bc >= ca {
            [b, c, a]
        } else {
            [c, a, b]
        };
        if ab.max(bc).max(ca) > limit {
            let middle = a.midpoint(b);
            pending.extend([[a, middle, c], [middle, b, c]]);
        } else {
            short.push([a, b, c]);
        }
    }
    Some(short)
}

/// Makes the node of `triangles[first..end]` and, after it, those of its parts.
fn build(triangles: &mut [[DVec3; 3]], first: usize, end: usize, nodes: &mut Vec<Node>) {
    let index = nodes.len();
    nodes.push(Node::of(&triangles[first..end], first));
    if end - first <= LEAF {
        return;
    }
    let centroid = |corners: &[DVec3; 3]| corners.iter().sum::<DVec3>();
    let group = &mut triangles[first..end];
    let start = centroid(&group[0]);
    let (low, high) = group.iter().map(centroid).fold((start, start), |(low, high), c| (low.min(c), high.max(c)));
    let size = high - low;
    let axis = (0..3).fold(0, |best, axis| if size[axis] > size[best] { axis } else { best });
    let half = group.len() / 2;
    group.select_nth_unstable_by(half, |a, b| centroid(a)[axis].total_cmp(&centroid(b)[axis]));
    build(triangles, first, first + half, nodes);
    nodes[index].second_child = nodes.len();
    build(triangles, first + half, end, nodes);
}

impl Node {
    fn of(triangles: &[[DVec3; 3]], first: usize) -> Self {
        let area_vector = |[a, b, c]: &[DVec3; 3]| 0.5 * (*b - *a).cross(*c - *a);
        let centroid = |corners: &[DVec3; 3]| corners.iter().sum::<DVec3>() / 3.0;
        let (mut total, mut weighted, mut plain, mut dipole) = (0.0, DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        for corners in triangles {
            let vector = area_vector(corners);
            dipole += vector;
            total += vector.length();
            weighted += vector.length() * centroid(corners);
            plain += centroid(corners);
        }
        let center = if total > 0.0 { weighted / total } else { plain / triangles.len() as f64 };
        let mut node = Self {
            first,
            end: first + triangles.len(),
            second_child: 0,
            center,
            radius: 0.0,
            dipole,
            quadrupole: DMat3::ZERO,
            octupole: [DMat3::ZERO; 3],
            octupole_trace: DVec3::ZERO,
        };
        for corners in triangles {
            let (vector, middle) = (area_vector(corners), centroid(corners) - center);
            node.quadrupole += outer(vector, middle);
            // The mean of d d^T over a triangle, exactly: its corners weigh 1/12 each and its centroid 9/12.
            let mut moment = 9.0 * outer(middle, middle);
            for corner in corners {
                let d = *corner - center;
                moment += outer(d, d);
                node.radius = node.radius.max(d.length());
            }
            moment *= 1.0 / 12.0;
            for i in 0..3 {
                node.octupole[i] += moment * vector[i];
            }
            node.octupole_trace += 2.0 * (moment * vector) + vector * trace(&moment);
        }
        node
    }

    /// The solid angle of the group from afar: the integral of `n . x / |x|^3` with `x = r + d`, to second order in
    /// `d`.
    fn expansion(&self, point: DVec3) -> f64 {
        let r = self.center - point;
        let squared = r.length_squared();
        let first = trace(&self.quadrupole) - 3.0 * r.dot(self.quadrupole * r) / squared;
        let cubic = self.octupole[0] * r.x + self.octupole[1] * r.y + self.octupole[2] * r.z;
        let second = 1.5 * (5.0 * r.dot(cubic * r) / squared - self.octupole_trace.dot(r)) / squared;
        (self.dipole.dot(r) + first + second) / (squared * squared.sqrt())
    }
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

fn trace(matrix: &DMat3) -> f64 {
    matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z
}

/// The signed solid angle of a triangle (Van Oosterom and Strackee 1983); positive if its back side is seen.
fn triangle_solid_angle(corners: [DVec3; 3], point: DVec3) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - point);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let numerator = a.dot(b.cross(c));
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    // In the triangle's plane the numerator is 0, and its sign must not decide between +2 pi and -2 pi.
    if numerator == 0.0 { 0.0 } else { 2.0 * numerator.atan2(denominator) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ray::UnitCube;
    use crate::sampling::sample_cube;

    /// A sphere of `2 n` by `n` quads around the origin, without its poles' doubled corners.
    fn sphere(radius: f64, n: usize) -> Mesh {
        let mut mesh = Mesh { vertices: vec![(DVec3::Z * radius).as_vec3()], ..Mesh::default() };
        for i in 1..n {
            let (sin, cos) = (PI * i as f64 / n as f64).sin_cos();
            for j in 0..2 * n {
                let (y, x) = (PI * j as f64 / n as f64).sin_cos();
                mesh.vertices.push((radius * DVec3::new(sin * x, sin * y, cos)).as_vec3());
            }
        }
        mesh.vertices.push((DVec3::NEG_Z * radius).as_vec3());
        let at = |i: usize, j: usize| match i {
            0 => 0,
            i if i == n => (2 * n * (n - 1) + 1) as u32,
            i => (1 + (i - 1) * 2 * n + j % (2 * n)) as u32,
        };
        for i in 0..n {
            for j in 0..2 * n {
                let quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                let triangles = [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]];
                mesh.faces.extend(triangles.into_iter().filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
            }
        }
        mesh
    }

    fn slow_winding_number(mesh: &Mesh, point: Vec3) -> f64 {
        let angle = |face| triangle_solid_angle(mesh.triangle(face).map(|v| v.as_dvec3()), point.as_dvec3());
        (0..mesh.faces.len()).map(angle).sum::<f64>() / (4.0 * PI)
    }

    #[test]
    fn the_tree_agrees_with_the_sum_over_all_triangles() {
        let mut mesh = sphere(0.4, 24);
        mesh.faces.truncate(900); // with a hole, so that the numbers are not all 0 and 1
        let tree = WindingNumbers::new(&mesh);
        for point in sample_cube(UnitCube::default(), 300, 1) {
            let (fast, slow) = (tree.at(point), slow_winding_number(&mesh, point));
            assert!((fast - slow).abs() < 0.006, "{fast} {slow} at {point}");
        }
    }

    #[test]
    fn a_sphere_holds_the_points_nearer_than_its_radius() {
        let (mesh, points) = (sphere(0.4, 40), sample_cube(UnitCube::default(), 20_000, 2));
        for (point, inside) in points.iter().zip(points_inside(&mesh, &points)) {
            let distance = point.length();
            assert!(inside == (distance < 0.4) || (0.397..0.4001).contains(&distance), "{point}");
        }
    }

    #[test]
    fn a_point_right_below_a_corner_or_an_edge_is_inside_although_the_original_says_no() {
        let mesh = sphere(0.4, 10);
        let below: Vec<Vec3> = mesh.vertices.iter().map(|v| v.with_z(0.9 * v.z)).filter(|v| v.z.abs() > 0.01).collect();
        assert!(points_inside(&mesh, &below).into_iter().all(|inside| inside));
        assert_eq!(points_inside(&mesh, &[Vec3::ZERO, Vec3::Z * 0.39, Vec3::Z * 0.41]), [true, true, false]);
    }

    #[test]
    fn a_mesh_turned_inside_out_has_the_same_inside() {
        let (mut mesh, points) = (sphere(0.3, 10), sample_cube(UnitCube::default(), 500, 3));
        let before = points_inside(&mesh, &points);
        mesh.faces.iter_mut().for_each(|face| face.reverse());
        assert_eq!(points_inside(&mesh, &points), before);
        assert!((WindingNumbers::new(&mesh).at(Vec3::ZERO) + 1.0).abs() < 0.006);
    }

    #[test]
    fn solids_that_overlap_are_united_and_a_cavity_is_outside() {
        let (outer, mut inner) = (sphere(0.4, 16), sphere(0.2, 16));
        let join = |a: &Mesh, b: &Mesh| {
            let offset = a.vertices.len() as u32;
            let mut both = a.clone();
            both.vertices.extend(&b.vertices);
            both.faces.extend(b.faces.iter().map(|face| face.map(|i| i + offset)));
            both
        };
        let points = [Vec3::ZERO, Vec3::X * 0.3, Vec3::X * 0.45];
        assert_eq!(points_inside(&join(&outer, &inner), &points), [true, true, false]);
        inner.faces.iter_mut().for_each(|face| face.reverse());
        assert_eq!(points_inside(&join(&outer, &inner), &points), [false, true, false]);
    }

    #[test]
    fn a_small_hole_does_not_spill_the_inside() {
        let mut mesh = sphere(0.4, 20);
        mesh.faces.drain(..30);
        let points = [Vec3::ZERO, Vec3::Z * 0.3, Vec3::Z * 0.5, Vec3::X * 0.39, Vec3::X * 0.41];
        assert_eq!(points_inside(&mesh, &points), [true, true, false, true, false]);
    }

    #[test]
    fn a_mesh_without_faces_or_with_broken_corners_holds_nothing() {
        assert_eq!(points_inside(&Mesh::default(), &[Vec3::ZERO]), [false]);
        let mut mesh = sphere(0.4, 4);
        mesh.vertices.iter_mut().for_each(|v| *v = Vec3::NAN);
        assert_eq!(points_inside(&mesh, &[Vec3::ZERO]), [false]);
    }

    #[test]
    fn the_bars_of_a_wire_frame_are_split_without_changing_the_winding_number() {
        // Prisms of many sides: all triangles are as long as the mesh.
        let sides = 200;
        let mut mesh = Mesh::default();
        for j in 0..sides {
            let (y, x) = (2.0 * PI * f64::from(j) / f64::from(sides)).sin_cos();
            let ring = DVec3::new(0.02 * x, 0.02 * y, 0.0);
            mesh.vertices.extend([-0.4, 0.4].map(|z| (ring + DVec3::Z * z).as_vec3()));
            let [a, b, c, d] = [2 * j, 2 * j + 1, (2 * j + 2) % (2 * sides), (2 * j + 3) % (2 * sides)];
            mesh.faces.extend([[a, c, d], [a, d, b], [400, c, a], [401, b, d]]);
        }
        mesh.vertices.extend([Vec3::NEG_Z * 0.4, Vec3::Z * 0.4]);
        let tree = WindingNumbers::new(&mesh);
        assert!(tree.triangles.len() > 10 * mesh.faces.len());
        for point in [Vec3::ZERO, Vec3::Z * 0.399, Vec3::X * 0.019, Vec3::X * 0.021, Vec3::Z * 0.401] {
            assert!((tree.at(point) - slow_winding_number(&mesh, point)).abs() < 0.006, "{point}");
        }
        assert!((tree.at(Vec3::ZERO) - 1.0).abs() < 0.006);
    }

    #[test]
    fn many_equal_triangles_make_a_finite_tree() {
        let mesh =
            Mesh { vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y], faces: vec![[0, 1, 2]; 1000], ..Mesh::default() };
        assert!(WindingNumbers::new(&mesh).at(Vec3::new(0.2, 0.2, -1.0)) > 0.5);
    }

    #[test]
    fn a_mesh_of_long_triangles_alone_does_not_become_too_many() {
        // 40 000 triangles across the whole cube: split as far as one of them is, they would be 80 million.
        let corner = |i: u32| Vec3::new((i % 7) as f32, (i % 11) as f32 / 2.0, (i % 13) as f32 / 2.0);
        let vertices: Vec<Vec3> = (0..2000).map(corner).collect();
        let faces: Vec<[u32; 3]> = (0..40_000).map(|i| [i % 2000, (7 * i + 3) % 2000, (11 * i + 5) % 2000]).collect();
        let count = faces.len();
        let numbers = WindingNumbers::new(&Mesh { vertices, faces, ..Mesh::default() });
        assert!(numbers.triangles.len() > count && numbers.triangles.len() <= MOST_PIECES);
    }
}
