//! Meshes as USDZ packages.

use std::io::{Cursor, Read};
use std::path::Path;
use std::sync::Arc;

use dvr_core::mesh::{
    Look, Material, Mesh, NormalMap, TexturedMesh, corner_tangents, shapes, write_mesh, write_textured_mesh,
};
use glam::{Vec2, Vec3};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use zip::{CompressionMethod, ZipArchive};

/// The files of a package in their order. They are stored as they are, each at a multiple of 64 bytes.
fn unpacked(path: &Path) -> Vec<(String, Vec<u8>)> {
    let mut archive = ZipArchive::new(Cursor::new(std::fs::read(path).unwrap())).unwrap();
    let count = archive.len();
    let read = |index| {
        let mut file = archive.by_index(index).unwrap();
        assert_eq!((file.compression(), file.data_start().unwrap() % 64), (CompressionMethod::Stored, 0));
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).unwrap();
        (file.name().unwrap().into_owned(), bytes)
    };
    (0..count).map(read).collect()
}

fn layer(path: &Path) -> String {
    let (name, bytes) = unpacked(path).remove(0);
    assert_eq!(name, "model.usda", "the scene comes first");
    String::from_utf8(bytes).unwrap()
}

/// The numbers of a property's array.
fn numbers(layer: &str, property: &str) -> Vec<f32> {
    let start = layer.find(&format!(" {property} = [")).unwrap_or_else(|| panic!("{property} in {layer}"));
    let array = &layer[start..][..layer[start..].find(']').unwrap()];
    let array = array.split('[').nth(1).unwrap();
    array.split(['(', ')', ',', ' ']).filter(|word| !word.is_empty()).map(|word| word.parse().unwrap()).collect()
}

/// A triangle, red at the bottom of its texture and blue at the top.
fn triangle() -> TexturedMesh {
    let vertices = vec![Vec3::new(-0.25, 0.0, 1.5), Vec3::new(2.0, 0.0, 1.5), Vec3::new(0.0, 3.0, 1.5)];
    let texture =
        RgbaImage::from_fn(16, 16, |_, v| if v < 8 { Rgba([0, 0, 255, 255]) } else { Rgba([255, 0, 0, 255]) });
    TexturedMesh {
        mesh: Mesh { vertices, faces: vec![[0, 1, 2]], normals: Some(vec![Vec3::Z; 3]), ..Mesh::default() },
        corner_uvs: vec![[Vec2::ZERO, Vec2::X, Vec2::new(0.5, 1.0)]],
        materials: vec![Material { base_color: [1.0; 3], texture: Some(Arc::new(texture)) }],
        ..TexturedMesh::default()
    }
}

#[test]
fn a_package_holds_the_mesh_and_its_texture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("1 mug.usdz");
    write_textured_mesh(&path, &triangle(), Look::Baked.into()).unwrap();
    let text = layer(&path);
    assert!(text.starts_with("#usda 1.0\n") && text.contains("defaultPrim = \"_1_mug\""), "{text}");
    assert!(text.contains("metersPerUnit = 1\n") && text.contains("upAxis = \"Y\"\n"), "{text}");
    assert_eq!(numbers(&text, "points"), [-0.25, 0.0, 1.5, 2.0, 0.0, 1.5, 0.0, 3.0, 1.5]);
    assert_eq!(numbers(&text, "extent"), [-0.25, 0.0, 1.5, 2.0, 3.0, 1.5]);
    assert_eq!(numbers(&text, "faceVertexCounts"), [3.0]);
    assert_eq!(numbers(&text, "faceVertexIndices"), [0.0, 1.0, 2.0]);
    assert_eq!(numbers(&text, "normals"), [0.0, 0.0, 1.0].repeat(3));
    // The first row of the picture is at 1, as in USD: nothing is turned over.
    assert_eq!(numbers(&text, "primvars:st"), [0.0, 0.0, 1.0, 0.0, 0.5, 1.0]);
    let files = unpacked(&path);
    assert_eq!(files.iter().map(|file| &file.0[..]).collect::<Vec<_>>(), ["model.usda", "textures/color.jpg"]);
    let picture = image::load_from_memory(&files[1].1).unwrap().to_rgb8();
    let near =
        |[r, g, b]: [u8; 3], other: [u8; 3]| [(r, other[0]), (g, other[1]), (b, other[2])].map(|(a, b)| a.abs_diff(b));
    assert!(near(picture.get_pixel(8, 2).0, [0, 0, 255]).iter().all(|off| *off < 8));
    assert!(near(picture.get_pixel(8, 13).0, [255, 0, 0]).iter().all(|off| *off < 8));

    let again = folder.path().join("again/1 mug.usdz");
    std::fs::create_dir(again.parent().unwrap()).unwrap();
    write_textured_mesh(&again, &triangle(), Look::Baked.into()).unwrap();
    assert_eq!(std::fs::read(again).unwrap(), std::fs::read(&path).unwrap());
}

#[test]
fn the_look_says_which_input_has_the_colours() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mug.usdz");
    let color = "Color.connect = </mug/material/color.outputs:rgb>";
    for (look, lit, shining) in [(Look::Baked, false, true), (Look::Material, true, false)] {
        write_textured_mesh(&path, &triangle(), look.into()).unwrap();
        let text = layer(&path);
        let has = |input: &str| text.contains(&format!("color3f inputs:{input}{color}"));
        assert_eq!((has("diffuse"), has("emissive")), (lit, shining), "{text}");
        assert!(text.contains("float inputs:roughness = 1\n") && !text.contains("inputs:normal"), "{text}");
    }
}

#[test]
fn a_normal_map_comes_along_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mug.usdz");
    let texture = RgbImage::from_fn(16, 16, |u, v| Rgb([100 + u as u8, 100 + v as u8, 250]));
    let mut mesh = triangle();
    let corner_tangents = corner_tangents(&mesh.mesh, mesh.mesh.normals.as_ref().unwrap(), &mesh.corner_uvs);
    mesh.normal_map = Some(NormalMap { texture: Arc::new(texture.clone()), corner_tangents });
    write_textured_mesh(&path, &mesh, Look::Material.into()).unwrap();
    let text = layer(&path);
    assert!(text.contains("normal3f inputs:normal.connect = </mug/material/normals.outputs:rgb>"), "{text}");
    assert!(text.contains("asset inputs:file = @textures/normals.png@") && text.contains("\"raw\""), "{text}");
    let (name, bytes) = unpacked(&path).remove(2);
    assert_eq!((name.as_str(), image::load_from_memory(&bytes).unwrap().to_rgb8()), ("textures/normals.png", texture));
}

#[test]
fn colours_of_vertices_are_linear_and_an_empty_mesh_is_an_empty_object() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.usdz");
    let mut ball = shapes::icosphere(0, 0.5);
    ball.colors = Some(vec![[0.5, 0.0, 1.0]; ball.vertices.len()]);
    write_mesh(&path, &ball).unwrap();
    let text = layer(&path);
    let colors = numbers(&text, "primvars:displayColor");
    assert_eq!(colors.len(), 3 * ball.vertices.len());
    assert!((colors[0] - 0.214).abs() < 1e-3 && colors[1..3] == [0.0, 1.0], "{colors:?}");
    assert!(text.contains("diffuseColor.connect = </ball/material/displayColor.outputs:result>"), "{text}");

    write_mesh(&path, &Mesh::default()).unwrap();
    let text = layer(&path);
    assert!(text.contains("def Xform \"ball\"") && !text.contains("Mesh"), "{text}");
}
