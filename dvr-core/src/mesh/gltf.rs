//! Reading glTF 2.0, text and binary. (`registry.khronos.org/glTF/specs/2.0/glTF-2.0.html`; parsed by the `gltf`
//! crate.)

use std::path::Path;

use ::gltf::mesh::Mode;
use ::gltf::{Document, Gltf, Node, Primitive, Semantic};
use glam::{Mat3, Mat4, Vec2, Vec3};

use super::accessor::{self, GltfBuffers};
use super::gltf_material::{UvTransform, read_materials, uv_transform};
use super::meshopt_views::is_known;
use super::textured_mesh::TexturedMesh;
use crate::error::Error;
use crate::files::check_limit;
use crate::files::limits::SHARED_ELEMENTS;
use crate::srgb::linear_to_srgb;

/// The extension by which geometry is compressed with Draco.
const DRACO: &str = "KHR_draco_mesh_compression";

/// Reads the default scene: node transforms, triangles, normals, vertex colours, base colours and base colour textures.
///
/// Skins and morph targets stay in their rest pose; points and lines are left out.
pub(super) fn read(path: &Path, bytes: &[u8], warnings: &mut Vec<String>) -> crate::Result<TexturedMesh> {
    let fail = |problem: String| Error::format(path, problem, "Export the model again, as glTF 2.0 with triangles.");
    if let Some(length) = bytes.strip_prefix(b"glTF").map(|rest| rest.get(4..8).unwrap_or_default()) {
        let stated = length.try_into().map_or(0, u32::from_le_bytes) as usize;
        if !(20..=bytes.len()).contains(&stated) {
            return Err(fail(format!("the file has {} bytes and says that it has {stated}", bytes.len())));
        }
    }
    let parsed = Gltf::from_slice_without_validation(bytes).map_err(|e| fail(format!("not sound glTF: {e}")))?;
    let blob = parsed.blob;
    let document = validated(path, parsed.document, warnings)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let buffers = GltfBuffers::load(&document, folder, blob).map_err(fail)?;
    let mut reader = GltfReader {
        uv_transforms: document.materials().map(|m| uv_transform(&m)).collect(),
        buffers: &buffers,
        textured: TexturedMesh { materials: read_materials(&document, &buffers, warnings), ..TexturedMesh::default() },
    };
    let placed = placed_meshes(&document).map_err(fail)?;
    // Nodes may share meshes: what they make together is counted before any of it is made.
    let sizes: Vec<[u64; 3]> = document.meshes().map(|mesh| size_of(&mesh)).collect();
    let limit = SHARED_ELEMENTS.max(buffers.length() as u64);
    let names = ["the number of primitives", "the number of vertices", "the number of triangles"];
    for (i, name) in names.into_iter().enumerate() {
        let count = placed.iter().fold(0u64, |sum, (mesh, _)| sum.saturating_add(sizes[mesh.index()][i]));
        check_limit(path, name, count, limit)?;
    }
    for (mesh, to_scene) in placed {
        for primitive in mesh.primitives() {
            reader.primitive(&primitive, to_scene).map_err(fail)?;
        }
    }
    Ok(reader.textured)
}

/// The meshes of the default scene, as often as nodes have them, each with its way to the scene.
fn placed_meshes(document: &Document) -> Result<Vec<(::gltf::Mesh<'_>, Mat4)>, String> {
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let roots: Vec<Node> = scene.map_or_else(Vec::new, |s| s.nodes().collect());
    // A tree has no more nodes than the document, so more mean a circle.
    let mut left = document.nodes().count();
    let mut take = |nodes: usize| {
        left.checked_sub(nodes).map(|rest| left = rest).ok_or("a node is its own descendant, or has two parents")
    };
    take(roots.len())?;
    let mut stack: Vec<(Node, Mat4)> = roots.into_iter().rev().map(|node| (node, Mat4::IDENTITY)).collect();
    let mut placed = Vec::new();
    while let Some((node, parent)) = stack.pop() {
        take(node.children().len())?;
        let to_scene = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
        placed.extend(node.mesh().map(|mesh| (mesh, to_scene)));
        stack.extend(node.children().map(|child| (child, to_scene)));
    }
    Ok(placed)
}

/// Primitives, vertices and triangles of a mesh, as its accessors state them.
fn size_of(mesh: &::gltf::Mesh) -> [u64; 3] {
    mesh.primitives().fold([0; 3], |[primitives, vertices, triangles], primitive| {
        let of_vertices = primitive.get(&Semantic::Positions).map_or(0, |accessor| accessor.count() as u64);
        let corners = primitive.indices().map_or(of_vertices, |accessor| accessor.count() as u64);
        let of_triangles = if primitive.mode() == Mode::Triangles { corners / 3 } else { corners };
        [primitives + 1, vertices.saturating_add(of_vertices), triangles.saturating_add(of_triangles)]
    })
}

/// The document, checked by the `gltf` crate. Required extensions that only change the looks are reported and passed over.
fn validated(path: &Path, document: Document, warnings: &mut Vec<String>) -> crate::Result<Document> {
    let mut root = document.into_json();
    for extension in std::mem::take(&mut root.extensions_required) {
        if extension == DRACO {
            let problem = format!("the geometry is compressed with Draco ({extension}), which is not read");
            return Err(Error::format(path, problem, "Export the model without mesh compression."));
        }
        let harmless = extension.starts_with("KHR_materials_") || extension.contains("_texture_");
        if harmless {
            warnings.push(format!("the file asks for {extension}, which may look different here"));
        } else if extension != "KHR_mesh_quantization" && extension != "KHR_lights_punctual" && !is_known(&extension) {
            let problem = format!("the file requires {extension}, which is not read");
            return Err(Error::format(path, problem, "Export the model without this extension."));
        }
    }
    check_accessors(&root).map_err(|problem| Error::format(path, problem, "Export the model again, as glTF 2.0."))?;
    Document::from_json(root)
        .map_err(|e| Error::format(path, format!("not valid glTF: {e}"), "Export the model again, as glTF 2.0."))
}

/// Refuses primitives whose accessors are not there: the `gltf` crate looks them up while it checks the document.
fn check_accessors(root: &::gltf::json::Root) -> Result<(), String> {
    let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let mut used = primitives.flat_map(|primitive| primitive.attributes.values());
    match used.find(|index| index.value() >= root.accessors.len()) {
        Some(missing) => Err(format!("accessor {} is used, and there are {}", missing.value(), root.accessors.len())),
        None => Ok(()),
    }
}

struct GltfReader<'a> {
    uv_transforms: Vec<UvTransform>,
    buffers: &'a GltfBuffers,
    textured: TexturedMesh,
}

impl GltfReader<'_> {
    fn primitive(&mut self, primitive: &Primitive, to_scene: Mat4) -> Result<(), String> {
        let Some(position) = primitive.get(&Semantic::Positions) else { return Ok(()) };
        let positions = accessor::vectors::<3>(&position, self.buffers)?;
        let order = match primitive.indices() {
            Some(indices) => accessor::indices(&indices, self.buffers)?,
            None => (0..positions.len() as u32).collect(),
        };
        let mut faces = triangles(primitive.mode(), &order);
        if let Some(missing) = faces.iter().flatten().find(|&&i| i as usize >= positions.len()) {
            return Err(format!("a face names vertex {missing}, but there are only {}", positions.len()));
        }
        let linear = Mat3::from_mat4(to_scene);
        if linear.determinant() < 0.0 {
            // A mirrored node turns its faces inside out.
            faces.iter_mut().for_each(|face| face.swap(1, 2));
        }
        let material = primitive.material().index().unwrap_or(self.textured.materials.len() - 1);
        self.append_uvs(primitive, &faces, material, positions.len())?;
        self.append_normals(primitive, linear, positions.len())?;
        self.append_colors(primitive, positions.len())?;
        let mesh = &mut self.textured.mesh;
        let base = mesh.vertices.len() as u32;
        mesh.vertices.extend(positions.iter().map(|&p| to_scene.transform_point3(p.into())));
        mesh.faces.extend(faces.iter().map(|face| face.map(|i| base + i)));
        self.textured.face_materials.resize(mesh.faces.len(), material as u32);
        Ok(())
    }

    /// A vertex attribute as wide as the positions, or `None` where the primitive does not have it.
    fn attribute<const N: usize>(
        &self,
        primitive: &Primitive,
        semantic: &Semantic,
        count: usize,
    ) -> Result<Option<Vec<[f32; N]>>, String> {
        let Some(accessor) = primitive.get(semantic) else { return Ok(None) };
        let values = accessor::vectors::<N>(&accessor, self.buffers)?;
        match values.len() {
            n if n == count => Ok(Some(values)),
            n => Err(format!("{count} positions have {n} values of {}", semantic.to_string())),
        }
    }

    fn append_uvs(
        &mut self,
        primitive: &Primitive,
        faces: &[[u32; 3]],
        material: usize,
        count: usize,
    ) -> Result<(), String> {
        let transform = self.uv_transforms.get(material).copied().unwrap_or_default();
        let before = self.textured.mesh.faces.len();
        if let Some(uvs) = self.attribute::<2>(primitive, &Semantic::TexCoords(transform.set), count)? {
            self.textured.corner_uvs.resize(before, [Vec2::ZERO; 3]);
            let corner = |i: u32| {
                let uv = transform.apply(Vec2::from(uvs[i as usize]));
                // glTF counts from the top left of the texture.
                Vec2::new(uv.x, 1.0 - uv.y)
            };
            self.textured.corner_uvs.extend(faces.iter().map(|face| face.map(corner)));
        } else if !self.textured.corner_uvs.is_empty() {
            self.textured.corner_uvs.resize(before + faces.len(), [Vec2::ZERO; 3]);
        }
        Ok(())
    }

    fn append_normals(&mut self, primitive: &Primitive, linear: Mat3, count: usize) -> Result<(), String> {
        let values = self.attribute::<3>(primitive, &Semantic::Normals, count)?;
        // The inverse transpose, up to a positive factor that normalising takes away; it exists for flat nodes too.
        let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
        let cofactors = Mat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * linear.determinant().signum();
        append(&mut self.textured.mesh.normals, self.textured.mesh.vertices.len(), count, Vec3::ZERO, values, |n| {
            (cofactors * Vec3::from(n)).normalize_or_zero()
        });
        Ok(())
    }

    fn append_colors(&mut self, primitive: &Primitive, count: usize) -> Result<(), String> {
        let values = self.attribute::<3>(primitive, &Semantic::Colors(0), count)?;
        append(&mut self.textured.mesh.colors, self.textured.mesh.vertices.len(), count, [1.0; 3], values, |c| {
            c.map(|x| linear_to_srgb(x.clamp(0.0, 1.0)))
        });
        Ok(())
    }
}

/// Lengthens an optional per-vertex list by `count`; vertices of primitives without the attribute get `filler`.
fn append<T: Clone, V>(
    list: &mut Option<Vec<T>>,
    before: usize,
    count: usize,
    filler: T,
    values: Option<Vec<V>>,
    convert: impl Fn(V) -> T,
) {
    if let Some(values) = values {
        list.get_or_insert_with(|| vec![filler; before]).extend(values.into_iter().map(convert));
    } else if let Some(list) = list {
        list.resize(before + count, filler);
    }
}

/// Triangles of a list, strip or fan; points and lines give none.
fn triangles(mode: Mode, order: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::Triangles => order.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        Mode::TriangleStrip => {
            let flip = |(i, t): (usize, &[u32])| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] };
            order.windows(3).enumerate().map(flip).collect()
        }
        Mode::TriangleFan => order.windows(2).skip(1).map(|t| [order[0], t[0], t[1]]).collect(),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn parse(root: &serde_json::Value) -> crate::Result<TexturedMesh> {
        read(Path::new("test.gltf"), root.to_string().as_bytes(), &mut Vec::new())
    }

    /// A triangle (0 0 0), (1 0 0), (0 1 0) without indices; the buffer is a data URI of nine floats.
    fn triangle(node: serde_json::Value) -> serde_json::Value {
        let data = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
        json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [node],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
            "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                            "min": [0, 0, 0], "max": [1, 1, 0] }],
            "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
            "buffers": [{ "byteLength": 36, "uri": format!("data:application/octet-stream;base64,{data}") }],
        })
    }

    #[test]
    fn nodes_move_their_meshes_and_mirrors_keep_the_outside_out() {
        let moved = parse(&triangle(json!({ "mesh": 0, "translation": [5, 0, 0], "scale": [2, 1, 1] }))).unwrap();
        assert_eq!(moved.mesh.triangle(0), [Vec3::X * 5.0, Vec3::X * 7.0, Vec3::new(5.0, 1.0, 0.0)]);
        let mirrored = parse(&triangle(json!({ "mesh": 0, "scale": [1, 1, -1] }))).unwrap().mesh;
        let [a, b, c] = mirrored.triangle(0);
        assert_eq!((b - a).cross(c - a), Vec3::NEG_Z, "the front, mirrored, still faces outwards");
    }

    #[test]
    fn strips_alternate_their_winding() {
        assert_eq!(triangles(Mode::TriangleStrip, &[0, 1, 2, 3]), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(triangles(Mode::TriangleFan, &[0, 1, 2, 3]), [[0, 1, 2], [0, 2, 3]]);
        assert!(triangles(Mode::Lines, &[0, 1, 2, 3]).is_empty());
    }

    #[test]
    fn geometry_compressed_with_draco_is_refused_by_name() {
        let mut root = triangle(json!({ "mesh": 0 }));
        root["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
        root["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
        assert!(parse(&root).unwrap_err().to_string().contains("Draco"));
    }

    #[test]
    fn files_that_break_their_promises_are_refused() {
        let sound = triangle(json!({ "mesh": 0 }));
        assert!(parse(&sound).is_ok());
        let breakages: [(&str, serde_json::Value); 6] = [
            ("/accessors/0/count", json!(4)),
            ("/accessors/0/count", json!(0)),
            ("/accessors/0/byteOffset", json!(u64::MAX)),
            ("/accessors/0/type", json!("SCALAR")),
            ("/bufferViews/0/byteLength", json!(40)),
            ("/buffers/0/uri", json!("%FF.bin")),
        ];
        for (pointer, value) in breakages {
            let mut broken = sound.clone();
            let (parent, key) = pointer.rsplit_once('/').unwrap();
            broken.pointer_mut(parent).unwrap()[key] = value;
            assert!(parse(&broken).is_err(), "{pointer}");
        }
        let mut circle = sound.clone();
        circle["nodes"] = json!([{ "mesh": 0, "children": [0] }]);
        assert!(parse(&circle).is_err());
        for bytes in [&b"glTF"[..], b"glTF\x02\0\0\0\0\0\0\0\xff\xff\xff\xffJSON", b"{}"] {
            assert!(read(Path::new("test.glb"), bytes, &mut Vec::new()).is_err());
        }
    }
}
