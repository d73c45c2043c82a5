//! Meshes with a texture, written and read back.

use std::path::Path;
use std::sync::Arc;

use dvr_core::mesh::{
    Look, Material, Mesh, NormalMap, TexturedMesh, corner_tangents, read_mesh, read_mesh_with_warnings,
    write_textured_mesh,
};
use glam::{Vec2, Vec3, Vec4};
use image::{RgbImage, Rgba, RgbaImage};

/// A square of two faces; the corners of the texture are red, green, blue and white.
fn square() -> TexturedMesh {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let vertices = corners.map(|[x, y]| Vec3::new(x, y, 0.5)).to_vec();
    let uvs = corners.map(Vec2::from);
    let texture = RgbaImage::from_fn(64, 64, |u, v| match (u < 32, v < 32) {
        (true, true) => Rgba([255, 0, 0, 255]),
        (false, true) => Rgba([0, 255, 0, 255]),
        (true, false) => Rgba([0, 0, 255, 255]),
        (false, false) => Rgba([255, 255, 255, 255]),
    });
    TexturedMesh {
        mesh: Mesh { vertices, faces: vec![[0, 1, 2], [0, 2, 3]], normals: Some(vec![Vec3::Z; 4]), ..Mesh::default() },
        corner_uvs: vec![[uvs[0], uvs[1], uvs[2]], [uvs[0], uvs[2], uvs[3]]],
        face_materials: Vec::new(),
        materials: vec![Material { base_color: [1.0; 3], texture: Some(Arc::new(texture)) }],
        normal_map: None,
    }
}

fn json_of(glb: &Path) -> serde_json::Value {
    let bytes = std::fs::read(glb).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((word(8), bytes.len() % 4, word(12) % 4), (bytes.len(), 0, 0));
    serde_json::from_slice(&bytes[20..20 + word(12)]).unwrap()
}

#[test]
fn a_textured_mesh_comes_back_with_its_colours_where_they_were() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["m.glb", "m.obj"] {
        let path = folder.path().join(name);
        write_textured_mesh(&path, &square(), Look::Baked.into()).unwrap();
        let mut warnings = Vec::new();
        let back = read_mesh_with_warnings(&path, &mut warnings).unwrap();
        assert_eq!((back.mesh.faces.len(), warnings.len()), (2, 0), "{name}: {warnings:?}");
        // Near the corners of the square: bottom left, bottom right, top right, top left.
        let expected = [Vec3::Z, Vec3::ONE, Vec3::Y, Vec3::X];
        let weights = [0.9, 0.05, 0.05];
        for (face, first, color) in [(0, 0, 0), (0, 1, 1), (0, 2, 2), (1, 2, 3)] {
            let barycentric = [0, 1, 2].map(|k| if k == first { weights[0] } else { weights[1] });
            let corner = back.mesh.faces[face][first];
            let at = back.mesh.vertices[corner as usize];
            assert_eq!(at, square().mesh.vertices[[0, 1, 2, 3][color]], "{name}");
            let found = back.base_color(face, barycentric);
            assert!((found - expected[color]).abs().max_element() < 0.02, "{name}: {found} at {at}");
        }
    }
    let mut names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["m.glb", "m.mtl", "m.obj", "m.png"]);
}

#[test]
fn the_look_says_whether_viewers_light_the_colours() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("look.glb");
    write_textured_mesh(&path, &square(), Look::Baked.into()).unwrap();
    let baked = json_of(&path);
    assert_eq!(baked["extensionsUsed"], serde_json::json!(["KHR_materials_unlit"]));
    assert!(baked["materials"][0]["extensions"]["KHR_materials_unlit"].is_object());
    assert_eq!(baked["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"], 0);
    assert_eq!([&baked["nodes"][0]["name"], &baked["meshes"][0]["name"]], ["look", "look"]);
    assert_eq!([&baked["materials"][0]["name"], &baked["images"][0]["name"]], ["textured", "base_color"]);
    // The picture's view has no target, and every view begins at a multiple of four.
    let picture = baked["images"][0]["bufferView"].as_u64().unwrap() as usize;
    assert!(baked["bufferViews"][picture].get("target").is_none());
    for view in baked["bufferViews"].as_array().unwrap() {
        assert_eq!(view["byteOffset"].as_u64().unwrap() % 4, 0);
    }
    write_textured_mesh(&path, &square(), Look::Material.into()).unwrap();
    let lit = json_of(&path);
    assert!(lit.get("extensionsUsed").is_none() && lit["materials"][0].get("extensions").is_none());
}

/// The square with a normal map that leans to the right of the picture on its left half.
fn with_normal_map() -> TexturedMesh {
    let lean = NormalMap::texel(Vec3::new(0.6, 0.0, 0.8));
    let texture = RgbImage::from_fn(32, 32, |u, _| image::Rgb(if u < 16 { lean } else { [128, 128, 255] }));
    let square = square();
    let normals = square.mesh.normals.clone().unwrap();
    let corner_tangents = corner_tangents(&square.mesh, &normals, &square.corner_uvs);
    TexturedMesh { normal_map: Some(NormalMap { texture: Arc::new(texture), corner_tangents }), ..square }
}

#[test]
fn a_normal_map_lies_in_a_glb_beside_the_colours_with_a_tangent_for_each_vertex() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.glb");
    // Mirrored, the faces on the left half of the texture need vertices of their own along the diagonal.
    let mut mirrored = with_normal_map();
    mirrored.normal_map.as_mut().unwrap().corner_tangents[1] = [Vec4::new(-1.0, 0.0, 0.0, -1.0); 3];
    for (textured, vertices) in [(with_normal_map(), 4), (mirrored, 6)] {
        let map = textured.normal_map.as_ref().unwrap();
        write_textured_mesh(&path, &textured, Look::Material.into()).unwrap();
        let (document, buffers, pictures) = gltf::import(&path).unwrap();
        let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
        let tangents: Vec<Vec4> = reader.read_tangents().unwrap().map(Vec4::from).collect();
        let corners: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        let expected: Vec<Vec4> = map.corner_tangents.iter().flatten().copied().collect();
        assert_eq!(tangents.len(), vertices);
        assert_eq!(corners.iter().map(|&i| tangents[i as usize]).collect::<Vec<_>>(), expected);
        let material = primitive.material();
        let normal_texture = material.normal_texture().unwrap();
        let image = normal_texture.texture().source().unwrap();
        assert_eq!((normal_texture.scale(), normal_texture.tex_coord(), image.name()), (1.0, 0, Some("normal_map")));
        assert_eq!(pictures[image.index()].pixels, map.texture.as_raw().as_slice(), "bit for bit");
        let base = material.pbr_metallic_roughness().base_color_texture().unwrap().texture().source().unwrap();
        assert_eq!(base.name(), Some("base_color"));

        let mut warnings = Vec::new();
        let back = read_mesh_with_warnings(&path, &mut warnings).unwrap();
        assert_eq!((back.mesh.faces.len(), back.mesh.vertices.len(), warnings.len()), (2, vertices, 0), "{warnings:?}");
        assert_eq!(back.materials[0].texture.as_ref().unwrap().dimensions(), (64, 64));
    }
    let obj = folder.path().join("map.obj");
    write_textured_mesh(&obj, &with_normal_map(), Look::Material.into()).unwrap();
    let material = std::fs::read_to_string(folder.path().join("map.mtl")).unwrap();
    assert!(!material.contains("ump") && !material.contains("norm"), "{material}");
}

#[test]
fn without_a_texture_and_as_ply_it_is_written_as_any_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let bare = TexturedMesh { materials: Vec::new(), ..square() };
    for (name, textured) in [("bare.glb", &bare), ("textured.ply", &square())] {
        let path = folder.path().join(name);
        write_textured_mesh(&path, textured, Look::Baked.into()).unwrap();
        let back = read_mesh(&path).unwrap();
        assert_eq!(back.mesh.vertices, square().mesh.vertices, "{name}");
        assert!(back.materials.iter().all(|material| material.texture.is_none()), "{name}");
    }
    let error =
        write_textured_mesh(folder.path().join("m.fbx"), &square(), Look::Baked.into()).unwrap_err().to_string();
    assert!(error.contains("fbx"), "{error}");
}
