//! Connected components of a mesh.

/// The number of each face's connected component, counted in the order of the faces, and how many components there are.
/// Faces are connected where they share a vertex.
pub fn connected_components(vertex_count: usize, faces: &[[u32; 3]]) -> (Vec<u32>, usize) {
    // Union-find with path halving; the smaller number is the root, so the result does not depend on the order.
    let mut parents: Vec<u32> = (0..vertex_count as u32).collect();
    for &[a, b, c] in faces {
        for (i, j) in [(a, b), (b, c)] {
            let (i, j) = (root(&mut parents, i), root(&mut parents, j));
            parents[i.max(j) as usize] = i.min(j);
        }
    }
    let mut numbers = vec![u32::MAX; vertex_count];
    let mut count = 0;
    let labels = faces
        .iter()
        .map(|face| {
            let number = &mut numbers[root(&mut parents, face[0]) as usize];
            if *number == u32::MAX {
                *number = count;
                count += 1;
            }
            *number
        })
        .collect();
    (labels, count as usize)
}

fn root(parents: &mut [u32], mut vertex: u32) -> u32 {
    while parents[vertex as usize] != vertex {
        parents[vertex as usize] = parents[parents[vertex as usize] as usize];
        vertex = parents[vertex as usize];
    }
    vertex
}
