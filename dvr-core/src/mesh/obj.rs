//! Wavefront OBJ. (`paulbourke.net/dataformats/obj`; vertex colours after the position are the common extension.)
//!
//! Parsed here rather than by the `tobj` crate: that one cuts a mesh into pieces by material, which loses the order and
//! the sharing of vertices, cannot say in which line a mistake is, and panics on `Kd` with a single value.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::Path;
use std::str::SplitWhitespace;

use glam::{Vec2, Vec3};

use super::mtl::{self, ObjMaterial};
use super::polygon::triangulate;
use super::problem::Problem;
use super::texture_file::{Textures, find_reference};
use super::textured_mesh::{Material, TexturedMesh};
use super::triangle_mesh::Mesh;
use super::uv_vertices::UvVertices;
use crate::files::{read_bytes, shortened};

/// One corner of a face: position, texture coordinate and normal, counted from 0.
type Corner = (usize, Option<usize>, Option<usize>);

/// Reads positions, vertex colours, texture coordinates, normals, faces and materials; lines and points are left out.
///
/// A vertex that is used with several normals (a hard edge) is split, so that each has one.
pub(super) fn read(path: &Path, bytes: &[u8], warnings: &mut Vec<String>) -> crate::Result<TexturedMesh> {
    let mut reader = ObjReader { folder: path.parent().unwrap_or(Path::new("")).to_owned(), ..ObjReader::default() };
    let text = String::from_utf8_lossy(bytes);
    let mut logical = String::new();
    for (number, line) in text.lines().enumerate() {
        // A backslash at the end joins a line to the next.
        if let Some(start) = line.trim_end().strip_suffix('\\') {
            logical.push_str(start);
            logical.push(' ');
            continue;
        }
        logical.push_str(line);
        let place = |problem: Problem| problem.at(path, &format!("line {}: ", number + 1), "Export the mesh again.");
        reader.statement(&logical, warnings).map_err(place)?;
        logical.clear();
    }
    Ok(reader.finish())
}

#[derive(Default)]
struct ObjReader {
    folder: std::path::PathBuf,
    positions: Vec<Vec3>,
    /// As long as the positions where any vertex has a colour, empty otherwise.
    colors: Vec<[f32; 3]>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    triangles: Vec<[Corner; 3]>,
    face_materials: Vec<u32>,
    /// Material 0 is for faces before any `usemtl`, and for names that no library explains.
    materials: Vec<ObjMaterial>,
    material_names: HashMap<String, u32>,
    current_material: u32,
    textures: Textures,
}

impl ObjReader {
    fn statement(&mut self, line: &str, warnings: &mut Vec<String>) -> Result<(), Problem> {
        let line = line.split('#').next().unwrap_or_default().trim();
        let mut words = line.split_whitespace();
        let keyword = words.next().unwrap_or_default();
        let rest = line[keyword.len()..].trim();
        match keyword {
            "v" => self.vertex(words)?,
            "vt" => {
                let [u, v] = numbers(&mut words, "a texture coordinate", 1)?;
                self.uvs.push(Vec2::new(u, v));
            }
            "vn" => self.normals.push(Vec3::from(numbers(&mut words, "a normal", 3)?)),
            "f" | "fo" => self.face(words)?,
            "mtllib" => self.library(rest, warnings),
            "usemtl" => {
                self.current_material = *self.material_names.entry(rest.to_owned()).or_insert_with(|| {
                    warnings.push(format!("material {} is not defined: its faces are grey", shortened(rest)));
                    0
                });
            }
            _ => {}
        }
        Ok(())
    }

    fn vertex(&mut self, words: SplitWhitespace) -> Result<(), String> {
        let values: Vec<f32> = words.map(|w| w.parse().map_err(|_| not_a_number(w))).collect::<Result<_, _>>()?;
        if values.len() < 3 {
            return Err(format!("a vertex has {} coordinates instead of 3", values.len()));
        }
        // `x y z`, with a weight (which only curves use), with a colour, or with both.
        let color = match values.len() {
            6 => Some([values[3], values[4], values[5]]),
            7 => Some([values[4], values[5], values[6]]),
            _ => None,
        };
        if let Some(color) = color {
            self.colors.resize(self.positions.len(), [1.0; 3]);
            self.colors.push(color);
        } else if !self.colors.is_empty() {
            self.colors.push([1.0; 3]);
        }
        self.positions.push(Vec3::new(values[0], values[1], values[2]));
        Ok(())
    }

    fn face(&mut self, words: SplitWhitespace) -> Result<(), Problem> {
        let corners: Vec<Corner> = words.map(|w| self.corner(w)).collect::<Result<_, _>>()?;
        let outline: Vec<Vec3> = corners.iter().map(|c| self.positions[c.0]).collect();
        for triangle in triangulate(&outline)? {
            self.triangles.push(triangle.map(|i| corners[i]));
            self.face_materials.push(self.current_material);
        }
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`; indices count from 1, negative ones backwards from the latest.
    fn corner(&self, word: &str) -> Result<Corner, String> {
        let mut parts = word.split('/');
        let mut index = |count: usize, what: &str| match parts.next() {
            None | Some("") => Ok(None),
            Some(part) => {
                let value: i64 =
                    part.parse().map_err(|_| format!("`{}` is not a corner of a face", shortened(word)))?;
                let zero_based = if value < 0 { (count as i64).saturating_add(value) } else { value - 1 };
                usize::try_from(zero_based)
                    .ok()
                    .filter(|&i| i < count)
                    .map(Some)
                    .ok_or_else(|| format!("a face names {what} {value}, but there are {count} so far"))
            }
        };
        let position =
            index(self.positions.len(), "vertex")?.ok_or_else(|| format!("`{}` names no vertex", shortened(word)))?;
        Ok((position, index(self.uvs.len(), "texture coordinate")?, index(self.normals.len(), "normal")?))
    }

    fn library(&mut self, names: &str, warnings: &mut Vec<String>) {
        // One name with spaces, or several names.
        let paths: Vec<_> = match find_reference(&self.folder, names) {
            Some(path) => vec![path],
            None => names.split_whitespace().filter_map(|name| find_reference(&self.folder, name)).collect(),
        };
        if paths.is_empty() {
            warnings.push(format!("material library {} is not there: faces are grey", shortened(names)));
        }
        for path in paths {
            match read_bytes(&path) {
                Ok(bytes) => {
                    for (name, material) in mtl::read(&self.folder, &bytes, &mut self.textures, warnings) {
                        if self.materials.is_empty() {
                            self.materials.push(ObjMaterial::default());
                        }
                        self.material_names.insert(name, self.materials.len() as u32);
                        self.materials.push(material);
                    }
                }
                Err(problem) => warnings.push(format!("{problem}: faces are grey")),
            }
        }
    }

    fn finish(mut self) -> TexturedMesh {
        let vertex_colors = !self.colors.is_empty();
        if self.colors.iter().flatten().any(|&c| c > 1.0) {
            // Some writers give bytes.
            self.colors.iter_mut().flatten().for_each(|c| *c /= 255.0);
        }
        let has_uvs = self.triangles.iter().flatten().any(|c| c.1.is_some());
        let has_normals = self.triangles.iter().flatten().any(|c| c.2.is_some());
        let corner_uvs = if has_uvs { self.corner_uvs() } else { Vec::new() };
        let mut mesh = Mesh {
            vertices: std::mem::take(&mut self.positions),
            colors: vertex_colors.then(|| std::mem::take(&mut self.colors)),
            ..Mesh::default()
        };
        if has_normals {
            split_by_normal(&mut mesh, &self.triangles, &self.normals);
        } else {
            mesh.faces = self.triangles.iter().map(|t| t.map(|c| c.0 as u32)).collect();
        }
        let mut materials: Vec<Material> = self.materials.into_iter().map(|m| m.material).collect();
        if vertex_colors && materials.is_empty() {
            materials.push(Material::white());
        } else if vertex_colors {
            materials[0] = Material::white();
        }
        let face_materials = if materials.len() > 1 { self.face_materials } else { Vec::new() };
        TexturedMesh { mesh, corner_uvs, face_materials, materials, normal_map: None }
    }

    fn corner_uvs(&self) -> Vec<[Vec2; 3]> {
        let faces = self.triangles.iter().zip(&self.face_materials);
        faces
            .map(|(triangle, &material)| {
                let material = self.materials.get(material as usize);
                triangle.map(|corner| {
                    let uv = corner.1.map_or(Vec2::ZERO, |i| self.uvs[i]);
                    material.map_or(uv, |m| uv * m.uv_scale + m.uv_offset)
                })
            })
            .collect()
    }
}

/// Gives every vertex one normal: further ones get a copy of the vertex, after all the others.
fn split_by_normal(mesh: &mut Mesh, triangles: &[[Corner; 3]], file_normals: &[Vec3]) {
    let mut first: Vec<Option<Vec3>> = vec![None; mesh.vertices.len()];
    let mut copies: HashMap<(usize, [u32; 3]), u32> = HashMap::new();
    let mut normals: Vec<Vec3> = Vec::new();
    for triangle in triangles {
        let [a, b, c] = triangle.map(|corner| mesh.vertices[corner.0]);
        let face_normal = (b - a).cross(c - a).normalize_or_zero();
        let face = triangle.map(|(vertex, _, normal)| {
            let normal = normal.map_or(face_normal, |i| file_normals[i]).normalize_or(face_normal);
            if *first[vertex].get_or_insert(normal) == normal {
                return vertex as u32;
            }
            *copies.entry((vertex, normal.to_array().map(f32::to_bits))).or_insert_with(|| {
                mesh.vertices.push(mesh.vertices[vertex]);
                if let Some(colors) = &mut mesh.colors {
                    colors.push(colors[vertex]);
                }
                normals.push(normal);
                (mesh.vertices.len() - 1) as u32
            })
        });
        mesh.faces.push(face);
    }
    let unused = Vec3::ZERO;
    let of_file = first.into_iter().map(|normal| normal.unwrap_or(unused));
    mesh.normals = Some(of_file.chain(normals).collect());
}

/// At least `required` numbers of a line; those that are left out are 0.
fn numbers<const N: usize>(words: &mut SplitWhitespace, what: &str, required: usize) -> Result<[f32; N], String> {
    let mut values = [0.0; N];
    for (i, value) in values.iter_mut().enumerate() {
        *value = match words.next() {
            Some(word) => word.parse().map_err(|_| not_a_number(word))?,
            None if i >= required => 0.0,
            None => return Err(format!("{what} has {i} values instead of {N}")),
        };
    }
    Ok(values)
}

fn not_a_number(word: &str) -> String {
    format!("`{}` is not a number", shortened(word))
}

/// The mesh as OBJ text; normals belong to the vertices, so each index serves both.
pub(super) fn encode(mesh: &Mesh) -> Vec<u8> {
    let mut text = vertices(mesh);
    for face in &mesh.faces {
        let [a, b, c] = face.map(|i| u64::from(i) + 1);
        let _ = match mesh.normals {
            Some(_) => writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}"),
            None => writeln!(text, "f {a} {b} {c}"),
        };
    }
    text.into_bytes()
}

/// The mesh with the texture coordinates of its split form, and one material of a library beside the file.
pub(super) fn encode_textured(mesh: &Mesh, split: &UvVertices, library: &str, material: &str) -> Vec<u8> {
    let mut text = vertices(mesh);
    for uv in &split.uvs {
        let _ = writeln!(text, "vt {} {}", uv.x, uv.y);
    }
    let _ = writeln!(text, "mtllib {library}\nusemtl {material}");
    for (face, uvs) in mesh.faces.iter().zip(&split.mesh.faces) {
        let corner = |k: usize| {
            let (vertex, uv) = (u64::from(face[k]) + 1, u64::from(uvs[k]) + 1);
            if mesh.normals.is_some() { format!("{vertex}/{uv}/{vertex}") } else { format!("{vertex}/{uv}") }
        };
        let _ = writeln!(text, "f {} {} {}", corner(0), corner(1), corner(2));
    }
    text.into_bytes()
}

/// Positions, with colours where there are any, and normals.
fn vertices(mesh: &Mesh) -> String {
    let mut text = String::from("# dvr\n");
    // Writing to a string cannot fail.
    for (i, v) in mesh.vertices.iter().enumerate() {
        let _ = match mesh.colors.as_ref().map(|c| c[i]) {
            Some([r, g, b]) => writeln!(text, "v {} {} {} {r} {g} {b}", v.x, v.y, v.z),
            None => writeln!(text, "v {} {} {}", v.x, v.y, v.z),
        };
    }
    for n in mesh.normals.iter().flatten() {
        let _ = writeln!(text, "vn {} {} {}", n.x, n.y, n.z);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> crate::Result<TexturedMesh> {
        read(Path::new("test.obj"), text.as_bytes(), &mut Vec::new())
    }

    #[test]
    fn indices_count_from_one_and_backwards_from_the_latest() {
        let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
        let forward = parse(&format!("{square}f 1 2 3 4\n")).unwrap();
        let backward = parse(&format!("{square}f -4 -3 -2 \\\n -1 # a remark\r\n")).unwrap();
        assert_eq!(forward.mesh.faces.len(), 2);
        assert_eq!(forward, backward);
    }

    #[test]
    fn a_face_that_names_a_missing_vertex_is_refused_with_its_line() {
        for index in ["4", "0", "-4", "99999999999999999999", "x"] {
            let error = parse(&format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {index}\n")).unwrap_err().to_string();
            assert!(error.contains("test.obj: line 4"), "{error}");
        }
    }

    #[test]
    fn a_vertex_with_two_normals_becomes_two() {
        let mesh =
            parse("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nvn 0 -2 0\nf 1//1 2//1 3//1\nf 1//2 4//2 2//2\n")
                .unwrap()
                .mesh;
        assert_eq!(mesh.vertices.len(), 6);
        let normals = mesh.normals.as_ref().unwrap();
        assert!(mesh.faces[0].iter().all(|&v| normals[v as usize] == Vec3::Z));
        assert!(mesh.faces[1].iter().all(|&v| normals[v as usize] == Vec3::NEG_Y));
        assert_eq!(mesh.triangle(1), [Vec3::ZERO, Vec3::Z, Vec3::X]);
    }

    #[test]
    fn colours_may_be_bytes_and_may_be_missing() {
        let mesh = parse("v 0 0 0\nv 1 0 0 255 0 51\nv 0 1 0\nf 1 2 3\n").unwrap();
        assert_eq!(mesh.mesh.colors.unwrap()[1], [1.0, 0.0, 0.2]);
        assert_eq!(mesh.materials, [Material::white()]);
    }
}
