//! `dvr eval` of meshes that other programs made.

use std::path::{Path, PathBuf};

use crate::support::{Tiny, dvr, succeeds, text};
use dvr_core::Cancellation;
use dvr_core::mesh::{Mesh, shapes, write_mesh};
use dvr_core::metrics::self_intersections;
use glam::Vec3;
use image::{Rgba, RgbaImage};
use serde_json::json;
use tempfile::TempDir;

/// A box of which every side shows the whole of `checks.png`: corners in the order of the faces, and their texture
/// coordinates from the bottom left.
fn sides() -> Vec<[([f32; 3], [f32; 2]); 4]> {
    let corner = |axis: usize, side: f32, u: f32, v: f32| {
        let mut position = [0.0; 3];
        position[axis] = side;
        position[(axis + 1) % 3] = 0.8 * (2.0 * u - 1.0) * side;
        position[(axis + 2) % 3] = 0.6 * (2.0 * v - 1.0);
        (position, [u, v])
    };
    let side = |i: usize| {
        let (axis, side) = (i % 3, if i < 3 { 1.0 } else { -1.0 });
        [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(u, v)| corner(axis, side, u, v))
    };
    (0..6).map(side).collect()
}

/// The box as OBJ with a material, as OBJ without, and as glTF, with a scene of it that `dvr synth` renders.
struct Textured {
    folder: TempDir,
}

impl Textured {
    fn new() -> Self {
        let textured = Self { folder: tempfile::tempdir().unwrap() };
        let colors = [[230, 60, 40], [40, 200, 70], [50, 80, 220], [240, 210, 60]];
        let texture = RgbaImage::from_fn(16, 16, |u, v| {
            let [r, g, b] = colors[(u / 8 + 2 * (v / 8)) as usize];
            Rgba([r, g, b, 255])
        });
        texture.save(textured.path("checks.png")).unwrap();
        textured.write_obj();
        textured.write_gltf();
        // Light from everywhere alone: the pictures show the texture as it is.
        let light = json!({"lighting": {"ambient": 1.0, "lights": []}, "surface_points": 500, "occupancy_points": 500});
        std::fs::write(textured.path("light.json"), light.to_string()).unwrap();
        let (mesh, out, light) = (textured.path("box.obj"), textured.path("data"), textured.path("light.json"));
        let size = ["--views", "9", "--size", "48", "--category", "boxes", "--config", text(&light)];
        succeeds(&dvr(&[&["synth", text(&mesh), "--out", text(&out)][..], &size].concat()));
        textured
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write_obj(&self) {
        let mut obj = String::new();
        for (position, [u, v]) in sides().concat() {
            obj += &format!("v {} {} {}\nvt {u} {v}\n", position[0], position[1], position[2]);
        }
        for i in (1..=24).step_by(4) {
            obj += &format!("f {i}/{i} {0}/{0} {1}/{1} {2}/{2}\n", i + 1, i + 2, i + 3);
        }
        std::fs::write(self.path("white.obj"), &obj).unwrap();
        std::fs::write(self.path("box.obj"), format!("mtllib box.mtl\nusemtl checks\n{obj}")).unwrap();
        std::fs::write(self.path("box.mtl"), "newmtl checks\nKd 1 1 1\nmap_Kd checks.png\n").unwrap();
    }

    fn write_gltf(&self) {
        let corners = sides().concat();
        let floats = |values: Vec<f32>| values.into_iter().flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
        let positions = floats(corners.iter().flat_map(|(position, _)| *position).collect());
        // glTF counts from the top left corner.
        let uvs = floats(corners.iter().flat_map(|(_, [u, v])| [*u, 1.0 - v]).collect());
        let indices: Vec<u8> =
            (0..24u16).step_by(4).flat_map(|i| [i, i + 1, i + 2, i, i + 2, i + 3]).flat_map(u16::to_le_bytes).collect();
        let (at, end) = (positions.len(), positions.len() + uvs.len());
        let gltf = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
            "textures": [{"source": 0}], "images": [{"uri": "checks.png"}],
            "buffers": [{"uri": "box.bin", "byteLength": end + indices.len()}],
            "bufferViews": [
                {"buffer": 0, "byteLength": at},
                {"buffer": 0, "byteOffset": at, "byteLength": uvs.len()},
                {"buffer": 0, "byteOffset": end, "byteLength": indices.len()},
            ],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 24, "type": "VEC3", "min": [-1, -1, -1], "max": [1, 1, 1]},
                {"bufferView": 1, "componentType": 5126, "count": 24, "type": "VEC2"},
                {"bufferView": 2, "componentType": 5123, "count": 36, "type": "SCALAR"},
            ],
        });
        std::fs::write(self.path("box.bin"), [positions, uvs, indices].concat()).unwrap();
        std::fs::write(self.path("box.gltf"), gltf.to_string()).unwrap();
    }

    /// The mean PSNR of the held-out views, by `dvr eval`.
    fn psnr(&self, mesh: &Path) -> f64 {
        let (scene, json) = (self.path("data/boxes/box"), self.path("eval.json"));
        succeeds(&dvr(&["eval", text(mesh), "--data", text(&scene), "--json", text(&json), "--overwrite"]));
        let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
        let views = report["views"].as_array().unwrap();
        assert!(!views.is_empty());
        views.iter().map(|view| view["psnr"].as_f64().unwrap()).sum::<f64>() / views.len() as f64
    }
}

#[test]
fn a_textured_mesh_is_measured_with_its_texture() {
    let textured = Textured::new();
    let [obj, gltf, white] = ["box.obj", "box.gltf", "white.obj"].map(|name| textured.psnr(&textured.path(name)));
    println!("{obj:.2} dB as OBJ, {gltf:.2} dB as glTF, {white:.2} dB without its texture");
    assert!(obj > 28.0 && (obj - gltf).abs() < 0.01, "{obj} {gltf}");
    assert!(white < 12.0, "{white} {obj}");
}

#[test]
fn pairs_of_faces_that_intersect_are_counted() {
    let tiny = Tiny::new();
    let cube = |low: f32, high: f32| shapes::cuboid(Vec3::splat(low), Vec3::splat(high));
    let crossing = shapes::union([cube(-0.3, 0.3), cube(-0.1, 0.6)]);
    let pairs = self_intersections(&crossing, &Cancellation::default()).unwrap();
    assert!(pairs >= 6, "{pairs}");
    let measured = |mesh: &Mesh| {
        let (path, json) = (tiny.path("m.ply"), tiny.path("m.json"));
        write_mesh(&path, mesh).unwrap();
        let scene = tiny.scene();
        let arguments =
            ["eval", text(&path), "--data", text(&scene), "--no-views", "--json", text(&json), "--overwrite"];
        let said = succeeds(&dvr(&arguments));
        let figures: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
        (said, figures["mesh"].clone())
    };
    let (said, mesh) = measured(&crossing);
    assert!(said.contains(&format!("24 faces, {pairs} pairs of faces intersect")), "{said}");
    assert_eq!((&mesh["faces"], &mesh["self_intersections"]), (&json!(24), &json!(pairs)));
    let (said, mesh) = measured(&shapes::icosphere(2, 0.5));
    assert!(said.contains("320 faces, no face intersects another") && mesh["self_intersections"] == 0, "{said}");
}
