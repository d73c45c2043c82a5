//! The Polygon File Format of Stanford. (`paulbourke.net/dataformats/ply`; read by the `ply-rs-bw` crate.)

use std::path::Path;

use glam::Vec3;
use ply_rs_bw::parser::{ParseError, Parser};
use ply_rs_bw::ply::{Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType};

use super::polygon::triangulate;
use super::problem::Problem;
use super::textured_mesh::{Material, TexturedMesh};
use super::triangle_mesh::Mesh;
use crate::error::{Error, Result};
use crate::files::shortened;
use crate::observation::Observation;

/// Reads ASCII and binary files: positions, normals, colours (whole numbers or fractions), observations and polygons.
pub(super) fn read(path: &Path, bytes: &[u8], _warnings: &mut Vec<String>) -> Result<TexturedMesh> {
    const REMEDY: &str = "Export the mesh again, as PLY with triangles or polygons.";
    let fail = |problem: String| Error::format(path, problem, REMEDY);
    let unsound = |e: ParseError| fail(format!("not a sound PLY file: {}", shortened(&e.to_string())));
    let header = Parser::<Element>::new().read_ply_header(&mut &bytes[..]).map_err(unsound)?;
    check_counts(&header, bytes.len()).map_err(fail)?;
    let ply = Parser::<Element>::new().read_ply(&mut &bytes[..]).map_err(unsound)?;
    let vertex_header = ply.header.elements.get("vertex").ok_or_else(|| fail("there are no vertices".to_owned()))?;
    let has = |names: [&str; 3]| names.iter().all(|n| vertex_header.properties.contains_key(*n));
    if !has(["x", "y", "z"]) {
        return Err(fail("vertices have no x, y, z".to_owned()));
    }
    let elements = |name: &str| ply.payload.get(name).map_or(&[][..], Vec::as_slice);
    let vertices = elements("vertex");
    let has_colors = COLOR_NAMES.iter().any(|names| has(*names));
    let has_observations = OBSERVATION_NAMES.iter().all(|n| vertex_header.properties.contains_key(*n));
    let mut mesh = Mesh {
        vertices: vertices.iter().map(|e| e.position).collect(),
        normals: has(["nx", "ny", "nz"]).then(|| vertices.iter().map(|e| e.normal.normalize_or_zero()).collect()),
        colors: has_colors.then(|| vertices.iter().map(|e| e.color).collect()),
        observations: has_observations.then(|| vertices.iter().map(|e| e.observation).collect()),
        ..Mesh::default()
    };
    for face in elements("face") {
        let corners = &face.corners;
        if let Some(missing) = corners.iter().find(|&&i| i as usize >= vertices.len()) {
            return Err(fail(format!("a face names vertex {missing}, but there are only {}", vertices.len())));
        }
        let outline: Vec<Vec3> = corners.iter().map(|&i| mesh.vertices[i as usize]).collect();
        let triangles = triangulate(&outline).map_err(|problem: Problem| problem.at(path, "", REMEDY))?;
        mesh.faces.extend(triangles.iter().map(|t| t.map(|i| corners[i])));
    }
    let materials = if has_colors { vec![Material::white()] } else { Vec::new() };
    Ok(TexturedMesh { mesh, materials, ..TexturedMesh::default() })
}

/// Refuses counts of elements that the file has no room for: the parser makes elements without properties of nothing.
fn check_counts(header: &Header, length: usize) -> std::result::Result<(), String> {
    let scalar = |kind: &ScalarType| match kind {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    let mut left = length;
    for element in header.elements.values() {
        let binary = element.properties.values().map(|property| match &property.data_type {
            PropertyType::Scalar(kind) => scalar(kind),
            PropertyType::List(count, _) => scalar(count),
        });
        // A line of text at least, or the numbers without what lists hold.
        let size = if header.encoding == Encoding::Ascii { 1 } else { binary.sum::<usize>().max(1) };
        let needed = element.count.checked_mul(size).filter(|&needed| needed <= left);
        left -= needed.ok_or_else(|| {
            let (count, name) = (element.count, shortened(&element.name));
            format!("{count} elements `{name}` of at least {size} bytes cannot be in a file of {length} bytes")
        })?;
    }
    Ok(())
}

/// What programs call the channels of a vertex's colour.
const COLOR_NAMES: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

/// What the parts of an [`Observation`] are called.
const OBSERVATION_NAMES: [&str; 2] = ["confidence", "views"];

/// A vertex or a face: what is not in the file stays zero.
#[derive(Default)]
struct Element {
    position: Vec3,
    normal: Vec3,
    color: [f32; 3],
    observation: Observation,
    corners: Vec<u32>,
}

impl PropertyAccess for Element {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if matches!(name, "vertex_indices" | "vertex_index") {
            let Some(corners) = property.to_u32_list() else { return PropertyAccessResult::UnsupportedType };
            self.corners = corners;
            return PropertyAccessResult::Set;
        }
        let Some(value) = property.to_f32_lossy() else { return PropertyAccessResult::Ignored };
        let full = match property {
            Property::UChar(_) => 255.0,
            Property::UShort(_) => 65535.0,
            _ => 1.0,
        };
        match name {
            "x" => self.position.x = value,
            "y" => self.position.y = value,
            "z" => self.position.z = value,
            "nx" => self.normal.x = value,
            "ny" => self.normal.y = value,
            "nz" => self.normal.z = value,
            "confidence" => self.observation.confidence = value,
            "views" => self.observation.views = value as u16,
            _ => match (0..3).find(|&channel| COLOR_NAMES.iter().any(|names| names[channel] == name)) {
                Some(channel) => self.color[channel] = value / full,
                None => return PropertyAccessResult::Ignored,
            },
        }
        PropertyAccessResult::Set
    }
}

/// The mesh as binary little-endian PLY: positions, normals, colours as bytes, observations, triangles.
pub(super) fn encode(mesh: &Mesh) -> Vec<u8> {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\ncomment dvr\n");
    header += &format!("element vertex {}\n", mesh.vertices.len());
    header += "property float x\nproperty float y\nproperty float z\n";
    if mesh.normals.is_some() {
        header += "property float nx\nproperty float ny\nproperty float nz\n";
    }
    if mesh.colors.is_some() {
        header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    }
    if mesh.observations.is_some() {
        header += "property float confidence\nproperty ushort views\n";
    }
    header += &format!("element face {}\n", mesh.faces.len());
    header += "property list uchar int vertex_indices\nend_header\n";
    let mut bytes = header.into_bytes();
    for (i, vertex) in mesh.vertices.iter().enumerate() {
        let normal = mesh.normals.as_ref().map(|n| n[i]);
        for value in [Some(*vertex), normal].into_iter().flatten().flat_map(|v| v.to_array()) {
            bytes.extend(value.to_le_bytes());
        }
        if let Some(colors) = &mesh.colors {
            bytes.extend(colors[i].map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8));
        }
        if let Some(observations) = &mesh.observations {
            bytes.extend(observations[i].confidence.to_le_bytes());
            bytes.extend(observations[i].views.to_le_bytes());
        }
    }
    for face in &mesh.faces {
        bytes.push(3);
        bytes.extend(face.iter().flat_map(|i| i.to_le_bytes()));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(bytes: &[u8]) -> Result<TexturedMesh> {
        read(Path::new("test.ply"), bytes, &mut Vec::new())
    }

    const HEADER: &str =
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty float z\n";

    #[test]
    fn quads_of_ascii_files_become_triangles_and_colours_are_bytes_or_fractions() {
        for (kind, full) in [("uchar", "255"), ("float", "1.0")] {
            let text = format!(
                "{HEADER}property {kind} red\nproperty {kind} green\nproperty {kind} blue\nelement face 1\n\
                 property list uchar uint vertex_index\nend_header\n\
                 0 0 0 {full} 0 0\n1 0 0 0 0 0\n1 1 0 0 0 0\n0 1 0 0 0 {full}\n4 0 1 2 3\n"
            );
            let mesh = parse(text.as_bytes()).unwrap().mesh;
            assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3]]);
            assert_eq!(mesh.colors.as_ref().unwrap()[3], [0.0, 0.0, 1.0]);
        }
    }

    #[test]
    fn big_endian_files_are_read() {
        let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
            property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
            .to_vec();
        for value in [0.0f32, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.5, 0.0] {
            bytes.extend(value.to_be_bytes());
        }
        bytes.push(3);
        bytes.extend([0i32, 1, 2].iter().flat_map(|i| i.to_be_bytes()));
        let mesh = parse(&bytes).unwrap().mesh;
        assert_eq!(mesh.triangle(0), [Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 0.5, 0.0)]);
        assert!(parse(&bytes[..bytes.len() - 1]).is_err(), "cut short");
    }

    #[test]
    fn faces_without_a_vertex_and_vertices_without_a_place_are_refused() {
        let face = "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
        for corners in ["3 0 1 4", "3 0 1 -1"] {
            assert!(parse(format!("{HEADER}{face}{corners}\n").as_bytes()).is_err(), "{corners}");
        }
        assert!(parse(format!("{HEADER}{face}3 0 1 2\n").as_bytes()).is_ok());
        assert!(parse(b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n").is_err());
        assert!(parse(b"not a ply").is_err());
    }

    #[test]
    fn elements_that_the_file_has_no_room_for_are_refused() {
        for kind in ["ascii", "binary_little_endian"] {
            for element in ["element nothing 18446744073709551615\n", "element vertex 999999999999\nproperty float x\n"]
            {
                let error = parse(format!("ply\nformat {kind} 1.0\n{element}end_header\n").as_bytes()).unwrap_err();
                assert!(error.to_string().contains("cannot be in a file"), "{error}");
            }
        }
    }
}
