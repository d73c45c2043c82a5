//! A mesh whose edges are split, collapsed and flipped.

use std::collections::HashSet;

use glam::Vec3;

use crate::mesh::triangle_mesh::Mesh;

/// Cosine of the angle from which on two faces meet in an edge that is kept: 40 degrees.
const CREASE: f32 = 0.766;

/// Cosine of the angle by which the normal of a face may turn while vertices or edges around it change.
const MAX_TURN: f32 = 0.5;

/// How often all short edges are looked at before others are flipped.
const PASSES: usize = 8;

/// Of faces and vertices that are gone.
const GONE: u32 = u32::MAX;

/// The normal of a triangle, twice as long as its area is large.
pub(super) fn normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a)
}

/// Vertices, faces, and which faces each vertex has. Faces that are gone have [`GONE`] for corners, vertices that are gone no
/// faces.
pub(super) struct DynamicMesh {
    positions: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
    /// The faces around each vertex, in no order that means something.
    around: Vec<Vec<u32>>,
    /// Edges where the surface turned before anything was changed, the smaller vertex first. (Fewer, larger faces turn more,
    /// and mean nothing by it.)
    creases: HashSet<(u32, u32)>,
}

/// An edge, the smaller vertex first.
fn edge(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

/// What may happen to a vertex.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// It lies within a smooth part.
    Free,
    /// It lies along one edge that is kept.
    OnCrease,
    /// Edges that are kept meet, end or turn there.
    Fixed,
}

impl DynamicMesh {
    pub fn new(mesh: &Mesh) -> Self {
        let mut around = vec![Vec::new(); mesh.vertices.len()];
        let is_face = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
        let faces: Vec<[u32; 3]> = mesh.faces.iter().copied().filter(is_face).collect();
        for (face, corners) in (0..).zip(&faces) {
            corners.iter().for_each(|&corner| around[corner as usize].push(face));
        }
        let mut dynamic = Self { positions: mesh.vertices.clone(), faces, around, creases: HashSet::new() };
        dynamic.creases = dynamic.edges().into_iter().filter(|&(a, b)| dynamic.turns(a, b)).collect();
        dynamic
    }

    /// How many vertices there are, with those that are gone.
    pub fn vertices(&self) -> usize {
        self.positions.len()
    }

    /// Vertices and faces that are left.
    pub fn finished(self) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let mut numbers = vec![GONE; self.positions.len()];
        let mut vertices = Vec::new();
        for (vertex, _) in self.around.iter().enumerate().filter(|(_, faces)| !faces.is_empty()) {
            numbers[vertex] = vertices.len() as u32;
            vertices.push(self.positions[vertex]);
        }
        let left = self.faces.into_iter().filter(|face| face[0] != GONE);
        (vertices, left.map(|face| face.map(|vertex| numbers[vertex as usize])).collect())
    }

    fn corners(&self, face: u32) -> [Vec3; 3] {
        self.faces[face as usize].map(|vertex| self.positions[vertex as usize])
    }

    /// All edges, each once, the smaller vertex first.
    fn edges(&self) -> Vec<(u32, u32)> {
        let left = self.faces.iter().filter(|face| face[0] != GONE);
        let mut edges: Vec<(u32, u32)> =
            left.flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).map(|(a, b)| edge(a, b)).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// The faces that have both vertices.
    fn faces_at(&self, a: u32, b: u32) -> Vec<u32> {
        let around = &self.around[a as usize];
        around.iter().copied().filter(|&face| self.faces[face as usize].contains(&b)).collect()
    }

    /// The vertices that edges connect to one, rising.
    fn neighbours(&self, vertex: u32) -> Vec<u32> {
        let around = &self.around[vertex as usize];
        let mut found: Vec<u32> = around.iter().flat_map(|&face| self.faces[face as usize]).collect();
        found.retain(|&other| other != vertex);
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Whether the surface turns at an edge.
    fn turns(&self, a: u32, b: u32) -> bool {
        let [one, other] = self.faces_at(a, b)[..] else { return false };
        let normals = [one, other].map(|face| normal(self.corners(face)).normalize_or_zero());
        normals[0].dot(normals[1]) < CREASE
    }

    /// Whether an edge is kept: a border, where more than two sheets meet, and where the surface turned.
    fn is_kept(&self, a: u32, b: u32) -> bool {
        self.creases.contains(&edge(a, b)) || self.faces_at(a, b).len() != 2
    }

    fn kind(&self, vertex: u32) -> Kind {
        let neighbours = self.neighbours(vertex);
        let creases: Vec<u32> = neighbours.iter().copied().filter(|&other| self.is_kept(vertex, other)).collect();
        // A disk, or a half of one at a border.
        let is_disk = neighbours.len() <= self.around[vertex as usize].len() + usize::from(creases.len() == 2);
        match creases[..] {
            [] if is_disk => Kind::Free,
            [a, b] if is_disk && self.goes_on(vertex, a, b) => Kind::OnCrease,
            _ => Kind::Fixed,
        }
    }

    /// Whether the edges to two neighbours are about one line, and no corner.
    fn goes_on(&self, vertex: u32, a: u32, b: u32) -> bool {
        let place = self.positions[vertex as usize];
        let [a, b] = [a, b].map(|other| (self.positions[other as usize] - place).normalize_or_zero());
        a.dot(b) < -CREASE
    }

    /// Halves edges above this length.
    pub fn split(&mut self, long: f32) {
        for (a, b) in self.edges() {
            let [from, to] = [a, b].map(|vertex| self.positions[vertex as usize]);
            if from.distance(to) > long {
                self.halve(a, b);
            }
        }
    }

    fn halve(&mut self, a: u32, b: u32) {
        let middle = self.positions.len() as u32;
        self.positions.push((self.positions[a as usize] + self.positions[b as usize]) / 2.0);
        self.around.push(Vec::new());
        if self.creases.remove(&edge(a, b)) {
            self.creases.extend([edge(a, middle), edge(middle, b)]);
        }
        for face in self.faces_at(a, b) {
            let corners = self.faces[face as usize];
            let with =
                |vertex: u32, instead: u32| corners.map(|corner| if corner == vertex { instead } else { corner });
            let added = self.faces.len() as u32;
            self.faces[face as usize] = with(b, middle);
            self.faces.push(with(a, middle));
            self.around[b as usize].retain(|&other| other != face);
            for corner in with(a, middle) {
                self.around[corner as usize].push(added);
            }
            self.around[middle as usize].push(face);
        }
    }

    /// Collapses edges below this length where that keeps the surface and makes no edge longer than `long` that was not.
    ///
    /// The shortest come first, and no vertex takes part twice before all others could: else one would be dragged along a
    /// row of its neighbours.
    pub fn collapse(&mut self, short: f32, long: f32) {
        for _ in 0..PASSES {
            let length = |&(a, b): &(u32, u32)| self.positions[a as usize].distance(self.positions[b as usize]);
            let edges = self.edges().into_iter().map(|edge| (length(&edge), edge));
            let mut edges: Vec<(f32, (u32, u32))> = edges.filter(|(length, _)| *length < short).collect();
            edges.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            let mut took_part = vec![false; self.positions.len()];
            let mut is_done = true;
            for (_, (a, b)) in edges {
                if !took_part[a as usize] && !took_part[b as usize] && self.contract(a, b, long) {
                    took_part[a as usize] = true;
                    took_part[b as usize] = true;
                    is_done = false;
                }
            }
            if is_done {
                break;
            }
        }
    }

    /// Makes the two vertices of an edge one; whether that was possible.
    fn contract(&mut self, a: u32, b: u32, long: f32) -> bool {
        let shared = self.faces_at(a, b);
        if !matches!(shared.len(), 1 | 2) {
            return false;
        }
        let kinds = [a, b].map(|vertex| self.kind(vertex));
        let is_kept = self.is_kept(a, b);
        let [from, to] = [a, b].map(|vertex| self.positions[vertex as usize]);
        // What is gone, what is left, and where.
        let (gone, left, place) = match kinds {
            [Kind::Free, Kind::Free] => (a, b, (from + to) / 2.0),
            [Kind::Free, _] => (a, b, to),
            [_, Kind::Free] => (b, a, from),
            [Kind::OnCrease, _] if is_kept => (a, b, to),
            [_, Kind::OnCrease] if is_kept => (b, a, from),
            _ => return false,
        };
        // The link condition (Dey et al. 1999): what both have for neighbours are the corners across.
        let (ours, theirs) = (self.neighbours(gone), self.neighbours(left));
        let common: Vec<u32> = ours.iter().copied().filter(|other| theirs.binary_search(other).is_ok()).collect();
        if common.len() != shared.len() || common.iter().any(|&other| self.around[other as usize].len() <= 3) {
            return false;
        }
        // What was long before may stay so: else needles could not become anything.
        let lengthens = |vertex: u32, neighbours: &[u32]| {
            let others = neighbours.iter().filter(|&&other| other != gone && other != left);
            let mut others = others.map(|&other| self.positions[other as usize]);
            others.any(|other| other.distance(place) > long.max(other.distance(self.positions[vertex as usize])))
        };
        if lengthens(gone, &ours) || lengthens(left, &theirs) {
            return false;
        }
        let turns = |vertex: u32| {
            let around = self.around[vertex as usize].iter().filter(|face| !shared.contains(face));
            around.into_iter().any(|&face| !self.keeps(face, vertex, place))
        };
        if turns(gone) || turns(left) {
            return false;
        }
        self.positions[left as usize] = place;
        for other in ours {
            if self.creases.remove(&edge(gone, other)) && other != left {
                self.creases.insert(edge(left, other));
            }
        }
        for face in std::mem::take(&mut self.around[gone as usize]) {
            let corners = self.faces[face as usize];
            if shared.contains(&face) {
                self.faces[face as usize] = [GONE; 3];
                for corner in corners.into_iter().filter(|&corner| corner != gone) {
                    self.around[corner as usize].retain(|&other| other != face);
                }
            } else {
                self.faces[face as usize] = corners.map(|corner| if corner == gone { left } else { corner });
                self.around[left as usize].push(face);
            }
        }
        true
    }

    /// Whether a face looks the same way when one of its vertices is elsewhere.
    fn keeps(&self, face: u32, vertex: u32, place: Vec3) -> bool {
        let corners = self.faces[face as usize];
        let moved = corners.map(|corner| if corner == vertex { place } else { self.positions[corner as usize] });
        let (before, after) = (normal(self.corners(face)), normal(moved));
        let is_face = after.length_squared() > f32::MIN_POSITIVE;
        is_face && (before == Vec3::ZERO || before.normalize_or_zero().dot(after.normalize_or_zero()) > MAX_TURN)
    }

    /// Flips edges where valences are then nearer to six, four along borders.
    pub fn flip(&mut self) {
        for (a, b) in self.edges() {
            let [one, other] = self.faces_at(a, b)[..] else { continue };
            if self.is_kept(a, b) {
                continue;
            }
            // `one` is the face in which b follows a.
            let follows = |face: u32| (0..3).any(|k| [0, 1].map(|i| self.faces[face as usize][(k + i) % 3]) == [a, b]);
            let (one, other) = if follows(one) { (one, other) } else { (other, one) };
            let across = |face: u32| self.faces[face as usize].into_iter().find(|&corner| corner != a && corner != b);
            let (Some(c), Some(d)) = (across(one), across(other)) else { continue };
            if c == d || follows(one) == follows(other) || !self.faces_at(c, d).is_empty() {
                continue;
            }
            let off = |vertex: u32, change: i64| {
                let (faces, neighbours) = (self.around[vertex as usize].len(), self.neighbours(vertex).len());
                let ideal = if neighbours > faces { 4 } else { 6 };
                (neighbours as i64 + change - ideal).abs()
            };
            let before: i64 = [a, b, c, d].map(|vertex| off(vertex, 0)).iter().sum();
            let after: i64 =
                [(a, -1), (b, -1), (c, 1), (d, 1)].map(|(vertex, change)| off(vertex, change)).iter().sum();
            if after >= before {
                continue;
            }
            let flipped = [[a, d, c], [d, b, c]];
            let normal_of =
                |corners: [u32; 3]| normal(corners.map(|vertex| self.positions[vertex as usize])).normalize_or_zero();
            let old = [one, other].map(|face| normal_of(self.faces[face as usize]));
            if flipped.iter().any(|&face| old.iter().any(|old| normal_of(face).dot(*old) < CREASE)) {
                continue;
            }
            for (face, corners) in [one, other].into_iter().zip(flipped) {
                self.faces[face as usize] = corners;
            }
            self.around[a as usize].retain(|&face| face != other);
            self.around[b as usize].retain(|&face| face != one);
            self.around[c as usize].push(other);
            self.around[d as usize].push(one);
        }
    }

    /// The middle of a vertex' neighbours, in the plane through it; `None` where it stays.
    pub fn relaxed(&self, vertex: u32) -> Option<Vec3> {
        let around = &self.around[vertex as usize];
        if around.is_empty() || self.kind(vertex) != Kind::Free {
            return None;
        }
        let neighbours = self.neighbours(vertex);
        let sum: Vec3 = neighbours.iter().map(|&other| self.positions[other as usize]).sum();
        let (middle, place) = (sum / neighbours.len() as f32, self.positions[vertex as usize]);
        let up = around.iter().map(|&face| normal(self.corners(face))).sum::<Vec3>().normalize_or_zero();
        Some(middle + up * up.dot(place - middle))
    }

    /// Moves a vertex, unless a face around it would turn over.
    pub fn move_to(&mut self, vertex: u32, place: Vec3) {
        if self.around[vertex as usize].iter().all(|&face| self.keeps(face, vertex, place)) {
            self.positions[vertex as usize] = place;
        }
    }
}
