//! The Object File Format of Geomview: `OFF`, with colours (`COFF`), normals (`NOFF`) and texture coordinates
//! (`STOFF`). (`www.geomview.org/docs/html/OFF.html`; ASCII only. ModelNet's files, which join the header and the
//! counts, are read.)

use std::path::Path;

use glam::Vec3;

use super::polygon::triangulate;
use super::problem::Problem;
use super::textured_mesh::{Material, TexturedMesh};
use super::triangle_mesh::Mesh;
use crate::files::shortened;

/// Reads positions, faces, and per-vertex normals and colours. Colours of faces are left out.
pub(super) fn read(path: &Path, bytes: &[u8], _warnings: &mut Vec<String>) -> crate::Result<TexturedMesh> {
    let text = String::from_utf8_lossy(bytes);
    parse(&text).map_err(|problem| problem.at(path, "", "Export the mesh again, as ASCII OFF, PLY or OBJ."))
}

fn parse(text: &str) -> Result<TexturedMesh, Problem> {
    let mut lines = text.lines().map(|l| l.split('#').next().unwrap_or_default().trim()).filter(|l| !l.is_empty());
    let first = lines.next().ok_or("the file is empty".to_owned())?;
    // "OFF", and in some collections the counts right behind it.
    let (letters, joined) =
        first.split_at(first.find("OFF").ok_or_else(|| format!("`{}` is not an OFF header", shortened(first)))? + 3);
    if letters.contains('4') || letters.contains('n') || joined.contains("BINARY") {
        return Err(format!("`{}` is a variant of OFF that is not read", shortened(first)).into());
    }
    let counts =
        if joined.trim().is_empty() { lines.next().ok_or("the counts are missing".to_owned())? } else { joined.trim() };
    let counts = integers(counts)?;
    let [vertex_count, face_count, ..] = counts[..] else {
        return Err("the counts are missing".to_owned().into());
    };
    let (has_normals, has_colors) = (letters.contains('N'), letters.starts_with('C') || letters.starts_with("STC"));
    let mut mesh = Mesh { normals: has_normals.then(Vec::new), colors: has_colors.then(Vec::new), ..Mesh::default() };
    for index in 0..vertex_count {
        let line = lines.next().ok_or_else(|| format!("only {index} of {vertex_count} vertices are there"))?;
        vertex(&mut mesh, line)?;
    }
    if let Some(colors) = &mut mesh.colors
        && colors.iter().flatten().any(|&c| c > 1.0)
    {
        // Whole numbers up to 255 or fractions: a file has only one of them.
        colors.iter_mut().flatten().for_each(|c| *c /= 255.0);
    }
    for index in 0..face_count {
        let line = lines.next().ok_or_else(|| format!("only {index} of {face_count} faces are there"))?;
        face(&mut mesh, line)?;
    }
    let materials = if has_colors { vec![Material::white()] } else { Vec::new() };
    Ok(TexturedMesh { mesh, materials, ..TexturedMesh::default() })
}

/// `x y z [nx ny nz] [r g b [a]]`.
fn vertex(mesh: &mut Mesh, line: &str) -> Result<(), String> {
    let values: Vec<f32> = line
        .split_whitespace()
        .map(|w| w.parse().map_err(|_| format!("`{}` in `{}` is not a number", shortened(w), shortened(line))))
        .collect::<Result<_, _>>()?;
    let mut triples = values.chunks_exact(3).map(|c| [c[0], c[1], c[2]]);
    let mut next = || triples.next().ok_or_else(|| format!("`{}` has too few numbers for a vertex", shortened(line)));
    mesh.vertices.push(Vec3::from(next()?));
    if let Some(normals) = &mut mesh.normals {
        normals.push(Vec3::from(next()?).normalize_or_zero());
    }
    if let Some(colors) = &mut mesh.colors {
        colors.push(next()?);
    }
    Ok(())
}

/// `n i1 ... in [colour]`.
fn face(mesh: &mut Mesh, line: &str) -> Result<(), Problem> {
    let mut words = line.split_whitespace();
    let count: usize =
        words.next().and_then(|w| w.parse().ok()).ok_or_else(|| format!("`{}` is not a face", shortened(line)))?;
    let corners = integers(&words.take(count).collect::<Vec<_>>().join(" "))?;
    if corners.len() != count {
        return Err(format!("`{}` names {} corners instead of {count}", shortened(line), corners.len()).into());
    }
    if let Some(missing) = corners.iter().find(|&&i| i >= mesh.vertices.len()) {
        return Err(format!("a face names vertex {missing}, but there are only {}", mesh.vertices.len()).into());
    }
    let outline: Vec<Vec3> = corners.iter().map(|&i| mesh.vertices[i]).collect();
    mesh.faces.extend(triangulate(&outline)?.iter().map(|t| t.map(|i| corners[i] as u32)));
    Ok(())
}

fn integers(line: &str) -> Result<Vec<usize>, String> {
    line.split_whitespace()
        .map(|w| w.parse().map_err(|_| format!("`{}` in `{}` is not a whole number", shortened(w), shortened(line))))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_comments_and_joined_headers_are_read() {
        let plain = "OFF # a pyramid\n5 5 0\n\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n.5 .5 1\n4 3 2 1 0\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4 255 0 0\n";
        let mesh = parse(plain).unwrap();
        assert_eq!((mesh.mesh.vertices.len(), mesh.mesh.faces.len()), (5, 6));
        assert_eq!(parse(&plain.replace("OFF # a pyramid\n5", "OFF5")).unwrap(), mesh);
    }

    #[test]
    fn colours_of_vertices_are_read_as_bytes_or_fractions() {
        let bytes = parse("COFF\n3 1 0\n0 0 0 255 0 51 255\n1 0 0 0 0 0 255\n0 1 0 0 0 0 255\n3 0 1 2\n").unwrap();
        let fractions = parse("COFF\n3 1 0\n0 0 0 1 0 .2 1\n1 0 0 0 0 0 1\n0 1 0 0 0 0 1\n3 0 1 2\n").unwrap();
        assert_eq!(bytes.mesh.colors.as_ref().unwrap()[0], [1.0, 0.0, 0.2]);
        assert_eq!(bytes, fractions);
    }

    #[test]
    fn what_is_cut_short_or_out_of_range_is_refused() {
        for text in
            ["", "PLY\n", "OFF\n", "OFF\n3 1 0\n0 0 0\n", "OFF\n1 1 0\n0 0 0\n3 0 0 1\n", "OFF\n1 1 0\n0 0 0\n3 0 0\n"]
        {
            assert!(parse(text).is_err(), "{text}");
        }
    }
}
