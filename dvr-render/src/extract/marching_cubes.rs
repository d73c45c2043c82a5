//! The marching cubes table (Lorensen and Cline 1987), derived here instead of copied.
//!
//! A cell's eight corners are inside or outside: 256 cases. On each face of the cell the crossed edges are joined by
//! one rule that depends on that face's four signs only, so two cells that share a face always agree on it. Following
//! the joins from face to face gives closed loops, and each loop is triangulated by diagonals that lie in no face of
//! the cell (all loops that occur have such a triangulation). Both together make every mesh a closed manifold: a loop's
//! sides meet the neighbour's sides, and a diagonal belongs to one cell alone. (A diagonal in a face could be chosen by
//! both neighbours and then be shared by four triangles.)
//!
//! The rule on an ambiguous face (two inside corners, diagonally opposite): the inside corners are *joined*, so that a
//! thin rod that runs askew through the grid stays in one piece.
//!
//! Dual contouring makes a vertex of each loop and a side between two vertices of each join of their cells' common
//! face. If both joins of an ambiguous face belong to one loop on either side, that side would exist twice and hold
//! four quadrilaterals. Such faces are *parted* instead: the inside corners are cut off, which splits the loop in both
//! cells.
//!
//! Corner `c` of a cell is its lowest node plus `(c & 1, c >> 1 & 1, c >> 2 & 1)`. Edge `4 a + u + 2 v` runs along axis
//! `a` from the corner with offset `u` along axis `a + 1` and `v` along axis `a + 2` (modulo 3).

use std::sync::LazyLock;

use glam::UVec3;

/// The corners of face `2 axis + side`, as sets.
pub(super) const FACE_CORNERS: [u8; 6] = [0x55, 0xaa, 0x33, 0xcc, 0x0f, 0xf0];

/// The surface inside one cell.
#[derive(Clone, Debug, Default)]
pub(super) struct Case {
    /// Bit `e` is set where edge `e` is crossed.
    pub crossed_edges: u16,
    /// The closed loops of crossed edges, counter-clockwise seen from outside: the borders of connected patches.
    pub loops: Vec<Vec<u8>>,
    /// Triangles between the crossings of three edges, counter-clockwise seen from outside; five at most.
    pub triangles: Vec<[u8; 3]>,
    /// The face whose two joins both belong to one loop, and the loops with that face parted. No case has two such
    /// faces.
    pub parting: Option<(u8, Vec<Vec<u8>>)>,
}

/// The case of a cell: bit `c` of the index is set where corner `c` is inside.
pub(super) fn case(inside_corners: u8) -> &'static Case {
    static CASES: LazyLock<Vec<Case>> = LazyLock::new(|| (0..=255).map(build_case).collect());
    &CASES[inside_corners as usize]
}

/// Offset of a corner from the cell's lowest node.
pub(super) fn corner_offset(corner: u8) -> UVec3 {
    UVec3::new(u32::from(corner & 1), u32::from(corner >> 1 & 1), u32::from(corner >> 2 & 1))
}

/// The axis along which an edge runs.
pub(super) fn edge_axis(edge: u8) -> usize {
    usize::from(edge / 4)
}

/// The corner at which an edge starts; it ends at that corner plus one step along its axis.
pub(super) fn edge_start(edge: u8) -> u8 {
    let axis = edge / 4;
    let (u, v) = (edge & 1, edge >> 1 & 1);
    u << ((axis + 1) % 3) | v << ((axis + 2) % 3)
}

/// The corners of face `2 axis + side`, counter-clockwise seen from outside the cell.
fn face_corners(face: u8) -> [u8; 4] {
    let (axis, side) = (face / 2, face % 2);
    let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let base = side << axis;
    if side == 1 { [base, base | u, base | u | v, base | v] } else { [base, base | v, base | u | v, base | u] }
}

/// The edge between two neighbouring corners.
fn edge_between(a: u8, b: u8) -> u8 {
    let axis = (a ^ b).trailing_zeros() as u8;
    let start = a & b;
    4 * axis + (start >> ((axis + 1) % 3) & 1) + 2 * (start >> ((axis + 2) % 3) & 1)
}

/// Bit `f` is set for the two faces that hold an edge.
fn faces_of_edge(edge: u8) -> u8 {
    (0..6).filter(|&face| face_edges(face).contains(&edge)).fold(0, |mask, face| mask | 1 << face)
}

/// Edge `k` of a face runs from its corner `k` to its corner `k + 1`.
fn face_edges(face: u8) -> [u8; 4] {
    let corners = face_corners(face);
    std::array::from_fn(|k| edge_between(corners[k], corners[(k + 1) % 4]))
}

fn build_case(inside_corners: u8) -> Case {
    let loops = trace_loops(inside_corners, None);
    let twice_in_one_loop = |&face: &u8| {
        let edges = face_edges(face);
        loops.iter().any(|polygon| edges.iter().all(|edge| polygon.contains(edge)))
    };
    Case {
        crossed_edges: loops.iter().flatten().fold(0, |mask, edge| mask | 1 << edge),
        triangles: loops.iter().flat_map(|polygon| triangulate(polygon)).flatten().collect(),
        parting: (0..6).find(twice_in_one_loop).map(|face| (face, trace_loops(inside_corners, Some(face)))),
        loops,
    }
}

/// The loops of a case, each from its lowest edge on, if `parted` (an ambiguous face) cuts off its inside corners.
fn trace_loops(inside_corners: u8, parted: Option<u8>) -> Vec<Vec<u8>> {
    let inside = |corner: u8| inside_corners >> corner & 1 == 1;
    // Walking round a face counter-clockwise, a join starts where the walk enters the object and ends at the crossing
    // before it: it cuts off the outside corners in between, and leaves the object to its right, as the boundary of a
    // patch behind the face whose normal points outwards must. An edge is entered on one of its faces only.
    let mut next = [None; 12];
    for face in 0..6 {
        let (corners, edges) = (face_corners(face), face_edges(face));
        let crossed = |k: usize| inside(corners[k]) != inside(corners[(k + 1) % 4]);
        let step = if parted == Some(face) { 1 } else { 3 };
        for k in (0..4).filter(|&k| crossed(k) && !inside(corners[k])) {
            next[edges[k] as usize] = (1..4).map(|i| (k + step * i) % 4).find(|&k| crossed(k)).map(|k| edges[k]);
        }
    }
    let mut loops = Vec::new();
    for first in 0..12u8 {
        let mut polygon = Vec::new();
        let mut edge = first;
        while let Some(following) = next[edge as usize].take() {
            polygon.push(edge);
            edge = following;
        }
        if !polygon.is_empty() {
            loops.push(polygon);
        }
    }
    loops
}

/// The triangulation of a loop with the shortest diagonals among those with no diagonal in a face, if there is one.
///
/// Dynamic programming over the loop's sub-polygons; lengths are measured between the middles of the edges.
fn triangulate(polygon: &[u8]) -> Option<Vec<[u8; 3]>> {
    let n = polygon.len();
    if n < 3 {
        return None;
    }
    let diagonal = |i: usize, j: usize| {
        if j - i == 1 || j - i == n - 1 {
            Some(0) // a side of the loop
        } else if faces_of_edge(polygon[i]) & faces_of_edge(polygon[j]) != 0 {
            None
        } else {
            Some(doubled_middle(polygon[i]).as_ivec3().distance_squared(doubled_middle(polygon[j]).as_ivec3()))
        }
    };
    // best[i][j]: cost of the sub-polygon i..=j, and the third corner of its triangle on the side (i, j).
    let mut best = vec![vec![None; n]; n];
    for i in 0..n - 1 {
        best[i][i + 1] = Some((0, 0));
    }
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            best[i][j] = (i + 1..j)
                .filter_map(|k| {
                    let (left, right): ((i32, usize), (i32, usize)) = (best[i][k]?, best[k][j]?);
                    Some((left.0 + right.0 + diagonal(i, k)? + diagonal(k, j)?, k))
                })
                .min();
        }
    }
    let mut triangles = Vec::with_capacity(n - 2);
    let mut rest = vec![(0, n - 1)];
    while let Some((i, j)) = rest.pop() {
        let (_, k) = best[i][j]?;
        if j - i >= 2 {
            triangles.push([polygon[i], polygon[k], polygon[j]]);
            rest.extend([(i, k), (k, j)]);
        }
    }
    Some(triangles)
}

/// Twice the middle of an edge in cell coordinates.
fn doubled_middle(edge: u8) -> UVec3 {
    let mut middle = 2 * corner_offset(edge_start(edge));
    middle[edge_axis(edge)] += 1;
    middle
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use glam::Vec3;

    use super::*;

    /// Directed sides of a case's triangles.
    fn sides(case: &Case) -> Vec<(u8, u8)> {
        case.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect()
    }

    /// Sides that no other triangle of the cell answers: those that lie in the cell's faces.
    fn open_sides(case: &Case) -> Vec<(u8, u8)> {
        let all = sides(case);
        all.iter().copied().filter(|&(a, b)| !all.contains(&(b, a))).collect()
    }

    #[test]
    fn the_sets_of_face_corners_are_those_of_the_walks_round_the_faces() {
        for face in 0..6u8 {
            let set = face_corners(face).iter().fold(0, |set, corner| set | 1u8 << corner);
            assert_eq!(set, FACE_CORNERS[face as usize]);
        }
    }

    #[test]
    fn a_case_has_a_crossing_on_every_edge_whose_corners_differ() {
        for inside in 0..=255u8 {
            let case = case(inside);
            for edge in 0..12 {
                let (start, end) = (edge_start(edge), edge_start(edge) | 1 << edge_axis(edge));
                let crossed = (inside >> start ^ inside >> end) & 1 == 1;
                assert_eq!(case.crossed_edges >> edge & 1 == 1, crossed);
                assert_eq!(case.triangles.iter().flatten().any(|&vertex| vertex == edge), crossed);
            }
        }
    }

    #[test]
    fn the_patch_of_a_cell_is_a_manifold_whose_only_sides_in_faces_are_its_border() {
        for inside in 0..=255u8 {
            let case = case(inside);
            let all = sides(case);
            let mut seen = HashMap::new();
            all.iter().for_each(|&side| *seen.entry(side).or_insert(0) += 1);
            assert!(seen.values().all(|&count| count == 1), "case {inside}: a side is used twice in one direction");
            for &(a, b) in &all {
                let in_a_face = faces_of_edge(a) & faces_of_edge(b) != 0;
                assert_eq!(in_a_face, !all.contains(&(b, a)), "case {inside}: side {a}-{b}");
            }
        }
    }

    #[test]
    fn cells_that_share_a_face_agree_on_it_whatever_their_signs() {
        // All signs of two cells side by side: 12 nodes, of which the middle four are shared.
        for axis in 0..3u8 {
            let (low_face, high_face) = (2 * axis, 2 * axis + 1);
            let shared = face_corners(high_face);
            let across = |edge: u8| {
                edge_between(edge_start(edge) ^ 1 << axis, (edge_start(edge) | 1 << edge_axis(edge)) ^ 1 << axis)
            };
            for left in 0..=255u8 {
                for far in 0..16u8 {
                    let mut right = 0u8;
                    for (k, &corner) in shared.iter().enumerate() {
                        right |= (left >> corner & 1) << (corner ^ 1 << axis) | (far >> k & 1) << corner;
                    }
                    let in_face = |side: &(u8, u8), face: u8| {
                        let mask = 1 << face;
                        faces_of_edge(side.0) & mask != 0 && faces_of_edge(side.1) & mask != 0
                    };
                    let mut ours: Vec<_> =
                        open_sides(case(left)).into_iter().filter(|side| in_face(side, high_face)).collect();
                    let mut theirs: Vec<_> = open_sides(case(right))
                        .into_iter()
                        .filter(|side| in_face(side, low_face))
                        .map(|(a, b)| (across(b), across(a)))
                        .collect();
                    ours.sort_unstable();
                    theirs.sort_unstable();
                    assert_eq!(ours, theirs, "axis {axis}, cases {left} and {right}");
                }
            }
        }
    }

    /// For each ambiguous face, the loops of its two joins.
    fn joins_of_ambiguous_faces(inside: u8, loops: &[Vec<u8>]) -> Vec<(u8, [usize; 2])> {
        let owner = |edge: u8| loops.iter().position(|polygon| polygon.contains(&edge)).unwrap();
        (0..6)
            .filter(|&face| face_edges(face).iter().all(|&edge| case(inside).crossed_edges >> edge & 1 == 1))
            .map(|face| {
                // Opposite edges of an ambiguous face belong to different joins, however it is joined.
                let edges = face_edges(face);
                (face, [owner(edges[0]), owner(edges[2])])
            })
            .collect()
    }

    #[test]
    fn parting_a_face_puts_its_joins_into_different_loops_and_no_other_face_s_into_one() {
        let mut partings = 0;
        for inside in 0..=255u8 {
            let case = case(inside);
            let twice: Vec<u8> = joins_of_ambiguous_faces(inside, &case.loops)
                .into_iter()
                .filter_map(|(face, [a, b])| (a == b).then_some(face))
                .collect();
            assert!(twice.len() <= 1, "case {inside}: two such faces");
            assert_eq!(case.parting.as_ref().map(|(face, _)| *face), twice.first().copied());
            if let Some((_, loops)) = &case.parting {
                assert!(joins_of_ambiguous_faces(inside, loops).iter().all(|(_, [a, b])| a != b), "case {inside}");
                assert_eq!(loops.iter().map(Vec::len).sum::<usize>(), case.crossed_edges.count_ones() as usize);
                partings += 1;
            }
        }
        assert_eq!(partings, 36);
    }

    #[test]
    fn mass_points_of_a_cell_s_loops_lie_apart_wherever_on_their_edges_the_crossings_are() {
        let directions = || (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]);
        // The least and the greatest that the mean of a loop's crossings can be along a direction, both out of reach.
        let range = |polygon: &[u8], direction: [i32; 3]| {
            let ends = polygon.iter().map(|&edge| {
                let start = corner_offset(edge_start(edge)).as_ivec3().to_array();
                let at = start.iter().zip(direction).map(|(x, d)| x * d).sum::<i32>();
                let step = direction[edge_axis(edge)];
                (at + step.min(0), at + step.max(0))
            });
            let (low, high) = ends.fold((0, 0), |sum, end| (sum.0 + end.0, sum.1 + end.1));
            let count = polygon.len() as f32;
            (low as f32 / count, high as f32 / count)
        };
        for inside in 0..=255u8 {
            let case = case(inside);
            for loops in [Some(&case.loops), case.parting.as_ref().map(|(_, loops)| loops)].into_iter().flatten() {
                for (i, a) in loops.iter().enumerate() {
                    for b in &loops[..i] {
                        let apart = directions().any(|direction| {
                            let (a, b) = (range(a, direction), range(b, direction));
                            a.1 <= b.0 && (a.0, b.0) != (a.1, b.1)
                        });
                        assert!(apart, "case {inside}: {a:?} and {b:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn triangles_face_away_from_a_single_inside_corner() {
        for corner in 0..8u8 {
            for (inside, sign) in [(1u8 << corner, 1.0), (!(1u8 << corner), -1.0)] {
                let [[a, b, c]] = case(inside).triangles[..] else { panic!("one corner is cut off by one triangle") };
                let [a, b, c] = [a, b, c].map(|edge| doubled_middle(edge).as_vec3() / 2.0);
                let outwards = Vec3::splat(0.5) - corner_offset(corner).as_vec3();
                assert!(sign * (b - a).cross(c - a).dot(outwards) > 0.0);
            }
        }
    }

    #[test]
    fn inside_corners_across_a_face_are_joined_and_outside_corners_are_parted() {
        // Corners 0 and 3 lie across the face z = 0: one strip joins them. Their complement: two separate corners.
        let euler = |inside: u8| {
            let case = case(inside);
            let vertices = case.crossed_edges.count_ones() as i32;
            let sides = (sides(case).len() + open_sides(case).len()) as i32 / 2;
            vertices - sides + case.triangles.len() as i32
        };
        assert_eq!(euler(0b0000_1001), 1, "one disc");
        assert_eq!(euler(0b1111_0110), 2, "two discs");
    }

    #[test]
    fn no_triangle_is_flat_when_crossings_lie_at_the_middles() {
        for inside in 0..=255u8 {
            let case = case(inside);
            for &[a, b, c] in &case.triangles {
                let [a, b, c] = [a, b, c].map(|edge| doubled_middle(edge).as_vec3() / 2.0);
                assert!((b - a).cross(c - a).length() > 0.05, "case {inside}");
            }
        }
    }
}
