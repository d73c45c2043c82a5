//! Cutting a mesh by a plane, and closing what the cut opens.

use glam::DVec2;
use rustc_hash::{FxHashMap, FxHashSet};

use super::Mesh;
use crate::half_space::HalfSpace;

impl Mesh {
    /// The part of the mesh before a plane. What the cut opens is closed by caps in the plane, whose corners are those of their
    /// rims: with their colours, and closed by index where the mesh is.
    ///
    /// Rims within rims are holes in their caps. Caps are triangulated by ear clipping (the crate `earcut`, after Held 2001);
    /// where a cap cannot be closed, since its rims cross each other or are points, each of them gets a fan around its middle.
    pub fn cut_before(&self, half: &HalfSpace) -> Self {
        let mut cut = Cut::new(self, half);
        for face in &self.faces {
            cut.face(*face);
        }
        let rims = cut.rims();
        let mut mesh = cut.mesh;
        if !rims.is_empty() {
            let (x, y) = half.normal.any_orthonormal_pair();
            // Caps look away from the half that is kept.
            let (x, y) = if x.cross(y).dot(half.normal) < 0.0 { (x, y) } else { (y, x) };
            let flat = |i: u32| {
                let p = mesh.vertices[i as usize].as_dvec3();
                DVec2::new(p.dot(x), p.dot(y))
            };
            let rims: Vec<Rim> = rims.into_iter().map(|corners| Rim::new(corners, flat)).collect();
            for part in parts(&rims) {
                match cap(&part) {
                    Some(faces) => mesh.faces.extend(faces),
                    None => part.iter().for_each(|rim| mesh.fan(&rim.corners)),
                }
            }
        }
        mesh
    }

    /// Closes a rim by a fan around the mean of its corners.
    fn fan(&mut self, rim: &[u32]) {
        let middle = self.vertices.len() as u32;
        let share = 1.0 / rim.len() as f32;
        let corners = || rim.iter().map(|&i| i as usize);
        self.vertices.push(corners().map(|i| self.vertices[i]).sum::<glam::Vec3>() * share);
        if let Some(normals) = &mut self.normals {
            normals.push(corners().map(|i| normals[i]).sum::<glam::Vec3>().normalize_or_zero());
        }
        if let Some(colors) = &mut self.colors {
            colors.push([0, 1, 2].map(|c| corners().map(|i| colors[i][c]).sum::<f32>() * share));
        }
        if let Some(observations) = &mut self.observations {
            observations.push(observations[rim[0] as usize]);
        }
        let next = rim.iter().cycle().skip(1);
        self.faces.extend(rim.iter().zip(next).map(|(&a, &b)| [a, b, middle]));
    }
}

/// A mesh in the making: the part that is kept, and the edges along which it is open.
struct Cut<'a> {
    whole: &'a Mesh,
    distances: Vec<f64>,
    mesh: Mesh,
    /// The new number of a vertex that is kept.
    kept: FxHashMap<u32, u32>,
    /// The new vertex on an edge, by its ends in ascending order.
    on_edge: FxHashMap<[u32; 2], u32>,
    /// The edges of caps, by where they start; more than one starts where the mesh touches itself.
    rim: FxHashMap<u32, Vec<u32>>,
    /// Where they start, in the order of the faces.
    starts: Vec<u32>,
}

impl<'a> Cut<'a> {
    fn new(whole: &'a Mesh, half: &HalfSpace) -> Self {
        let mesh = Mesh {
            normals: whole.normals.as_ref().map(|_| Vec::new()),
            colors: whole.colors.as_ref().map(|_| Vec::new()),
            observations: whole.observations.as_ref().map(|_| Vec::new()),
            ..Mesh::default()
        };
        let distances = whole.vertices.iter().map(|&vertex| half.distance(vertex)).collect();
        let (kept, on_edge, rim) = Default::default();
        Self { whole, distances, mesh, kept, on_edge, rim, starts: Vec::new() }
    }

    /// Takes what is before the plane of a face. A corner in the plane counts as behind it, so that each corner is on one side.
    fn face(&mut self, face: [u32; 3]) {
        let before = face.map(|i| self.distances[i as usize] > 0.0);
        let turned = |k: usize| [face[k], face[(k + 1) % 3], face[(k + 2) % 3]];
        match before.iter().filter(|before| **before).count() {
            0 => {}
            3 => {
                let face = face.map(|i| self.keep(i));
                self.mesh.faces.push(face);
            }
            1 => {
                let [a, b, c] = turned(before.iter().position(|before| *before).unwrap_or(0));
                let [a, ab, ca] = [self.keep(a), self.between(a, b), self.between(a, c)];
                self.mesh.faces.push([a, ab, ca]);
                self.open(ca, ab);
            }
            _ => {
                let [c, a, b] = turned(before.iter().position(|before| !*before).unwrap_or(0));
                let [bc, ca] = [self.between(b, c), self.between(a, c)];
                let [a, b] = [self.keep(a), self.keep(b)];
                self.mesh.faces.extend([[a, b, bc], [a, bc, ca]]);
                self.open(ca, bc);
            }
        }
    }

    /// An edge of a cap, against the direction of the face beside it.
    fn open(&mut self, from: u32, to: u32) {
        self.rim.entry(from).or_default().push(to);
        self.starts.push(from);
    }

    fn keep(&mut self, old: u32) -> u32 {
        if let Some(&new) = self.kept.get(&old) {
            return new;
        }
        let new = self.push(old, old, 0.0);
        self.kept.insert(old, new);
        new
    }

    /// Where the edge from a vertex before the plane to one behind meets it.
    fn between(&mut self, before: u32, behind: u32) -> u32 {
        let key = [before.min(behind), before.max(behind)];
        if let Some(&new) = self.on_edge.get(&key) {
            return new;
        }
        let (d, e) = (self.distances[before as usize], self.distances[behind as usize]);
        let new = self.push(before, behind, (d / (d - e)) as f32);
        self.on_edge.insert(key, new);
        new
    }

    /// A vertex at this share of the way from one to another.
    fn push(&mut self, from: u32, to: u32, share: f32) -> u32 {
        let (a, b) = (from as usize, to as usize);
        let (whole, mesh) = (self.whole, &mut self.mesh);
        mesh.vertices.push(whole.vertices[a].lerp(whole.vertices[b], share));
        if let (Some(old), Some(new)) = (&whole.normals, &mut mesh.normals) {
            new.push(old[a].lerp(old[b], share).normalize_or(old[a]));
        }
        if let (Some(old), Some(new)) = (&whole.colors, &mut mesh.colors) {
            new.push([0, 1, 2].map(|c| old[a][c] + share * (old[b][c] - old[a][c])));
        }
        if let (Some(old), Some(new)) = (&whole.observations, &mut mesh.observations) {
            new.push(old[a]);
        }
        mesh.vertices.len() as u32 - 1
    }

    /// The closed rims. What an open mesh leaves open is no rim.
    fn rims(&mut self) -> Vec<Vec<u32>> {
        let mut rims = Vec::new();
        for start in std::mem::take(&mut self.starts) {
            let mut rim = vec![start];
            while let Some(next) = rim.last().and_then(|last| self.rim.get_mut(last)).and_then(Vec::pop) {
                if next == start {
                    rims.push(std::mem::take(&mut rim));
                    break;
                }
                rim.push(next);
            }
        }
        rims
    }
}

/// A closed rim in the plane, counter-clockwise around what it bounds seen from where its cap looks.
struct Rim {
    corners: Vec<u32>,
    flat: Vec<DVec2>,
    /// Positive for the outside of a cap, negative for a hole.
    area: f64,
}

impl Rim {
    fn new(corners: Vec<u32>, flat: impl Fn(u32) -> DVec2) -> Self {
        let flat: Vec<DVec2> = corners.iter().map(|&i| flat(i)).collect();
        let next = flat.iter().cycle().skip(1);
        // Relative to a corner: far from the origin the products would lose the rim's size.
        let area = flat.iter().zip(next).map(|(a, b)| (*a - flat[0]).perp_dot(*b - flat[0])).sum::<f64>() / 2.0;
        Self { corners, flat, area }
    }

    /// Whether a point lies within, by the edges that a ray from it crosses.
    fn holds(&self, p: DVec2) -> bool {
        let next = self.flat.iter().cycle().skip(1);
        let crossings = self
            .flat
            .iter()
            .zip(next)
            .filter(|(a, b)| (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x));
        crossings.count() % 2 == 1
    }
}

/// The rims of each cap, the outer one first. A hole that nothing is around, as rounding makes of a point, is a part of its own.
fn parts(rims: &[Rim]) -> Vec<Vec<&Rim>> {
    let (outer, holes): (Vec<&Rim>, Vec<&Rim>) = rims.iter().partition(|rim| rim.area >= 0.0);
    let mut parts: Vec<Vec<&Rim>> = outer.iter().map(|rim| vec![*rim]).collect();
    for hole in holes {
        let around = (0..outer.len()).filter(|&i| outer[i].holds(hole.flat[0]));
        match around.min_by(|&a, &b| outer[a].area.total_cmp(&outer[b].area)) {
            Some(nearest) => parts[nearest].push(hole),
            None => parts.push(vec![hole]),
        }
    }
    parts
}

/// Faces of a cap with its holes behind its outer rim; `None` where they would not close it.
fn cap(part: &[&Rim]) -> Option<Vec<[u32; 3]>> {
    let corners: Vec<u32> = part.iter().flat_map(|rim| rim.corners.iter().copied()).collect();
    let flat: Vec<[f64; 2]> = part.iter().flat_map(|rim| rim.flat.iter().map(DVec2::to_array)).collect();
    let ends = part.iter().scan(0, |end, rim| {
        *end += rim.corners.len() as u32;
        Some(*end)
    });
    let holes: Vec<u32> = ends.take(part.len() - 1).collect();
    let mut indices: Vec<u32> = Vec::new();
    earcut::Earcut::new().earcut(flat.iter().copied(), &holes, &mut indices);
    let at = |i: u32| DVec2::from_array(flat[i as usize]);
    let area = |t: &[u32]| (at(t[1]) - at(t[0])).perp_dot(at(t[2]) - at(t[0]));
    let turned = indices.chunks_exact(3).map(area).sum::<f64>() < 0.0;
    let mut next: FxHashMap<u32, u32> = FxHashMap::default();
    for rim in part {
        next.extend(rim.corners.iter().copied().zip(rim.corners.iter().copied().cycle().skip(1)));
    }
    if next.len() < corners.len() {
        return None;
    }
    let mut faces: Vec<[u32; 3]> = indices
        .chunks_exact(3)
        .map(|t| if turned { [t[0], t[2], t[1]] } else { [t[0], t[1], t[2]] }.map(|i| corners[i as usize]))
        .collect();
    take_up(&mut faces, &next);
    is_closed(&faces, &next).then_some(faces)
}

/// Ear clipping leaves out corners on a straight line, where the faces beside have them: they are taken up into the sides of
/// triangles that pass them by.
fn take_up(faces: &mut Vec<[u32; 3]>, next: &FxHashMap<u32, u32>) {
    let taken: FxHashSet<[u32; 2]> = faces.iter().flat_map(|face| sides(*face)).collect();
    let passed_by = |[a, b]: [u32; 2]| {
        let mut between = Vec::new();
        if next.get(&a) == Some(&b) || taken.contains(&[b, a]) {
            return between;
        }
        let mut at = a;
        while let Some(&following) = next.get(&at).filter(|_| between.len() < next.len()) {
            if following == b {
                return between;
            }
            between.push(following);
            at = following;
        }
        Vec::new()
    };
    *faces = std::mem::take(faces)
        .into_iter()
        .flat_map(|[a, b, c]| {
            let turns = [[a, b, c], [b, c, a], [c, a, b]];
            // From the corner across, no triangle of the fan is flat.
            let turn = turns.into_iter().find(|turn| !passed_by([turn[0], turn[1]]).is_empty());
            let [a, b, c] = turn.unwrap_or([a, b, c]);
            let mut outline = Vec::new();
            for side in [[c, a], [a, b], [b, c]] {
                outline.push(side[0]);
                outline.extend(passed_by(side));
            }
            (1..outline.len() - 1).map(|i| [outline[0], outline[i], outline[i + 1]]).collect::<Vec<_>>()
        })
        .collect();
}

/// The sides of a triangle, in its direction.
fn sides([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// Whether faces have the rims as their border, each side of a rim once, and nothing else.
fn is_closed(faces: &[[u32; 3]], next: &FxHashMap<u32, u32>) -> bool {
    let all: Vec<[u32; 2]> = faces.iter().flat_map(|face| sides(*face)).collect();
    let once: FxHashSet<[u32; 2]> = all.iter().copied().collect();
    let borders = all.iter().filter(|[a, b]| !once.contains(&[*b, *a]));
    once.len() == all.len()
        && borders.clone().count() == next.len()
        && borders.clone().all(|[a, b]| next.get(a) == Some(b))
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::mesh::shapes;

    fn half(normal: DVec3, offset: f64) -> HalfSpace {
        HalfSpace { normal: normal.normalize(), offset }
    }

    fn volume(mesh: &Mesh) -> f64 {
        let of = |face| {
            let [a, b, c] = mesh.triangle(face).map(|corner| corner.as_dvec3());
            a.cross(b).dot(c) / 6.0
        };
        (0..mesh.faces.len()).map(of).sum()
    }

    /// Both parts are closed, lie on their sides, and make up the whole.
    fn halves(mesh: &Mesh, half: HalfSpace) -> [Mesh; 2] {
        let other = HalfSpace { normal: -half.normal, offset: -half.offset };
        let parts = [half, other].map(|half| {
            let part = mesh.cut_before(&half);
            assert_eq!(part.open_edges(), 0, "{half:?}");
            assert!(part.vertices.iter().all(|&vertex| half.distance(vertex) > -1e-6));
            part
        });
        assert!((volume(&parts[0]) + volume(&parts[1]) - volume(mesh)).abs() < 1e-5, "{half:?}");
        parts
    }

    #[test]
    fn parts_are_closed_and_make_up_the_whole() {
        let shapes = [shapes::icosphere(3, 1.0), shapes::torus(1.0, 0.4, 40, 20), shapes::wire_cube(1.0, 0.1)];
        for mesh in &shapes {
            for (normal, offset) in [
                (DVec3::new(0.2, 1.0, 0.1), 0.05),
                (DVec3::new(1.0, 0.1, 0.3), 0.2),
                (DVec3::new(0.3, -0.2, 1.0), -0.31),
            ] {
                halves(mesh, half(normal, offset));
            }
        }
        // One part is a ring with a hole, whose cap is an annulus: between circles of radius .6 and 1.4.
        let [upper, _] = halves(&shapes[1], half(DVec3::Y, 1e-3));
        let flat = |face: &usize| upper.triangle(*face).iter().all(|corner| (corner.y - 1e-3).abs() < 1e-6);
        let area = |face: usize| {
            let [a, b, c] = upper.triangle(face);
            f64::from((b - a).cross(c - a).y) / 2.0
        };
        let cap: f64 = (0..upper.faces.len()).filter(flat).map(area).sum();
        assert!((cap + std::f64::consts::PI * (1.4f64.powi(2) - 0.6f64.powi(2))).abs() < 0.1, "{cap}");
    }

    #[test]
    fn rims_with_corners_on_straight_lines_and_planes_through_corners_are_closed_too() {
        let mut cuboid = shapes::cuboid(Vec3::splat(-1.0), Vec3::ONE);
        for _ in 0..3 {
            // Each face in four, so that rims have corners on straight lines.
            let faces = std::mem::take(&mut cuboid.faces);
            let mut middles: FxHashMap<[u32; 2], u32> = FxHashMap::default();
            for [a, b, c] in faces {
                let mut middle =
                    |a: u32, b: u32| *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| cuboid.push_middle(a, b));
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                cuboid.faces.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
            }
        }
        for offset in [0.1, 0.0, 0.25, 0.5] {
            let [upper, _] = halves(&cuboid, half(DVec3::Y, offset));
            assert!((volume(&upper) - 4.0 * (1.0 - offset)).abs() < 1e-5, "{offset}");
        }
    }

    #[test]
    fn what_touches_the_plane_in_a_point_spoils_no_other_cap() {
        let mut mesh = shapes::torus(1.0, 0.4, 40, 20);
        let torus = volume(&mesh);
        let first = mesh.vertices.len() as u32;
        // A double pyramid beside it that stands on its tip.
        let corners = [Vec3::X, Vec3::Z, -Vec3::X, -Vec3::Z].map(|side| 0.5 * side + 0.5 * Vec3::Y);
        let tips = [Vec3::Y, Vec3::ZERO];
        mesh.vertices.extend(corners.iter().chain(&tips).map(|&corner| corner + 5.0 * Vec3::X));
        for i in 0..4 {
            let [a, b] = [first + i, first + (i + 1) % 4];
            mesh.faces.extend([[a, b, first + 5], [b, a, first + 4]]);
        }
        let pyramids = volume(&mesh) - torus;
        assert!((pyramids - 1.0 / 6.0).abs() < 1e-6, "{pyramids}");
        (mesh.normals, mesh.colors) = (None, None);
        let cut = mesh.cut_before(&half(DVec3::Y, 0.0));
        assert_eq!(cut.open_edges(), 0);
        assert!((volume(&cut) - torus / 2.0 - pyramids).abs() < 1e-3, "{} {torus} {pyramids}", volume(&cut));
    }

    #[test]
    fn caps_have_the_colours_of_their_rims_and_what_is_not_cut_stays() {
        let mut ball = shapes::icosphere(2, 1.0);
        ball.colors = Some(ball.vertices.iter().map(|v| if v.y > -0.2 { [0.9, 0.2, 0.1] } else { [0.0; 3] }).collect());
        let cut = ball.cut_before(&half(DVec3::Y, 0.3));
        let colors = cut.colors.as_ref().unwrap();
        assert!(colors.iter().all(|color| (color[0] - 0.9).abs() < 1e-6) && colors.len() == cut.vertices.len());
        assert_eq!(cut.normals.as_ref().map(Vec::len), Some(cut.vertices.len()));
        let whole = ball.cut_before(&half(DVec3::Y, -2.0));
        assert_eq!((whole.faces.len(), volume(&whole)), (ball.faces.len(), volume(&ball)));
        assert!(ball.cut_before(&half(DVec3::Y, 2.0)).is_empty());
    }

    #[test]
    fn an_open_mesh_stays_open_where_it_was() {
        let mut ball = shapes::icosphere(2, 1.0);
        ball.faces.pop();
        let open = ball.open_edges();
        for y in [-0.9, 0.0, 0.9] {
            assert!(ball.cut_before(&half(DVec3::new(0.1, 1.0, 0.0), y)).open_edges() <= open + 2);
        }
    }
}
