//! What a mesh is, in a line.

/// How many vertices, faces, and pairs of faces that intersect.
pub fn mesh_line(vertices: usize, faces: usize, self_intersections: usize) -> String {
    let crossing = match self_intersections {
        0 => "no face intersects another".to_owned(),
        1 => "1 pair of faces intersects".to_owned(),
        pairs => format!("{pairs} pairs of faces intersect"),
    };
    format!("mesh: {vertices} vertices, {faces} faces, {crossing}")
}
