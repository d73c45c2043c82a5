//! What makes a mesh trustworthy, checked the way a program sees it that merges vertices by position on loading.

use std::collections::{HashMap, HashSet};

use dvr_core::mesh::Mesh;

/// Asserts that each edge belongs to exactly two faces that run along it in opposite directions, that the faces around
/// each vertex form one fan, and that all this holds after vertices at the same place are merged.
pub fn assert_watertight(mesh: &Mesh) {
    let mut places = HashMap::new();
    let merged: Vec<usize> = mesh
        .vertices
        .iter()
        .map(|vertex| {
            let next = places.len();
            *places.entry(vertex.to_array().map(|x| (x + 0.0).to_bits())).or_insert(next)
        })
        .collect();
    assert_eq!(places.len(), mesh.vertices.len(), "two vertices at one place");
    let mut directed = HashMap::new();
    let mut corners = vec![0; mesh.vertices.len()];
    for face in &mesh.faces {
        let [a, b, c] = face.map(|vertex| merged[vertex as usize]);
        assert!(a != b && b != c && c != a, "a face with two equal corners");
        for (from, to, opposite) in [(a, b, c), (b, c, a), (c, a, b)] {
            assert!(directed.insert((from, to), opposite).is_none(), "an edge used twice in one direction");
            corners[from] += 1;
        }
    }
    for &(from, to) in directed.keys() {
        assert!(directed.contains_key(&(to, from)), "an edge with one face");
    }
    // Turning around a vertex from face to face comes back after as many faces as the vertex has.
    let mut starts: HashMap<usize, usize> = HashMap::new();
    directed.keys().for_each(|&(from, to)| _ = starts.insert(from, to));
    for (vertex, &count) in corners.iter().enumerate() {
        let first = *starts.get(&vertex).expect("a vertex without faces");
        let mut spoke = first;
        for turned in 1..=count {
            spoke = directed[&(vertex, spoke)];
            assert_eq!(spoke == first, turned == count, "two fans meet at one vertex");
        }
    }
}

/// `V - E + F`: 2 for each sphere, 0 for each torus.
pub fn euler_characteristic(mesh: &Mesh) -> i64 {
    let mut edges = HashSet::new();
    for &[a, b, c] in &mesh.faces {
        edges.extend([(a.min(b), a.max(b)), (b.min(c), b.max(c)), (c.min(a), c.max(a))]);
    }
    mesh.vertices.len() as i64 - edges.len() as i64 + mesh.faces.len() as i64
}

/// Enclosed volume, positive where faces wind counter-clockwise seen from outside.
pub fn volume(mesh: &Mesh) -> f64 {
    corners(mesh).map(|[a, b, c]| a.cross(b).dot(c) / 6.0).sum()
}

/// Surface area.
pub fn area(mesh: &Mesh) -> f64 {
    corners(mesh).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
}

fn corners(mesh: &Mesh) -> impl Iterator<Item = [glam::DVec3; 3]> + '_ {
    (0..mesh.faces.len()).map(|face| mesh.triangle(face).map(|vertex| vertex.as_dvec3()))
}
