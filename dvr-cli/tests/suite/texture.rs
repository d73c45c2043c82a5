//! `dvr texture`: a texture from photographs for meshes that other programs made.

use std::path::Path;

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::mesh::{Mesh, TexturedMesh, read_mesh, shapes, write_mesh};
use glam::Vec3;

/// The mean PSNR of the test views, in dB.
fn psnr(tiny: &Tiny, mesh: &Path) -> f64 {
    let json = tiny.path("figures.json");
    succeeds(&dvr(&["eval", text(mesh), "--data", text(&tiny.scene()), "--json", text(&json), "--overwrite"]));
    let figures: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    let views = figures["views"].as_array().unwrap();
    views.iter().map(|view| view["psnr"].as_f64().unwrap()).sum::<f64>() / views.len() as f64
}

/// A ball in four colours, seen from 24 sides on so many pixels squared, and the same ball without colours.
fn ball(pixels: u32) -> (Tiny, std::path::PathBuf) {
    let mut ball = shapes::icosphere(4, 1.0);
    let check =
        |v: &Vec3| [0.2 + 0.6 * f32::from(u8::from(v.x > 0.0)), 0.5, 0.2 + 0.6 * f32::from(u8::from(v.y > 0.0))];
    ball.colors = Some(ball.vertices.iter().map(check).collect());
    let tiny = Tiny::rendered(ball, 24, pixels);
    let bare = tiny.path("bare.ply");
    write_mesh(&bare, &Mesh { normals: None, ..shapes::icosphere(4, 1.0) }).unwrap();
    (tiny, bare)
}

/// Megabytes that these arguments need at least without the texture, as the refusal of one says.
fn megabytes_needed(arguments: &[&str]) -> u64 {
    let refused = dvr(&[arguments, &["--memory", "1M"]].concat());
    refuses(&refused, &["MB of memory are needed", "--memory"]);
    let error = String::from_utf8_lossy(&refused.stderr).into_owned();
    let (_, number) = error.split_once("about ").unwrap();
    number.split(' ').next().unwrap().parse().unwrap()
}

fn has_texture(mesh: &TexturedMesh) -> bool {
    mesh.materials.iter().any(|material| material.texture.is_some())
}

#[test]
fn a_bare_mesh_gets_the_colours_of_the_photographs_in_every_format() {
    let (tiny, bare) = ball(64);
    let scene = tiny.scene();
    for name in ["ball.glb", "ball.obj"] {
        let out = tiny.path(name);
        let said =
            succeeds(&dvr(&["texture", text(&bare), "--data", text(&scene), "--out", text(&out), "--size", "512"]));
        assert!(said.contains("512x512") && said.contains("charts"), "{said}");
        assert!(has_texture(&read_mesh(&out).unwrap()), "{name}");
        let (white, colored) = (psnr(&tiny, &bare), psnr(&tiny, &out));
        assert!(colored > white + 6.0, "{name}: {colored} dB, bare {white} dB");
    }
    assert!(tiny.path("ball.mtl").is_file() && tiny.path("ball.png").is_file());
}

#[test]
fn an_automatic_texture_gets_smaller_where_memory_is_short() {
    let (tiny, bare) = ball(160);
    let (scene, out) = (tiny.scene(), tiny.path("ball.glb"));
    let arguments = ["texture", text(&bare), "--data", text(&scene), "--out", text(&out), "--overwrite"];
    let made = |more: &[&str]| succeeds(&dvr(&[&arguments[..], more].concat()));
    assert!(made(&[]).contains("512x512"));
    // 512 texels along the edge take more than 12 MB, 256 less.
    let memory = format!("{}M", megabytes_needed(&arguments) + 12);
    assert!(made(&["--memory", &memory]).contains("256x256"));
}

#[test]
fn what_cannot_be_textured_is_said_and_nothing_is_written() {
    let (tiny, bare) = ball(64);
    let (scene, out) = (tiny.scene(), tiny.path("out.glb"));
    let refused = |mesh: &Path, out: &Path, more: &[&str], parts: &[&str]| {
        let arguments = ["texture", text(mesh), "--data", text(&scene), "--out", text(out)];
        refuses(&dvr(&[&arguments[..], more].concat()), parts);
    };
    let empty = tiny.path("empty.ply");
    write_mesh(&empty, &Mesh { vertices: vec![Vec3::ZERO], ..Mesh::default() }).unwrap();
    refused(&empty, &out, &[], &["no faces", "point cloud"]);

    let mut away = shapes::icosphere(1, 1.0);
    away.vertices.iter_mut().for_each(|vertex| vertex.x += 90.0);
    let elsewhere = tiny.path("elsewhere.ply");
    write_mesh(&elsewhere, &away).unwrap();
    refused(&elsewhere, &out, &[], &["% of the surface", "coordinates of the scene's files"]);

    let mut inside_out = shapes::icosphere(4, 1.0);
    inside_out.faces.iter_mut().for_each(|face| face.swap(0, 1));
    let turned = tiny.path("turned.ply");
    write_mesh(&turned, &Mesh { normals: None, ..inside_out }).unwrap();
    refused(&turned, &out, &[], &["inside out", "Turn its faces around"]);

    for size in ["64", "16385", "large"] {
        refused(&bare, &out, &["--size", size], &["from 128 to 16384"]);
    }
    let arguments = ["texture", text(&bare), "--data", text(&scene), "--out", text(&out)];
    let memory = format!("{}M", megabytes_needed(&arguments) + 78);
    let large = ["--size", "8192", "--memory", &memory];
    refused(&bare, &out, &large, &["8192 texels", "about 2954", "78 MB are left", "--size N", "--memory"]);
    refused(&bare, &tiny.path("out.ply"), &[], &[".glb, .usdz or .obj"]);
    assert!(!out.exists());

    let obj = tiny.path("there.obj");
    std::fs::write(tiny.path("there.png"), b"mine").unwrap();
    refused(&bare, &obj, &[], &["there.png", "--overwrite"]);
    assert_eq!(std::fs::read(tiny.path("there.png")).unwrap(), b"mine");
    assert!(!obj.exists() && !tiny.path("there.mtl").exists());
}
