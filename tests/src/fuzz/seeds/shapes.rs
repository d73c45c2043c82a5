//! Meshes.

use dvr_core::Observation;
use dvr_core::mesh::{Mesh, MeshStyle, shapes, write_mesh, write_textured_mesh};
use glam::Vec3;

use super::pictures::png;
use super::written;
use crate::fuzz::parts;

fn coloured() -> Mesh {
    let mut mesh = shapes::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5));
    let count = mesh.vertices.len();
    mesh.normals = Some(shapes::vertex_normals(&mesh.vertices, &mesh.faces));
    mesh.colors = Some(vec![[0.25, 0.5, 1.0]; count]);
    mesh.observations = Some(vec![Observation { confidence: 0.5, views: 3 }; count]);
    mesh
}

fn encoded(name: &str) -> Vec<u8> {
    written(name, |path| write_mesh(path, &coloured()).unwrap_or_else(|e| panic!("{e}")))
}

pub(in crate::fuzz) fn ply() -> Vec<Vec<u8>> {
    let ascii = "ply\nformat ascii 1.0\ncomment small\nelement vertex 4\nproperty double x\nproperty double y\n\
        property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
        property list uchar uint vertex_index\nelement edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n\
        0 0 0 255 0 0\n1 0 0 0 9 0\n1 1 0 0 0 9\n0 1 0 0 0 255\n4 0 1 2 3\n0 1\n";
    let mut big = b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        .to_vec();
    big.extend([0.0f32, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.5, 0.0].iter().flat_map(|x| x.to_be_bytes()));
    big.push(3);
    big.extend([0i32, 1, 2].iter().flat_map(|i| i.to_be_bytes()));
    vec![encoded("a.ply"), ascii.as_bytes().to_vec(), big]
}

pub(in crate::fuzz) fn obj() -> Vec<Vec<u8>> {
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 0.2 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n\
        usemtl red\nf 1/1/1 2/2/1 3/3/1\nusemtl picture\nf 1/1 3/3 \\\n4/2\nf -5 -4 -3 -2 -1\nf 1//1 2//1 3//1\n";
    let mtl = "newmtl red\nKd 1 0 0\nnewmtl picture\nKd 0 0 0\nmap_Kd -s 2 2 -o 0.5 0.5 t.png\n";
    let texture = png().remove(0);
    let textured =
        parts::joined(&[("a.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes()), ("t.png", texture.as_slice())]);
    vec![textured, parts::joined(&[("a.obj", &encoded("a.obj"))])]
}

pub(in crate::fuzz) fn off() -> Vec<Vec<u8>> {
    let files = [
        "OFF\n5 3 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0.5 0.2 0\n3 0 1 2\n4 0 1 2 3\n5 0 4 1 2 3\n",
        "OFF3 1 0 # joined\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255 0 0\n",
        "COFF\n3 1 3\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n0 1 0 0 0 255 255\n3 0 1 2\n",
        "NOFF\n3 1 3\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n",
    ];
    files.iter().map(|text| text.as_bytes().to_vec()).collect()
}

pub(in crate::fuzz) fn glb() -> Vec<Vec<u8>> {
    let style = MeshStyle { is_compressed: true, ..MeshStyle::default() };
    let compressed = written("a.glb", |path| {
        write_textured_mesh(path, &coloured().into(), style).unwrap_or_else(|e| panic!("{e}"));
    });
    vec![encoded("a.glb"), compressed]
}

pub(in crate::fuzz) fn gltf() -> Vec<Vec<u8>> {
    let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,2]}],
"nodes":[{"mesh":0,"children":[1],"scale":[1,2,-1]},{"mesh":0,"rotation":[0,0,0,1]},{"mesh":1,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,3,4,5,1]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1,"COLOR_0":3},"indices":2,"material":0}]},
{"primitives":[{"attributes":{"POSITION":0},"mode":5,"material":1},{"attributes":{"POSITION":0,"NORMAL":0},"mode":6}]}],
"materials":[{"pbrMetallicRoughness":{"baseColorFactor":[1,0.5,0,1],"baseColorTexture":{"index":0,"extensions":{"KHR_texture_transform":{"offset":[0.5,0],"rotation":1,"scale":[2,2]}}}}},
{"pbrMetallicRoughness":{"baseColorTexture":{"index":1}}}],
"textures":[{"source":0},{"source":1}],"images":[{"uri":"t.png"},{"bufferView":4,"mimeType":"image/png"}],
"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
{"bufferView":1,"componentType":5123,"normalized":true,"count":4,"type":"VEC2"},
{"bufferView":2,"componentType":5121,"count":6,"type":"SCALAR"},
{"bufferView":3,"componentType":5121,"normalized":true,"count":4,"type":"VEC4"}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":16},
{"buffer":0,"byteOffset":64,"byteLength":6},{"buffer":0,"byteOffset":72,"byteLength":16},
{"buffer":0,"byteOffset":88,"byteLength":LENGTH}],
"buffers":[{"uri":"a.bin","byteLength":TOTAL},{"uri":"data:application/octet-stream;base64,AAECAw==","byteLength":4}]}"#;
    let texture = png().remove(1);
    let corners = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    let mut data: Vec<u8> = corners.iter().flat_map(|x| x.to_le_bytes()).collect();
    data.extend([0u16, 0, 65535, 0, 65535, 65535, 0, 65535].iter().flat_map(|x| x.to_le_bytes()));
    data.extend([0, 1, 2, 0, 2, 3, 0, 0]);
    data.extend([200; 16]);
    data.extend(&texture);
    let json = json.replace("LENGTH", &texture.len().to_string()).replace("TOTAL", &data.len().to_string());
    vec![parts::joined(&[("a.gltf", json.as_bytes()), ("a.bin", &data), ("t.png", &texture)])]
}
