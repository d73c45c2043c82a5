//! Writing binary glTF 2.0. (`registry.khronos.org/glTF/specs/2.0/glTF-2.0.html`; reading is in `gltf.rs`.)

use glam::{Vec2, Vec3, Vec4};
use serde_json::{Value, json};

use super::GENERATOR;
use super::glb_buffer::{GlbBuffer, container};
use super::triangle_mesh::Mesh;
use super::uv_vertices::UvVertices;
use super::write_textured::{Look, MeshStyle, StoredTexture, TEXTURED};
use crate::srgb::srgb_to_linear;

/// The mesh as a GLB with one rough, two-sided material; vertex colours are stored linear, as glTF defines `COLOR_0`.
///
/// Observations become the application-specific attributes `_CONFIDENCE` and `_VIEWS` (section 3.7.2.1). The number of
/// views is a float as well: unsigned integers of 32 bits are for indices alone, and shorter ones would break the
/// alignment to four bytes.
///
/// Node and mesh get `name`, by which other programs show them. A mesh without faces gives a valid file without a scene.
pub(super) fn encode(mesh: &Mesh, name: &str, is_compressed: bool) -> Vec<u8> {
    if mesh.is_empty() {
        return container(root().to_string().into_bytes(), Vec::new());
    }
    let mut file = GlbBuffer::new(is_compressed);
    let ordered;
    let mesh = if is_compressed {
        ordered = mesh.in_drawing_order().0;
        &ordered
    } else {
        mesh
    };
    let attributes = attributes(&mut file, mesh);
    finished(file, mesh, name, attributes, rough_material(VERTEX_COLORS), root())
}

/// A normal map with its tangents, one per vertex.
pub(super) struct StoredNormals<'a> {
    pub tangents: &'a [Vec4],
    pub texture: StoredTexture,
}

/// A mesh with one texture as a GLB: vertices as [`UvVertices`] has them, the pictures inside the file as they are given.
/// [`Look::Baked`] adds `KHR_materials_unlit`: what photographs show is lit already. Compressed, vertices and faces are in
/// another order, and numbers rounded.
pub(super) fn encode_textured(
    split: &UvVertices,
    texture: &StoredTexture,
    normals: Option<&StoredNormals>,
    style: MeshStyle,
    name: &str,
) -> Vec<u8> {
    let mut file = GlbBuffer::new(style.is_compressed);
    let mut root = root();
    let all = || (0..split.uvs.len()).collect();
    let (mesh, order) = if style.is_compressed { split.mesh.in_drawing_order() } else { (split.mesh.clone(), all()) };
    let mut attributes = attributes(&mut file, &mesh);
    let uvs: Vec<Vec2> = order.iter().map(|&vertex| split.uvs[vertex]).collect();
    attributes["TEXCOORD_0"] = file.uvs(&uvs).into();
    let mut material = rough_material(TEXTURED);
    let (mut images, mut textures) = (Vec::new(), Vec::new());
    let mut add = |file: &mut GlbBuffer, picture: &StoredTexture, name: &str| {
        let view = file.file(picture.bytes.iter().copied());
        images.push(json!({ "bufferView": view, "mimeType": picture.mime_type, "name": name }));
        textures.push(json!({ "source": images.len() - 1, "sampler": 0 }));
        json!({ "index": textures.len() - 1 })
    };
    material["pbrMetallicRoughness"]["baseColorTexture"] = add(&mut file, texture, "base_color");
    if let Some(normals) = normals {
        material["normalTexture"] = add(&mut file, &normals.texture, "normal_map");
        let tangents: Vec<Vec4> = order.iter().map(|&vertex| normals.tangents[vertex]).collect();
        attributes["TANGENT"] = file.tangents(&tangents).into();
    }
    root["images"] = images.into();
    root["samplers"] =
        json!([{ "magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": CLAMP, "wrapT": CLAMP }]);
    root["textures"] = textures.into();
    if style.look == Look::Baked {
        material["extensions"] = json!({ "KHR_materials_unlit": {} });
        root["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    }
    finished(file, &mesh, name, attributes, material, root)
}

/// The material of a mesh with colours in its vertices.
const VERTEX_COLORS: &str = "vertex_colors";

// Names of the specification's numbers (section 5.26).
const LINEAR: u32 = 9729;
const LINEAR_MIPMAP_LINEAR: u32 = 9987;
const CLAMP: u32 = 33071;

fn root() -> Value {
    json!({ "asset": { "version": "2.0", "generator": GENERATOR } })
}

fn rough_material(name: &str) -> Value {
    let rough = json!({ "metallicFactor": 0.0, "roughnessFactor": 1.0 });
    json!({ "name": name, "doubleSided": true, "pbrMetallicRoughness": rough })
}

/// What is known per vertex.
fn attributes(file: &mut GlbBuffer, mesh: &Mesh) -> Value {
    let mut attributes = json!({ "POSITION": file.positions(&mesh.vertices) });
    if let Some(normals) = &mesh.normals {
        // The specification wants unit length, also where a vertex has no normal.
        let unit: Vec<Vec3> = normals.iter().map(|n| n.normalize_or(Vec3::Y)).collect();
        attributes["NORMAL"] = file.normals(&unit).into();
    }
    if let Some(colors) = &mesh.colors {
        let linear = colors.iter().map(|color| color.map(|c| srgb_to_linear(c.clamp(0.0, 1.0))));
        attributes["COLOR_0"] = file.colors(&linear.collect::<Vec<_>>()).into();
    }
    if let Some(observations) = &mesh.observations {
        let confidence = observations.iter().map(|observation| observation.confidence);
        attributes["_CONFIDENCE"] = file.scalars(confidence).into();
        let views = observations.iter().map(|observation| f32::from(observation.views));
        attributes["_VIEWS"] = file.scalars(views).into();
    }
    attributes
}

/// The file of one mesh with one material.
fn finished(
    mut file: GlbBuffer,
    mesh: &Mesh,
    name: &str,
    attributes: Value,
    material: Value,
    mut root: Value,
) -> Vec<u8> {
    let indices = file.indices(&mesh.faces, mesh.vertices.len());
    root["scene"] = 0.into();
    root["scenes"] = json!([{ "nodes": [0] }]);
    root["nodes"] = json!([{ "mesh": 0, "name": name }]);
    let primitive = json!({ "attributes": attributes, "indices": indices, "material": 0 });
    root["meshes"] = json!([{ "name": name, "primitives": [primitive] }]);
    root["materials"] = json!([material]);
    let bytes = file.describe(&mut root);
    container(root.to_string().into_bytes(), bytes)
}
