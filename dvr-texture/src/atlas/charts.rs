//! Patches laid flat: each is seen along its mean normal, and cut where it would cover itself.

use std::collections::VecDeque;

use dvr_core::mesh::Mesh;
use glam::{Vec2, Vec3};

use super::adjacency::NONE;

/// Cosine to the direction it is seen along below which a face goes into another chart: it would be stretched more than
/// fourfold.
const MIN_COSINE: f32 = 0.25;

/// Directions in a quarter turn in which a chart is tried for the smallest box.
const TURNS: usize = 16;

/// A piece of surface in the plane.
#[derive(Clone, Debug, Default)]
pub(super) struct Chart {
    /// Its faces.
    pub faces: Vec<u32>,
    /// Where their corners lie, in units of the mesh; the lowest coordinates are 0.
    pub corners: Vec<[Vec2; 3]>,
    /// The highest coordinates.
    pub extent: Vec2,
}

/// The charts of a mesh whose patches are known. No two faces of a chart cover the middle of the same square of edge
/// `cell`.
pub(super) fn charts(mesh: &Mesh, neighbours: &[[u32; 3]], patches: &[u32], cell: f32) -> Vec<Chart> {
    let mut by_patch: Vec<u32> = (0..patches.len() as u32).collect();
    by_patch.sort_by_key(|&face| patches[face as usize]);
    let mut chart_of = vec![NONE; patches.len()];
    let mut grower = Grower { mesh, neighbours, patches, chart_of: &mut chart_of, charts: Vec::new(), cell };
    for faces in by_patch.chunk_by(|a, b| patches[*a as usize] == patches[*b as usize]) {
        let mut left = faces.to_vec();
        while !left.is_empty() {
            let axis = mean_normal(mesh, &left);
            let seed = best_seed(mesh, &left, axis);
            let seed_normal = mesh_normal(mesh, seed).normalize_or(Vec3::Z);
            // Leftovers may look anywhere: then the seed alone says where.
            let axis = if seed_normal.dot(axis) > MIN_COSINE { axis } else { seed_normal };
            grower.grow(seed, axis, &left);
            left.retain(|&face| grower.chart_of[face as usize] == NONE);
        }
    }
    grower.charts
}

fn mesh_normal(mesh: &Mesh, face: u32) -> Vec3 {
    let [a, b, c] = mesh.triangle(face as usize);
    (b - a).cross(c - a)
}

fn mean_normal(mesh: &Mesh, faces: &[u32]) -> Vec3 {
    faces.iter().map(|&face| mesh_normal(mesh, face)).sum::<Vec3>().normalize_or(Vec3::Z)
}

/// The face with the most area along an axis.
fn best_seed(mesh: &Mesh, faces: &[u32], axis: Vec3) -> u32 {
    let along = |face: &u32| mesh_normal(mesh, *face).dot(axis);
    faces.iter().copied().max_by(|a, b| along(a).total_cmp(&along(b))).unwrap_or(0)
}

struct Grower<'a> {
    mesh: &'a Mesh,
    neighbours: &'a [[u32; 3]],
    patches: &'a [u32],
    chart_of: &'a mut [u32],
    charts: Vec<Chart>,
    cell: f32,
}

impl Grower<'_> {
    /// Makes a chart of what can be reached from a seed within its patch without covering what is there already.
    fn grow(&mut self, seed: u32, axis: Vec3, left: &[u32]) {
        let (right, up) = axis.any_orthonormal_pair();
        let flat = |face: u32| self.mesh.triangle(face as usize).map(|p| Vec2::new(p.dot(right), p.dot(up)));
        let (low, high) = left
            .iter()
            .flat_map(|&face| flat(face))
            .fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        let mut covered = Covered::new(low, high, self.cell);
        let index = self.charts.len() as u32;
        let (mut faces, mut corners) = (Vec::new(), Vec::new());
        let mut queue = VecDeque::from([seed]);
        let patch = self.patches[seed as usize];
        while let Some(face) = queue.pop_front() {
            if self.chart_of[face as usize] != NONE {
                continue;
            }
            let normal = mesh_normal(self.mesh, face);
            let triangle = flat(face);
            let faces_along = normal.dot(axis) > MIN_COSINE * normal.length();
            // A face without area has no place of its own to cover.
            if face != seed && (!faces_along || !covered.take(triangle)) {
                continue;
            }
            if face == seed {
                covered.take(triangle);
            }
            self.chart_of[face as usize] = index;
            faces.push(face);
            corners.push(triangle);
            let around = self.neighbours[face as usize].into_iter().filter(|&other| other != NONE);
            queue.extend(
                around.filter(|&other| self.patches[other as usize] == patch && self.chart_of[other as usize] == NONE),
            );
        }
        self.charts.push(laid_straight(faces, corners));
    }
}

/// Which squares of a plane are covered.
struct Covered {
    low: Vec2,
    per_unit: f32,
    width: usize,
    height: usize,
    cells: Vec<bool>,
}

impl Covered {
    /// Squares of an edge, or larger ones where these would be too many.
    fn new(low: Vec2, high: Vec2, cell: f32) -> Self {
        const MOST: f32 = 64e6;
        let extent = high - low;
        let cell = cell.max((extent.x * extent.y / MOST).sqrt()).max(f32::MIN_POSITIVE);
        let (width, height) = ((extent.x / cell) as usize + 1, (extent.y / cell) as usize + 1);
        Self { low, per_unit: 1.0 / cell, width, height, cells: vec![false; width * height] }
    }

    /// Covers the squares whose middles are in a triangle; false, and nothing is done, where one is covered already.
    fn take(&mut self, triangle: [Vec2; 3]) -> bool {
        // A middle on an edge that two faces share belongs to neither.
        const INSIDE: f32 = 1e-4;
        let [a, b, c] = triangle.map(|p| (p - self.low) * self.per_unit);
        let area = (b - a).perp_dot(c - a);
        let range = |x: f32, y: f32, z: f32, count: usize| {
            let first = (x.min(y).min(z) - 0.5).ceil().max(0.0) as usize;
            first..((x.max(y).max(z) + 0.5).max(0.0) as usize).min(count)
        };
        let mut taken = Vec::new();
        for v in range(a.y, b.y, c.y, self.height) {
            for u in range(a.x, b.x, c.x, self.width) {
                let p = Vec2::new(u as f32 + 0.5, v as f32 + 0.5);
                let side = |from: Vec2, to: Vec2| (to - from).perp_dot(p - from) / area;
                if side(a, b) > INSIDE && side(b, c) > INSIDE && side(c, a) > INSIDE {
                    if self.cells[v * self.width + u] {
                        return false;
                    }
                    taken.push(v * self.width + u);
                }
            }
        }
        taken.into_iter().for_each(|cell| self.cells[cell] = true);
        true
    }
}

/// A chart turned so that its box is small and lies.
fn laid_straight(faces: Vec<u32>, corners: Vec<[Vec2; 3]>) -> Chart {
    let turned = |turn: usize| Vec2::from_angle(std::f32::consts::FRAC_PI_2 * turn as f32 / TURNS as f32);
    let bounds = |rotation: Vec2| {
        let places = corners.iter().flatten().map(|&p| rotation.rotate(p));
        places.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
    };
    let area = |turn: &usize| {
        let (low, high) = bounds(turned(*turn));
        (high - low).element_product()
    };
    let turn = (0..TURNS).min_by(|a, b| area(a).total_cmp(&area(b))).unwrap_or(0);
    let (low, high) = bounds(turned(turn));
    let rotation = if high.y - low.y > high.x - low.x { turned(turn).rotate(Vec2::Y) } else { turned(turn) };
    let (low, high) = bounds(rotation);
    let corners = corners.iter().map(|face| face.map(|p| rotation.rotate(p) - low)).collect();
    Chart { faces, corners, extent: high - low }
}
