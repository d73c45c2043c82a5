//! The surface divided into patches that face the same way.

use dvr_core::mesh::Mesh;
use glam::Vec3;

use super::adjacency::NONE;

/// Rounds of averaging before normals are asked which way a face looks: noise of the surface must not tear patches.
const SMOOTHING_ROUNDS: usize = 8;

/// Rounds in which a face follows the majority around it.
const MAJORITY_ROUNDS: usize = 6;

/// Cosine to its patch's direction beyond which a face does not follow the majority.
const MIN_COSINE: f32 = 0.35;

/// Patches with a smaller share of the surface join a neighbour.
const SMALL: f32 = 1e-3;

/// The directions that patches face.
const DIRECTIONS: [Vec3; 6] = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];

/// The patch of each face, counted from 0. Patches are connected; noise is smoothed away.
pub(super) fn segments(mesh: &Mesh, neighbours: &[[u32; 3]]) -> Vec<u32> {
    let areas = face_normals(mesh);
    let normals = smoothed(&areas, neighbours);
    let direction = |normal: &Vec3| {
        let along = |i: &usize| normal.dot(DIRECTIONS[*i]);
        (0..DIRECTIONS.len()).max_by(|a, b| along(a).total_cmp(&along(b))).unwrap_or(0)
    };
    let mut labels: Vec<usize> = normals.iter().map(direction).collect();
    for _ in 0..MAJORITY_ROUNDS {
        labels = (0..labels.len()).map(|face| majority(face, &labels, &normals, neighbours)).collect();
    }
    let patches = components(&labels, neighbours);
    joined(patches, &areas, neighbours)
}

/// Normals with the length of the faces' areas.
fn face_normals(mesh: &Mesh) -> Vec<Vec3> {
    let normal = |face| {
        let [a, b, c] = mesh.triangle(face);
        0.5 * (b - a).cross(c - a)
    };
    (0..mesh.faces.len()).map(normal).collect()
}

fn smoothed(areas: &[Vec3], neighbours: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = areas.to_vec();
    for _ in 0..SMOOTHING_ROUNDS {
        let around = |face: usize| {
            let others = neighbours[face].iter().filter(|other| **other != NONE).map(|&other| normals[other as usize]);
            normals[face] + others.sum::<Vec3>()
        };
        normals = (0..normals.len()).map(|face| 0.25 * around(face)).collect();
    }
    normals.into_iter().map(Vec3::normalize_or_zero).collect()
}

/// The label that two neighbours of a face have, if the face may have it, else its own.
fn majority(face: usize, labels: &[usize], normals: &[Vec3], neighbours: &[[u32; 3]]) -> usize {
    let around = neighbours[face].map(|other| if other == NONE { labels[face] } else { labels[other as usize] });
    let [a, b, c] = around;
    let common = if a == b || a == c {
        a
    } else if b == c {
        b
    } else {
        labels[face]
    };
    if normals[face].dot(DIRECTIONS[common]) > MIN_COSINE { common } else { labels[face] }
}

/// Connected faces of one label.
fn components(labels: &[usize], neighbours: &[[u32; 3]]) -> Vec<u32> {
    let mut patches = vec![NONE; labels.len()];
    let (mut count, mut queue) = (0, Vec::new());
    for seed in 0..labels.len() {
        if patches[seed] != NONE {
            continue;
        }
        patches[seed] = count;
        queue.push(seed);
        while let Some(face) = queue.pop() {
            for other in neighbours[face].into_iter().filter(|&other| other != NONE).map(|other| other as usize) {
                if patches[other] == NONE && labels[other] == labels[seed] {
                    patches[other] = count;
                    queue.push(other);
                }
            }
        }
        count += 1;
    }
    patches
}

/// Small patches join the neighbour that they share most edges with, where that faces a similar way.
fn joined(patches: Vec<u32>, areas: &[Vec3], neighbours: &[[u32; 3]]) -> Vec<u32> {
    let count = patches.iter().max().map_or(0, |last| *last as usize + 1);
    let (mut sizes, mut normals) = (vec![0.0f32; count], vec![Vec3::ZERO; count]);
    for (&patch, area) in patches.iter().zip(areas) {
        sizes[patch as usize] += area.length();
        normals[patch as usize] += *area;
    }
    let small = SMALL * sizes.iter().sum::<f32>();
    // Edges between small patches and others.
    let mut borders: Vec<(u32, u32)> = Vec::new();
    for (face, across) in neighbours.iter().enumerate() {
        let patch = patches[face];
        if sizes[patch as usize] < small {
            let others = across.iter().filter(|other| **other != NONE).map(|&other| patches[other as usize]);
            borders.extend(others.filter(|&other| other != patch).map(|other| (patch, other)));
        }
    }
    borders.sort_unstable();
    let mut best = vec![(0usize, NONE); count];
    for border in borders.chunk_by(|a, b| a == b) {
        let (patch, other) = border[0];
        let cosine = normals[patch as usize].normalize_or_zero().dot(normals[other as usize].normalize_or_zero());
        let is_larger = sizes[other as usize] > sizes[patch as usize];
        if cosine > MIN_COSINE && is_larger && border.len() > best[patch as usize].0 {
            best[patch as usize] = (border.len(), other);
        }
    }
    // Targets are larger than what joins them, so this ends.
    let target = |mut patch: u32| {
        while best[patch as usize].1 != NONE {
            patch = best[patch as usize].1;
        }
        patch
    };
    patches.into_iter().map(target).collect()
}
