//! Shapes made by formula, closed and wound outwards: ground truth for tests, and building blocks.

use std::collections::HashMap;
use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::triangle_mesh::Mesh;

/// A sphere around the origin: an icosahedron, each face split into four `subdivisions` times.
///
/// 20 * 4^n faces, all corners on the sphere, with exact normals.
pub fn icosphere(subdivisions: u32, radius: f32) -> Mesh {
    let golden = 0.5 * (1.0 + 5f32.sqrt());
    let corners = |a: f32, b: f32| [Vec3::new(0.0, a, b), Vec3::new(a, b, 0.0), Vec3::new(b, 0.0, a)];
    let mut normals: Vec<Vec3> = [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)]
        .iter()
        .flat_map(|&(a, b)| corners(a, b))
        .collect();
    let edge = 2.0 * 1.001;
    let adjacent = |a: usize, b: usize, n: &[Vec3]| n[a].distance(n[b]) < edge;
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if adjacent(a, b, &normals) && adjacent(b, c, &normals) && adjacent(a, c, &normals) {
                    let outward = (normals[b] - normals[a]).cross(normals[c] - normals[a]).dot(normals[a]) > 0.0;
                    faces.push(if outward { [a as u32, b as u32, c as u32] } else { [a as u32, c as u32, b as u32] });
                }
            }
        }
    }
    normals.iter_mut().for_each(|n| *n = n.normalize());
    for _ in 0..subdivisions {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut finer = Vec::with_capacity(4 * faces.len());
        for [a, b, c] in faces {
            let mut middle = |i: u32, j: u32| {
                *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    normals.push((normals[i as usize] + normals[j as usize]).normalize());
                    (normals.len() - 1) as u32
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = finer;
    }
    let vertices = normals.iter().map(|&n| radius * n).collect();
    Mesh { vertices, faces, normals: Some(normals), ..Mesh::default() }
}

/// An axis-parallel box of 8 vertices and 12 faces, without normals (its edges are hard).
pub fn cuboid(low: Vec3, high: Vec3) -> Mesh {
    let corner = |i: u32| Vec3::new(pick(i & 1, low.x, high.x), pick(i & 2, low.y, high.y), pick(i & 4, low.z, high.z));
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let faces = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    Mesh { vertices: (0..8).map(corner).collect(), faces, ..Mesh::default() }
}

fn pick(bit: u32, low: f32, high: f32) -> f32 {
    if bit == 0 { low } else { high }
}

/// A torus around the y axis: `ring` is the radius of the circle that the tube of radius `tube` follows.
///
/// `around` and `across` are how many corners the ring and the tube have, three or more each.
pub fn torus(ring: f32, tube: f32, around: u32, across: u32) -> Mesh {
    let frames: Vec<Frame> = (0..around)
        .map(|i| {
            let (sin, cos) = (TAU * i as f32 / around as f32).sin_cos();
            let out = Vec3::new(cos, 0.0, sin);
            Frame { center: ring * out, x: out, y: Vec3::Y }
        })
        .collect();
    let circle: Vec<Vec2> = (0..across).map(|i| tube * Vec2::from_angle(TAU * i as f32 / across as f32)).collect();
    loft(&frames, &circle, true)
}

/// A cross-section's place: its centre and its two axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Where the outline's origin goes.
    pub center: Vec3,
    /// Where the outline's first axis goes; its length scales.
    pub x: Vec3,
    /// Where the outline's second axis goes; its length scales.
    pub y: Vec3,
}

/// The surface that an outline sweeps out along a row of frames: tubes, bars, horns.
///
/// The outline runs counter-clockwise; `x.cross(y)` of a frame points the way the sweep goes. A `closed` sweep ends
/// where it began; an open one gets flat lids, fans around the outline's centre, so the outline must be star-shaped
/// from there. Vertices are the outlines one after the other; normals are averaged over the faces of the mantle.
pub fn loft(frames: &[Frame], outline: &[Vec2], closed: bool) -> Mesh {
    let place = |frame: &Frame, p: Vec2| frame.center + p.x * frame.x + p.y * frame.y;
    let mut vertices: Vec<Vec3> = frames.iter().flat_map(|f| outline.iter().map(|&p| place(f, p))).collect();
    let (rows, columns) = (frames.len(), outline.len());
    let at = |row: usize, column: usize| ((row % rows) * columns + column % columns) as u32;
    let mut faces = Vec::new();
    for row in 0..if closed { rows } else { rows.saturating_sub(1) } {
        for column in 0..columns {
            let [a, b] = [at(row, column), at(row, column + 1)];
            let [c, d] = [at(row + 1, column + 1), at(row + 1, column)];
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut normals = vertex_normals(&vertices, &faces);
    if !closed && rows > 1 {
        for (row, frame) in [(0, &frames[0]), (rows - 1, &frames[rows - 1])] {
            // Lids have vertices of their own, so that the edge around them stays sharp.
            let base = vertices.len() as u32;
            let normal = frame.x.cross(frame.y).normalize_or_zero() * if row == 0 { -1.0 } else { 1.0 };
            vertices.push(frame.center);
            vertices.extend(outline.iter().map(|&p| place(frame, p)));
            normals.extend(std::iter::repeat_n(normal, columns + 1));
            for column in 0..columns as u32 {
                let (a, b) = (base + 1 + column, base + 1 + (column + 1) % columns as u32);
                faces.push(if row == 0 { [base, b, a] } else { [base, a, b] });
            }
        }
    }
    Mesh { vertices, faces, normals: Some(normals), ..Mesh::default() }
}

/// A surface of revolution around the y axis: the profile `(radius, y)` runs from the lower pole over the outside to
/// the upper one (or back inside: a cup). Points of radius 0 lie on the axis; the first and last should.
///
/// `around` is how many corners a circle has. Normals are averaged over neighbouring faces.
pub fn revolve(profile: &[Vec2], around: u32) -> Mesh {
    let columns = around as usize;
    let circle: Vec<Vec2> = (0..columns).map(|i| Vec2::from_angle(TAU * i as f32 / around as f32)).collect();
    let mut vertices = Vec::new();
    // A point on the axis is one vertex, any other a circle of them.
    let rows: Vec<(u32, bool)> = profile
        .iter()
        .map(|p| {
            let start = vertices.len() as u32;
            let on_axis = p.x == 0.0;
            let ring = if on_axis { &circle[..1] } else { &circle[..] };
            vertices.extend(ring.iter().map(|c| Vec3::new(p.x * c.x, p.y, p.x * c.y)));
            (start, on_axis)
        })
        .collect();
    let at = |(start, on_axis): (u32, bool), i: usize| if on_axis { start } else { start + (i % columns) as u32 };
    let mut faces = Vec::new();
    for pair in rows.windows(2) {
        for i in 0..columns {
            let [a, b, c, d] = [at(pair[0], i), at(pair[0], i + 1), at(pair[1], i + 1), at(pair[1], i)];
            faces.extend([[a, c, b], [a, d, c]].into_iter().filter(|f| f[0] != f[1] && f[1] != f[2] && f[2] != f[0]));
        }
    }
    let normals = vertex_normals(&vertices, &faces);
    Mesh { vertices, faces, normals: Some(normals), ..Mesh::default() }
}

/// The edges of a cube of the given edge length as square rods, each a closed box: parts overlap at the corners.
pub fn wire_cube(edge: f32, half_width: f32) -> Mesh {
    let half = 0.5 * edge;
    let rods = (0..3).flat_map(|axis| {
        [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(s, t)| {
            let mut center = Vec3::ZERO;
            center[(axis + 1) % 3] = s * half;
            center[(axis + 2) % 3] = t * half;
            let mut extent = Vec3::splat(half_width);
            extent[axis] += half;
            cuboid(center - extent, center + extent)
        })
    });
    union(rods)
}

/// Two flat boxes that cross at a right angle along the y axis.
pub fn crossed_plates(edge: f32, thickness: f32) -> Mesh {
    let plate = |extent: Vec3| cuboid(-0.5 * extent, 0.5 * extent);
    union([plate(Vec3::new(edge, edge, thickness)), plate(Vec3::new(thickness, edge, edge))])
}

/// All parts in one mesh; where closed parts overlap, points inside have a winding number above one.
///
/// Normals and colours are kept where every part has them.
pub fn union(parts: impl IntoIterator<Item = Mesh>) -> Mesh {
    let mut all = Mesh { normals: Some(Vec::new()), colors: Some(Vec::new()), ..Mesh::default() };
    for part in parts {
        let base = all.vertices.len() as u32;
        all.vertices.extend(part.vertices);
        all.faces.extend(part.faces.iter().map(|face| face.map(|i| base + i)));
        all.normals = all.normals.zip(part.normals).map(|(a, b)| [a, b].concat());
        all.colors = all.colors.zip(part.colors).map(|(a, b)| [a, b].concat());
    }
    all
}

/// Normals of the vertices, averaged over their faces by area; zero where a vertex has no face.
pub fn vertex_normals(vertices: &[Vec3], faces: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; vertices.len()];
    for face in faces {
        let [a, b, c] = face.map(|i| vertices[i as usize]);
        let area = (b - a).cross(c - a);
        face.iter().for_each(|&i| normals[i as usize] += area);
    }
    normals.into_iter().map(Vec3::normalize_or_zero).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Signed volume by the divergence theorem: positive for a surface that is wound outwards.
    fn volume(mesh: &Mesh) -> f32 {
        (0..mesh.faces.len()).map(|f| mesh.triangle(f)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    /// Every directed edge has its opposite: the surface is closed. Vertices count as one where they coincide.
    fn is_closed(mesh: &Mesh) -> bool {
        let key = |v: Vec3| v.to_array().map(|x| (x * 1e5).round() as i32);
        let mut balance: HashMap<_, i32> = HashMap::new();
        for f in 0..mesh.faces.len() {
            let [a, b, c] = mesh.triangle(f).map(key);
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *balance.entry((from.min(to), from.max(to))).or_default() += if from < to { 1 } else { -1 };
            }
        }
        balance.values().all(|&b| b == 0)
    }

    #[test]
    fn shapes_are_closed_and_have_their_volume() {
        let pi = std::f32::consts::PI;
        let square = [Vec2::new(1.0, 0.0), Vec2::new(0.0, 1.0), Vec2::new(-1.0, 0.0), Vec2::new(0.0, -1.0)];
        let frame = |z: f32| Frame { center: Vec3::Z * z, x: Vec3::X, y: Vec3::Y };
        let half_circle: Vec<Vec2> = (0..=64)
            .map(|i| {
                let angle = pi * i as f32 / 64.0;
                Vec2::new(if i % 64 == 0 { 0.0 } else { angle.sin() }, -angle.cos())
            })
            .collect();
        let shapes = [
            (icosphere(4, 0.5), pi / 6.0),
            (cuboid(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0)), 6.0),
            (torus(0.6, 0.2, 96, 48), 2.0 * pi * pi * 0.6 * 0.04),
            (loft(&[frame(-0.5), frame(0.5)], &square, false), 2.0),
            (revolve(&half_circle, 96), 4.0 / 3.0 * pi),
            (wire_cube(1.0, 0.05), 12.0 * 1.1 * 0.01),
            (crossed_plates(1.0, 0.1), 0.2),
        ];
        for (i, (mesh, expected)) in shapes.iter().enumerate() {
            assert!(is_closed(mesh), "shape {i}");
            assert!((volume(mesh) / expected - 1.0).abs() < 0.01, "shape {i}: {} {expected}", volume(mesh));
        }
    }

    #[test]
    fn normals_point_outwards() {
        for mesh in [icosphere(2, 0.5), torus(0.6, 0.2, 48, 24)] {
            let normals = mesh.normals.as_ref().unwrap();
            for (f, face) in mesh.faces.iter().enumerate() {
                let [a, b, c] = mesh.triangle(f);
                let outward = (b - a).cross(c - a).normalize();
                assert!(face.iter().all(|&i| normals[i as usize].dot(outward) > 0.9));
            }
        }
    }
}
