//! Mesh files: which format a path means, and what every reader checks before it hands a mesh out.

use std::path::Path;

use super::textured_mesh::TexturedMesh;
use super::triangle_mesh::Mesh;
use super::write_textured::Look;
use super::{glb, gltf, obj, off, ply, usdz};
use crate::error::Error;
use crate::files::{read_bytes, write_bytes_atomically};

/// Reads a mesh: Wavefront OBJ with its MTL and textures, PLY, OFF, glTF or GLB, by the path's extension.
///
/// Polygons are cut into triangles. Positions are single precision: at a million units from the origin they are exact
/// to about a sixteenth of a unit, so models in geographic coordinates should be moved to the origin before. What could
/// not be read but does not matter for the shape (a missing texture, say) is left out; [`read_mesh_with_warnings`]
/// says so.
///
/// # Errors
/// When the file cannot be read, its format is not known or not kept, a face names a vertex that is not there, a
/// vertex is not finite, or a limit of [`files::limits`](crate::files::limits) is passed.
pub fn read_mesh(path: impl AsRef<Path>) -> crate::Result<TexturedMesh> {
    read_mesh_with_warnings(path, &mut Vec::new())
}

/// [`read_mesh`], which also says in plain words what had to be left out.
///
/// # Errors
/// As [`read_mesh`].
pub fn read_mesh_with_warnings(path: impl AsRef<Path>, warnings: &mut Vec<String>) -> crate::Result<TexturedMesh> {
    let path = path.as_ref();
    let read = match extension(path).as_str() {
        "obj" => obj::read,
        "ply" => ply::read,
        "off" | "coff" | "noff" => off::read,
        "glb" | "gltf" => gltf::read,
        other => return Err(unknown_format(path, other, "OBJ, PLY, OFF, GLB or glTF")),
    };
    let bytes = read_bytes(path)?;
    let mesh = read(path, &bytes, warnings)?;
    check(path, &mesh.mesh)?;
    Ok(mesh)
}

/// Writes a mesh with its normals, colours and observations as OBJ, PLY (binary), GLB or USDZ, by the path's extension.
///
/// Colours are stored per vertex: OBJ as `v x y z r g b`, PLY as bytes, GLB as `COLOR_0` and USDZ as `displayColor`, both
/// linear. OBJ and USDZ have no place for observations; PLY calls them `confidence` and `views`, GLB `_CONFIDENCE` and `_VIEWS`. The file
/// appears whole or not at all.
///
/// # Errors
/// When the extension is none of these, or the file cannot be written.
pub fn write_mesh(path: impl AsRef<Path>, mesh: &Mesh) -> crate::Result<()> {
    let path = path.as_ref();
    let bytes = match extension(path).as_str() {
        "obj" => obj::encode(mesh),
        "ply" => ply::encode(mesh),
        "glb" => glb::encode(mesh, &stem(path), false),
        "usdz" => usdz::encode(path, mesh, &usdz::Cover::Vertices, Look::Material)?,
        other => return Err(unknown_format(path, other, WRITTEN)),
    };
    write_bytes_atomically(path, &bytes)
}

/// Refuses a path whose extension is no format in which meshes are written, before any work is done for it.
///
/// # Errors
/// When the extension is not that of an OBJ, PLY, GLB or USDZ.
pub fn check_mesh_format(path: impl AsRef<Path>) -> crate::Result<()> {
    match extension(path.as_ref()).as_str() {
        "obj" | "ply" | "glb" | "usdz" => Ok(()),
        other => Err(unknown_format(path.as_ref(), other, WRITTEN)),
    }
}

/// The formats of meshes that are written.
const WRITTEN: &str = ".obj, .ply, .glb or .usdz";

pub(super) fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// The name of the file without its extension, which names the mesh inside.
pub(super) fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

pub(super) fn unknown_format(path: &Path, extension: &str, known: &str) -> Error {
    Error::format(path, format!("`{extension}` is not a mesh format that is known here"), format!("Use {known}."))
}

/// What no reader may hand out: it would be an index out of bounds or a NaN somewhere else.
fn check(path: &Path, mesh: &Mesh) -> crate::Result<()> {
    let count = mesh.vertices.len();
    if let Some((face, index)) =
        mesh.faces.iter().enumerate().find_map(|(f, face)| Some((f, *face.iter().find(|i| **i as usize >= count)?)))
    {
        let problem = format!("face {face} names vertex {index}, but there are only {count} (counted from 0)");
        return Err(Error::format(path, problem, "Export the mesh again."));
    }
    if let Some(vertex) = mesh.vertices.iter().position(|v| !v.is_finite()) {
        let problem = format!("vertex {vertex} (counted from 0) is {}", mesh.vertices[vertex]);
        return Err(Error::format(path, problem, "Remove vertices with NaN or infinite coordinates."));
    }
    Ok(())
}
