//! GLBs whose geometry is compressed, written and read back.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use dvr_core::Observation;
use dvr_core::mesh::{
    Look, Material, Mesh, MeshStyle, NormalMap, TexturedMesh, corner_tangents, read_mesh, shapes, write_textured_mesh,
};
use glam::{Vec2, Vec3};
use image::{Rgba, RgbaImage};

const COMPRESSED: MeshStyle = MeshStyle { look: Look::Baked, is_compressed: true };

/// A ball away from the origin with everything that a vertex can have.
fn ball() -> Mesh {
    let mut mesh = shapes::icosphere(5, 0.4);
    mesh.normals = Some(mesh.vertices.iter().map(|vertex| vertex.normalize()).collect());
    mesh.colors = Some(mesh.vertices.iter().map(|vertex| (*vertex + 0.5).to_array()).collect());
    let seen = |vertex: &Vec3| Observation { views: (1000.0 * vertex.x.abs()) as u16, confidence: vertex.z.abs() };
    mesh.observations = Some(mesh.vertices.iter().map(seen).collect());
    mesh.vertices.iter_mut().for_each(|vertex| *vertex += Vec3::new(7.0, -3.0, 0.2));
    mesh
}

/// With a texture, whose coordinates leave a seam.
fn textured() -> TexturedMesh {
    let mesh = ball();
    let normals = mesh.normals.clone().unwrap();
    let uv = |vertex: u32| {
        let normal = normals[vertex as usize];
        Vec2::new(0.5 + normal.y.atan2(normal.x) / 6.3, 0.5 + 0.49 * normal.z)
    };
    let corner_uvs: Vec<[Vec2; 3]> = mesh.faces.iter().map(|face| face.map(uv)).collect();
    let texture = RgbaImage::from_fn(64, 64, |u, v| Rgba([4 * u as u8, 4 * v as u8, 90, 255]));
    let tangents = corner_tangents(&mesh, &normals, &corner_uvs);
    let map = image::RgbImage::from_pixel(8, 8, image::Rgb([128, 128, 255]));
    TexturedMesh {
        normal_map: Some(NormalMap { texture: Arc::new(map), corner_tangents: tangents }),
        materials: vec![Material { base_color: [1.0; 3], texture: Some(Arc::new(texture)) }],
        corner_uvs,
        mesh,
        ..TexturedMesh::default()
    }
}

fn written(folder: &Path, mesh: &TexturedMesh, style: MeshStyle) -> (TexturedMesh, u64) {
    let path = folder.join("m.glb");
    write_textured_mesh(&path, mesh, style).unwrap();
    (read_mesh(&path).unwrap(), std::fs::metadata(&path).unwrap().len())
}

/// The vertex of a mesh at a place, from which it is at most a step of the compression away.
fn original(mesh: &Mesh) -> impl Fn(Vec3) -> usize {
    let key = |place: Vec3| (place * 1000.0).round().to_array().map(|x| x as i64);
    let known: HashMap<[i64; 3], usize> = mesh.vertices.iter().enumerate().map(|(i, place)| (key(*place), i)).collect();
    let vertices = mesh.vertices.clone();
    move |place| {
        let near = [-0.0005, 0.0, 0.0005];
        let places = near.into_iter().flat_map(|x| {
            near.into_iter().flat_map(move |y| near.into_iter().map(move |z| place + Vec3::new(x, y, z)))
        });
        let found = places.filter_map(|place| known.get(&key(place)).copied());
        found.min_by(|a, b| vertices[*a].distance(place).total_cmp(&vertices[*b].distance(place))).unwrap()
    }
}

#[test]
fn what_is_compressed_comes_back_but_for_rounding() {
    let folder = tempfile::tempdir().unwrap();
    let before = textured();
    let (back, small) = written(folder.path(), &before, MeshStyle { look: Look::Material, is_compressed: true });
    let (_, large) = written(folder.path(), &before, Look::Material.into());
    assert!(small * 4 < large, "{small} and {large} bytes");
    assert_eq!(back.mesh.faces.len(), before.mesh.faces.len());
    assert_eq!(back.materials[0].texture.as_ref().unwrap().dimensions(), (64, 64));
    let at = original(&before.mesh);
    let uv_of: HashMap<u32, Vec2> = before
        .mesh
        .faces
        .iter()
        .zip(&before.corner_uvs)
        .flat_map(|(face, uvs)| face.iter().copied().zip(*uvs))
        .collect();
    let (normals, colors) = (back.mesh.normals.as_ref().unwrap(), back.mesh.colors.as_ref().unwrap());
    for (face, uvs) in back.mesh.faces.iter().zip(&back.corner_uvs) {
        for (&vertex, uv) in face.iter().zip(uvs) {
            let place = back.mesh.vertices[vertex as usize];
            let source = at(place);
            assert!(place.distance(before.mesh.vertices[source]) < 2e-5, "{place}");
            assert!(normals[vertex as usize].dot(before.mesh.normals.as_ref().unwrap()[source]) > 0.9996);
            let color = Vec3::from(colors[vertex as usize]) - Vec3::from(before.mesh.colors.as_ref().unwrap()[source]);
            assert!(color.abs().max_element() < 1e-3, "{color}");
            assert!((*uv - uv_of[&(source as u32)]).abs().max_element() < 2e-5);
        }
        let [a, b, c] = face.map(|vertex| back.mesh.vertices[vertex as usize]);
        assert!((b - a).cross(c - a).dot(normals[face[0] as usize]) > 0.0, "faces look outwards");
    }
    assert_eq!(before.mesh.open_edges(), 0);
}

#[test]
fn without_a_texture_it_is_compressed_as_well_and_what_is_seen_stays() {
    let folder = tempfile::tempdir().unwrap();
    let (back, small) = written(folder.path(), &ball().into(), COMPRESSED);
    let (plain, large) = written(folder.path(), &ball().into(), Look::Baked.into());
    assert!(small * 3 < large, "{small} and {large} bytes");
    assert_eq!((back.mesh.faces.len(), back.mesh.open_edges()), (plain.mesh.faces.len(), 0));
    // As an independent reader of the same file has it.
    write_textured_mesh(folder.path().join("m.glb"), &ball().into(), COMPRESSED).unwrap();
    let bytes = std::fs::read(folder.path().join("m.glb")).unwrap();
    let root = json_of(&bytes);
    assert_eq!(root["extensionsRequired"], serde_json::json!(["EXT_meshopt_compression", "KHR_mesh_quantization"]));
    assert_eq!(root["extensionsUsed"], root["extensionsRequired"]);
    assert_eq!(root["buffers"][1]["extensions"]["EXT_meshopt_compression"]["fallback"], true);
    let accessor =
        &root["accessors"][root["meshes"][0]["primitives"][0]["attributes"]["POSITION"].as_u64().unwrap() as usize];
    assert_eq!(accessor["componentType"], 5123);
    assert!(accessor["max"].as_array().unwrap().contains(&65535.into()), "{accessor}");
    let empty = written(folder.path(), &Mesh::default().into(), COMPRESSED).0;
    assert!(empty.mesh.is_empty());
}

fn json_of(glb: &[u8]) -> serde_json::Value {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&glb[20..20 + length]).unwrap()
}

/// The file with another document.
fn with_json(glb: &[u8], root: &serde_json::Value) -> Vec<u8> {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let mut json = root.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = (glb.len() - length + json.len()) as u32;
    let header = [&glb[..8], &total.to_le_bytes(), &(json.len() as u32).to_le_bytes(), b"JSON"].concat();
    [header, json, glb[20 + length..].to_vec()].concat()
}

#[test]
fn damaged_compression_is_refused_with_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.glb");
    write_textured_mesh(&path, &ball().into(), COMPRESSED).unwrap();
    let sound = std::fs::read(&path).unwrap();
    let said = |pointer: &str, value: serde_json::Value| {
        let mut root = json_of(&sound);
        *root.pointer_mut(&format!("/bufferViews/0/extensions/EXT_meshopt_compression/{pointer}")).unwrap() = value;
        std::fs::write(&path, with_json(&sound, &root)).unwrap();
        read_mesh(&path).unwrap_err().to_string()
    };
    assert!(said("count", 1_000_000_000.into()).contains("more than the file can hold"));
    assert!(said("count", u64::MAX.into()).contains("compressed view 0"));
    assert!(said("buffer", 9.into()).contains("more than its buffer has"));
    assert!(said("byteOffset", (u32::MAX).into()).contains("more than its buffer has"));
    assert!(said("byteLength", 5.into()).contains("damaged"));
    assert!(said("byteStride", 6.into()).contains("elements of 6 bytes"));
    assert!(said("mode", "WORDS".into()).contains("WORDS"));
    assert!(said("mode", "TRIANGLES".into()).contains("TRIANGLES"));
    let mut root = json_of(&sound);
    root["bufferViews"][0]["extensions"]["EXT_meshopt_compression"]["filter"] = "SMOOTH".into();
    std::fs::write(&path, with_json(&sound, &root)).unwrap();
    assert!(read_mesh(&path).unwrap_err().to_string().contains("no filter SMOOTH"));
    // Damaged bytes give an error or another mesh.
    let start = sound.len() - 4000;
    for at in (start..sound.len()).step_by(97) {
        let mut damaged = sound.clone();
        damaged[at] ^= 0x55;
        std::fs::write(&path, damaged).unwrap();
        let _ = read_mesh(&path);
    }
}
