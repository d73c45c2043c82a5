//! Every edge shared by two faces again, where collapsing edges has made a surface touch itself.
//!
//! meshoptimizer does not ask whether a collapse keeps the surface a manifold (the link condition of Dey, Edelsbrunner,
//! Guha and Nekhayev, 1999). What comes of that is rare and has two forms: two faces back to back, a sheet without
//! thickness, and several sheets along one edge. The first cancel out, the second are cut apart along the edge, as
//! Guéziec, Taubin, Lazarus and Horn (*Cutting and stitching*, 2001) do: places stay, vertices become several.

use std::collections::HashMap;

use glam::Vec3;

use super::triangle_mesh::Mesh;

/// Other faces over the vertices of a mesh, without pairs that lie back to back, and with vertices of their own where
/// sheets meet along an edge or in a point. Each edge then belongs to at most two faces, which run along it in opposite
/// directions; what enclosed a volume still does. Vertices that no face uses are dropped.
///
/// Sheets that touch in an edge and are one around both of its ends cannot be told apart by their vertices: such edges
/// are halved, which makes two faces more each.
pub(super) fn separated(mesh: &Mesh, faces: &[[u32; 3]]) -> Mesh {
    let mut separate = cut_apart(mesh, &without_pairs(faces));
    loop {
        let shared = shared_edges(&separate);
        if shared.is_empty() {
            return separate;
        }
        halve(&mut separate, &shared);
    }
}

/// The faces with one vertex for all corners that sides connect.
fn cut_apart(mesh: &Mesh, faces: &[[u32; 3]]) -> Mesh {
    let mut corners = Corners::new(faces.len());
    for (side, twin) in twins(faces, &mesh.vertices) {
        // The side's beginning is its twin's end.
        corners.unite(side.corner(), twin.next().corner());
        corners.unite(side.next().corner(), twin.corner());
    }
    let mut numbers = vec![u32::MAX; 3 * faces.len()];
    let mut sources = Vec::new();
    let faces = (faces.iter().enumerate())
        .map(|(face, vertices)| {
            [0, 1, 2].map(|k| {
                let number = &mut numbers[corners.root(3 * face + k)];
                if *number == u32::MAX {
                    *number = sources.len() as u32;
                    sources.push(vertices[k] as usize);
                }
                *number
            })
        })
        .collect();
    mesh.with_vertices(&sources, faces)
}

/// Pairs of sides between vertices that other sides connect too; of several pairs, all but the first.
fn shared_edges(mesh: &Mesh) -> Vec<(Side, Side)> {
    let edge = |side: Side| {
        let face = mesh.faces[side.face as usize];
        let (a, b) = (face[side.from as usize], face[side.next().from as usize]);
        (a.min(b), a.max(b))
    };
    let mut uses: HashMap<(u32, u32), usize> = HashMap::with_capacity(2 * mesh.faces.len());
    for face in 0..mesh.faces.len() as u32 {
        (0..3).for_each(|from| *uses.entry(edge(Side { face, from })).or_default() += 1);
    }
    let is_shared = |pair: &(Side, Side)| {
        // As each pair is taken away, its two sides no longer count.
        let left = uses.entry(edge(pair.0)).or_default();
        let is_shared = *left > 2;
        *left -= if is_shared { 2 } else { 0 };
        is_shared
    };
    twins(&mesh.faces, &mesh.vertices).into_iter().filter(is_shared).collect()
}

/// Halves edges, each of two faces, with a vertex in the middle that only these have. Of a face that several would halve,
/// one is.
fn halve(mesh: &mut Mesh, edges: &[(Side, Side)]) {
    let mut is_halved = vec![false; mesh.faces.len()];
    for &(side, twin) in edges {
        if is_halved[side.face as usize] || is_halved[twin.face as usize] {
            continue;
        }
        let face = mesh.faces[side.face as usize];
        let middle = mesh.push_middle(face[side.from as usize], face[side.next().from as usize]);
        for Side { face, from } in [side, twin] {
            is_halved[face as usize] = true;
            let from = from as usize;
            let mut half = mesh.faces[face as usize];
            mesh.faces[face as usize][(from + 1) % 3] = middle;
            half[from] = middle;
            mesh.faces.push(half);
        }
    }
}

/// Faces without those that have the same corners as another one and wind the other way; each cancels one.
fn without_pairs(faces: &[[u32; 3]]) -> Vec<[u32; 3]> {
    // By corners, with the smallest first: the order of the others says how a face winds.
    let mut ordered: Vec<([u32; 3], bool, u32)> = (faces.iter().enumerate())
        .map(|(face, &[a, b, c])| {
            let [a, b, c] = if a < b && a < c {
                [a, b, c]
            } else if b < c {
                [b, c, a]
            } else {
                [c, a, b]
            };
            ([a, b.min(c), b.max(c)], b < c, face as u32)
        })
        .collect();
    ordered.sort_unstable();
    let mut stays = vec![true; faces.len()];
    for alike in ordered.chunk_by(|a, b| a.0 == b.0) {
        let (one_way, other) = alike.split_at(alike.partition_point(|(_, winds, _)| !winds));
        for ((.., a), (.., b)) in one_way.iter().zip(other) {
            stays[*a as usize] = false;
            stays[*b as usize] = false;
        }
    }
    faces.iter().zip(stays).filter(|(_, stays)| *stays).map(|(face, _)| *face).collect()
}

/// A side of a face, from one corner to the next.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    face: u32,
    from: u32,
}

impl Side {
    fn next(self) -> Self {
        Self { from: (self.from + 1) % 3, ..self }
    }

    fn corner(self) -> usize {
        3 * self.face as usize + self.from as usize
    }
}

/// Pairs of sides that run along one edge in opposite directions. Where more than two do, each is paired with the one on
/// the other side of the solid between them.
fn twins(faces: &[[u32; 3]], vertices: &[Vec3]) -> Vec<(Side, Side)> {
    let mut sides: Vec<((u32, u32), bool, Side)> = Vec::with_capacity(3 * faces.len());
    for (face, corners) in faces.iter().enumerate() {
        for from in 0..3 {
            let (a, b) = (corners[from], corners[(from + 1) % 3]);
            sides.push(((a.min(b), a.max(b)), a < b, Side { face: face as u32, from: from as u32 }));
        }
    }
    sides.sort_unstable();
    let mut twins = Vec::with_capacity(sides.len() / 2);
    for around in sides.chunk_by(|a, b| a.0 == b.0) {
        let (backward, forward) = around.split_at(around.partition_point(|(_, is_forward, _)| !is_forward));
        if let ([backward], [forward]) = (backward, forward) {
            twins.push((forward.2, backward.2));
            continue;
        }
        let (low, high) = around[0].0;
        let axis = [low, high].map(|vertex| vertices[vertex as usize]);
        let angle = |side: Side| {
            let opposite = faces[side.face as usize][(side.from as usize + 2) % 3];
            angle_around(axis, vertices[opposite as usize])
        };
        // Counter-clockwise around the edge, the solid begins at a face that runs along it backward.
        let mut free: Vec<(f32, Side)> = forward.iter().map(|(.., side)| (angle(*side), *side)).collect();
        for &(.., side) in backward {
            let begin = angle(side);
            let turn = |end: f32| (end - begin).rem_euclid(std::f32::consts::TAU);
            let nearest = (0..free.len()).min_by(|&a, &b| turn(free[a].0).total_cmp(&turn(free[b].0)));
            if let Some(nearest) = nearest {
                twins.push((free.swap_remove(nearest).1, side));
            }
        }
    }
    twins
}

/// The angle of a point around an axis, counter-clockwise seen from the axis' end, from a direction that depends on the
/// axis alone.
fn angle_around([from, to]: [Vec3; 2], point: Vec3) -> f32 {
    let (u, v) = (to - from).try_normalize().unwrap_or(Vec3::Z).any_orthonormal_pair();
    let offset = point - from;
    offset.dot(v).atan2(offset.dot(u))
}

/// Corners of faces, united where they are one vertex.
struct Corners(Vec<u32>);

impl Corners {
    fn new(faces: usize) -> Self {
        Self((0..3 * faces as u32).collect())
    }

    /// The smallest corner of a vertex, with path halving.
    fn root(&mut self, corner: usize) -> usize {
        let mut corner = corner as u32;
        while self.0[corner as usize] != corner {
            self.0[corner as usize] = self.0[self.0[corner as usize] as usize];
            corner = self.0[corner as usize];
        }
        corner as usize
    }

    fn unite(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b) as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::super::shapes;
    use super::*;

    #[test]
    fn a_sound_mesh_stays_as_it_is() {
        let torus = shapes::torus(1.0, 0.3, 8, 6);
        let same = separated(&torus, &torus.faces);
        assert_eq!(same.faces.len(), torus.faces.len());
        assert_eq!(same.vertices.len(), torus.vertices.len());
        (0..torus.faces.len()).for_each(|face| assert_eq!(same.triangle(face), torus.triangle(face)));
        assert!(separated(&torus, &[]).vertices.is_empty());
    }

    #[test]
    fn a_sheet_without_thickness_goes() {
        let mut ball = shapes::icosphere(1, 1.0);
        let [a, b, _] = ball.faces[0];
        let tip = ball.vertices.len() as u32;
        ball.vertices.push(Vec3::splat(2.0));
        ball.normals = None;
        let closed = ball.faces.clone();
        ball.faces.extend([[a, b, tip], [b, a, tip]]);
        let mended = separated(&ball, &ball.faces);
        assert_eq!((mended.faces.len(), mended.open_edges()), (closed.len(), 0));
        assert_eq!(mended.vertices.len(), tip as usize, "the tip is not used any more");
    }

    /// Two cubes with an edge in common, the diagonally opposite quarters of a square column.
    fn cubes_that_share_an_edge() -> Mesh {
        let both = shapes::union([
            shapes::cuboid(Vec3::ZERO, Vec3::ONE),
            shapes::cuboid(Vec3::new(-1.0, -1.0, 0.0), Vec3::new(0.0, 0.0, 1.0)),
        ]);
        let first = |v: &Vec3| both.vertices.iter().position(|w| w == v).unwrap_or_default() as u32;
        let faces = both.faces.iter().map(|face| face.map(|i| first(&both.vertices[i as usize]))).collect();
        Mesh { vertices: both.vertices.clone(), faces, ..Mesh::default() }
    }

    #[test]
    fn two_bodies_that_share_an_edge_are_cut_apart() {
        let touching = cubes_that_share_an_edge();
        assert_eq!(touching.open_edges(), 1);
        let apart = separated(&touching, &touching.faces);
        let topology = super::super::Topology::of(&apart);
        assert_eq!((topology.closed, topology.components, topology.handles()), (true, 2, Some(0)));
        assert_eq!(apart.vertices.len(), 16);
        // Turned inside out, the solid is what was outside: the cut keeps that together, and it is one piece.
        let turned: Vec<[u32; 3]> = touching.faces.iter().map(|&[a, b, c]| [a, c, b]).collect();
        let topology = super::super::Topology::of(&separated(&touching, &turned));
        assert_eq!((topology.closed, topology.components), (true, 1));
    }

    #[test]
    fn three_faces_at_an_edge_are_two_and_one_with_a_border() {
        let vertices = vec![Vec3::ZERO, Vec3::Z, Vec3::X, Vec3::Y, Vec3::NEG_X];
        let fan = Mesh { vertices, faces: vec![[0, 1, 2], [1, 0, 3], [1, 0, 4]], ..Mesh::default() };
        let apart = separated(&fan, &fan.faces);
        assert_eq!((apart.faces.len(), apart.vertices.len()), (3, 7));
        assert_eq!(apart.open_edges(), 7, "nine sides, of which two are one edge");
    }
}
