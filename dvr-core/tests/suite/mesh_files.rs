//! Mesh files, written and read back, and read as other programs wrote them.

use std::path::{Path, PathBuf};

use dvr_core::Observation;
use dvr_core::mesh::{Mesh, read_mesh, read_mesh_with_warnings, shapes, write_mesh};
use dvr_test_support::{max_difference, scene, test_with};
use glam::{Vec2, Vec3};

fn coloured_torus() -> Mesh {
    let mut mesh = shapes::torus(0.3, 0.1, 12, 8);
    mesh.colors = Some(mesh.vertices.iter().map(|v| [0.5 + v.x, 0.5 + v.y, 0.02 + v.z.abs()]).collect());
    mesh
}

#[test]
fn a_mesh_comes_back_from_every_format_as_it_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = coloured_torus();
    for (name, tolerance) in [("m.obj", 1e-6), ("M.PLY", 0.5 / 255.0 + 1e-6), ("m.glb", 1e-5)] {
        let path = folder.path().join(name);
        write_mesh(&path, &mesh).unwrap();
        let back = read_mesh(&path).unwrap();
        let material = &back.materials[back.face_materials.first().copied().unwrap_or(0) as usize];
        assert!(material.base_color.iter().all(|c| (c - 1.0).abs() < 1e-6), "{name}: a material tints the colours");
        let back = back.mesh;
        assert_eq!((&back.vertices, &back.faces), (&mesh.vertices, &mesh.faces), "{name}");
        let flat = |normals: &Option<Vec<Vec3>>| normals.as_ref().unwrap().iter().flat_map(|n| n.to_array()).collect();
        let (found, expected): (Vec<f32>, Vec<f32>) = (flat(&back.normals), flat(&mesh.normals));
        assert!(max_difference(&found, &expected) < 1e-6, "{name}");
        let colors = |m: &Mesh| m.colors.as_ref().unwrap().concat();
        assert!(max_difference(&colors(&back), &colors(&mesh)) < tolerance, "{name}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3, "nothing else is left in the folder");
}

#[test]
fn a_mesh_without_normals_or_faces_can_be_written_too() {
    let folder = tempfile::tempdir().unwrap();
    let bare = Mesh { normals: None, ..shapes::icosphere(1, 1.0) };
    for name in ["bare.obj", "bare.ply", "bare.glb"] {
        let path = folder.path().join(name);
        write_mesh(&path, &bare).unwrap();
        assert_eq!(read_mesh(&path).unwrap().mesh, bare, "{name}");
        write_mesh(&path, &Mesh::default()).unwrap();
        assert!(read_mesh(&path).unwrap().mesh.is_empty(), "{name}");
    }
}

#[test]
fn a_glb_is_aligned_linear_and_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("grey.glb");
    let mesh = Mesh { colors: Some(vec![[0.5; 3]; 4]), ..quad() };
    write_mesh(&path, &mesh).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((word(8), bytes.len() % 4, word(12) % 4), (bytes.len(), 0, 0));
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + word(12)]).unwrap();
    assert_eq!(json["asset"]["generator"], concat!("dvr ", env!("CARGO_PKG_VERSION")));
    assert_eq!([&json["nodes"][0]["name"], &json["meshes"][0]["name"]], ["grey", "grey"]);
    assert_eq!(json["materials"][0]["name"], "vertex_colors");
    assert_eq!(json["accessors"][0]["max"], serde_json::json!([1.0, 1.0, 0.0]));
    let color = json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"].as_u64().unwrap() as usize;
    let view = &json["bufferViews"][json["accessors"][color]["bufferView"].as_u64().unwrap() as usize];
    let at = 20 + word(12) + 8 + view["byteOffset"].as_u64().unwrap() as usize;
    assert!((f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) - 0.214).abs() < 1e-3, "not linear");
}

#[test]
fn how_well_a_vertex_was_seen_is_stored_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let seen: Vec<Observation> =
        (0..4).map(|i| Observation { views: 300 * i, confidence: 0.3 * f32::from(i) }).collect();
    let mesh = Mesh { observations: Some(seen.clone()), ..quad() };
    let path = folder.path().join("seen.ply");
    write_mesh(&path, &mesh).unwrap();
    assert_eq!(read_mesh(&path).unwrap().mesh.observations, Some(seen));

    let path = folder.path().join("seen.glb");
    write_mesh(&path, &mesh).unwrap();
    assert_eq!(read_mesh(&path).unwrap().mesh.vertices, mesh.vertices, "other attributes do no harm");
    let bytes = std::fs::read(&path).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let attributes = json["meshes"][0]["primitives"][0]["attributes"].as_object().unwrap();
    for (name, last) in [("_CONFIDENCE", 0.9), ("_VIEWS", 900.0)] {
        let accessor = &json["accessors"][attributes[name].as_u64().unwrap() as usize];
        // What the Khronos validator asks of a vertex attribute: floats, aligned, as many as there are positions.
        assert_eq!((&accessor["componentType"], &accessor["type"]), (&5126.into(), &"SCALAR".into()));
        assert_eq!(accessor["count"], json["accessors"][attributes["POSITION"].as_u64().unwrap() as usize]["count"]);
        let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        assert_eq!(view["byteOffset"].as_u64().unwrap() % 4, 0);
        let at = 20 + length + 8 + view["byteOffset"].as_u64().unwrap() as usize + 12;
        assert!((f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) - last).abs() < 1e-6, "{name}");
    }
}

fn quad() -> Mesh {
    let vertices = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec();
    Mesh { vertices, faces: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() }
}

#[test]
fn materials_and_texture_coordinates_reach_the_faces() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    image::RgbaImage::new(4, 4).save(folder.path().join("t.png")).unwrap();
    write("m.mtl", "newmtl red paint\nKd 1 0 0\nnewmtl wood\nmap_Kd -s 2 2 t.png\n");
    write(
        "m.obj",
        "mtllib .\\somewhere\\m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt .5 0\nvt 0 1\n\
         f 1 2 3\nusemtl wood\nf 1/1 2/2 3/3\nusemtl red paint\nf 1/1 3/3 2/2\nusemtl gone\nf 1 2 3\n",
    );
    let mut warnings = Vec::new();
    let mesh = read_mesh_with_warnings(folder.path().join("m.obj"), &mut warnings).unwrap();
    let material = |face: usize| &mesh.materials[mesh.face_materials[face] as usize];
    assert!(material(1).texture.is_some() && material(2).texture.is_none());
    assert_eq!(material(2).base_color, [1.0, 0.0, 0.0]);
    assert_eq!(material(0), material(3));
    assert_eq!(mesh.corner_uvs[1], [Vec2::ZERO, Vec2::X, Vec2::Y * 2.0], "map_Kd -s repeats the texture");
    assert_eq!(warnings.len(), 1, "{warnings:?}");
}

#[test]
fn files_that_are_no_meshes_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let unknown = folder.path().join("m.stl");
    std::fs::write(&unknown, "solid").unwrap();
    assert!(read_mesh(&unknown).unwrap_err().to_string().contains("m.stl"));
    assert!(write_mesh(&unknown, &quad()).is_err());
    assert!(read_mesh(folder.path().join("gone.obj")).unwrap_err().to_string().contains("gone.obj"));
    let infinite = folder.path().join("inf.obj");
    std::fs::write(&infinite, "v 0 0 inf\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    assert!(read_mesh(&infinite).unwrap_err().to_string().contains("inf.obj"));
}

fn files_below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files_below(&path, found);
        } else {
            found.push(path);
        }
    }
}

#[test_with(scene("meshes"))]
fn models_of_other_programs_are_read_with_their_textures() {
    let folder = scene("meshes");
    let mut paths = Vec::new();
    files_below(&folder, &mut paths);
    paths.retain(|p| p.extension().is_some_and(|e| e == "obj" || e == "glb"));
    assert!(paths.len() > 50);
    let (mut textured, mut incomplete) = (0, 0);
    for path in &paths {
        let mut warnings = Vec::new();
        let mesh = read_mesh_with_warnings(path, &mut warnings).unwrap();
        // The collection itself lacks a few materials and textures that stayed on its authors' disks.
        let missing = |w: &String| w.contains("is not there") || w.contains("is not defined");
        assert!(warnings.iter().all(missing), "{warnings:?}");
        incomplete += usize::from(!warnings.is_empty());
        assert!(mesh.mesh.faces.len() >= 12, "{}", path.display());
        assert!(mesh.materials.len() > 1 || mesh.face_materials.is_empty(), "{}", path.display());
        textured += usize::from(mesh.materials.iter().any(|m| m.texture.is_some()));
    }
    assert!(textured > 30 && incomplete < 5, "{textured} {incomplete}");
}

#[test_with(scene("meshes"))]
fn spot_is_closed_and_has_the_right_size() {
    let spot = read_mesh(scene("meshes/spot/spot.obj")).unwrap();
    assert_eq!((spot.mesh.vertices.len(), spot.mesh.faces.len()), (2930, 5856));
    assert_eq!(spot.corner_uvs.len(), 5856);
    let texture = spot.materials[spot.face_materials[0] as usize].texture.as_ref().unwrap();
    assert_eq!(texture.dimensions(), (1024, 1024));
}
