//! Which piece of surface each texel of an atlas shows.

use dvr_core::mesh::Mesh;
use glam::{Vec2, Vec3};

use crate::atlas::Atlas;

/// No face reaches a texel.
pub(crate) const FREE: u32 = u32::MAX;

/// How far a texel beyond the rim of its face may lie on the face's plane, in barycentric coordinates.
const BEYOND: f32 = 1.0;

/// The face of each texel: of those whose middles charts cover, and of a rim of one texel around the charts, which
/// bilinear interpolation reaches into.
#[derive(Debug)]
pub(crate) struct Texels {
    pub size: u32,
    /// `face[v * size + u]`, [`FREE`] where there is none.
    pub face: Vec<u32>,
}

impl Texels {
    pub fn draw(atlas: &Atlas) -> Self {
        Self::of_corners(atlas.size, &atlas.corners)
    }

    /// The same of faces whose corners lie at these texels.
    pub fn of_corners(size: u32, corners: &[[Vec2; 3]]) -> Self {
        let faces = corners.iter().enumerate().map(|(face, corners)| (face as u32, *corners));
        let mut texels = Self { size, face: Self::of_faces(size, faces) };
        texels.grow();
        texels
    }

    /// The texels whose middles faces cover, the first of them where there are several.
    pub fn of_faces(size: u32, faces: impl IntoIterator<Item = (u32, [Vec2; 3])>) -> Vec<u32> {
        let mut texels = vec![FREE; size as usize * size as usize];
        faces.into_iter().for_each(|(face, corners)| draw_face(&mut texels, size, face, corners));
        texels
    }

    /// Gives free texels beside covered ones the face of a neighbour: one across an edge before one across a corner.
    fn grow(&mut self) {
        let size = i64::from(self.size);
        let before = &self.face;
        let neighbour = |u: i64, v: i64| {
            let offsets = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)];
            let at = offsets.iter().map(|(du, dv)| (u + du, v + dv));
            at.filter(|&(u, v)| u >= 0 && v >= 0 && u < size && v < size)
                .map(|(u, v)| before[(v * size + u) as usize])
                .find(|&face| face != FREE)
        };
        let rim: Vec<(usize, u32)> = (before.iter().enumerate().filter(|(_, face)| **face == FREE))
            .filter_map(|(i, _)| Some((i, neighbour(i as i64 % size, i as i64 / size)?)))
            .collect();
        rim.into_iter().for_each(|(i, face)| self.face[i] = face);
    }
}

/// Covers the texels whose middles lie in a triangle and that no face has yet.
fn draw_face(texels: &mut [u32], size: u32, face: u32, [a, b, c]: [Vec2; 3]) {
    let area = (b - a).perp_dot(c - a);
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let range = |low: f32, high: f32| {
        let first = (low - 0.5).ceil().max(0.0) as u32;
        let end = ((high - 0.5).floor() + 1.0).clamp(0.0, size as f32) as u32;
        first..end
    };
    for v in range(low.y, high.y) {
        for u in range(low.x, high.x) {
            let p = Vec2::new(u as f32 + 0.5, v as f32 + 0.5);
            let side = |from: Vec2, to: Vec2| (to - from).perp_dot(p - from) / area;
            if side(a, b) >= 0.0 && side(b, c) >= 0.0 && side(c, a) >= 0.0 {
                let texel = &mut texels[v as usize * size as usize + u as usize];
                if *texel == FREE {
                    *texel = face;
                }
            }
        }
    }
}

/// Barycentric coordinates of the middle of texel `(u, v)` in its face, bounded where it lies beyond.
pub(crate) fn barycentric(corners: [Vec2; 3], (u, v): (u32, u32)) -> [f32; 3] {
    let [a, b, c] = corners;
    let p = Vec2::new(u as f32 + 0.5, v as f32 + 0.5);
    let area = (b - a).perp_dot(c - a);
    let clamped = |weight: f32| if weight.is_finite() { weight.clamp(-BEYOND, 1.0 + BEYOND) } else { 1.0 / 3.0 };
    let beta = clamped((p - a).perp_dot(c - a) / area);
    let gamma = clamped((b - a).perp_dot(p - a) / area);
    [1.0 - beta - gamma, beta, gamma]
}

/// A value between, or beyond, those of a face's corners.
pub(crate) fn blend(values: [Vec3; 3], weights: [f32; 3]) -> Vec3 {
    values[0] * weights[0] + values[1] * weights[1] + values[2] * weights[2]
}

/// The corners of a face of a mesh, and their normals.
pub(crate) fn corners(mesh: &Mesh, normals: &[Vec3], face: u32) -> ([Vec3; 3], [Vec3; 3]) {
    let indices = mesh.faces[face as usize];
    (indices.map(|i| mesh.vertices[i as usize]), indices.map(|i| normals[i as usize]))
}
