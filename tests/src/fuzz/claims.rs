//! Small files that claim much, for each limit: what random damage would hardly find.

use std::io::Write;

use flate2::write::ZlibEncoder;
use flate2::{Compression, Crc};
use zip::CompressionMethod;

use dvr_test_support::{MatEntry, mat_file, mat_header};

use super::containers::with_checksum;
use super::parts::joined;
use super::seeds::arrays::{deflated_element, npy_of, zip_of};
use super::seeds::networks;
use super::seeds::pictures::{jpeg, picture_of_channels};

/// The files for a reader, each with what it claims.
pub fn claims(reader: &str) -> Vec<(&'static str, Vec<u8>)> {
    match reader {
        "png" => pictures(),
        "jpeg" => {
            vec![("a JPEG of 65535 x 65535 pixels", jpeg_of(65535, 65535)), ("of 12000 x 12000", jpeg_of(12000, 12000))]
        }
        "other_pictures" => bitmaps(),
        "exr" => vec![
            ("1000 channels of half precision", picture_of_channels(1000)),
            ("a million channels' names", channels_of_names()),
        ],
        "npz" => archives(),
        "npy" => arrays(),
        "mat" => matlab_arrays(),
        "ply" => polygon_files(),
        "obj" => objects(),
        "off" => vec![
            ("99999999999 vertices", b"OFF\n99999999999 1 0\n0 0 0\n".to_vec()),
            ("one polygon of all corners", off_comb(4097)),
            ("a spiral", off_spiral()),
        ],
        "glb" | "gltf" => scenes(reader == "glb"),
        "safetensors" => networks::claiming(),
        "scene_dvr" => fields(),
        "view_color" => networks::claiming_cells(),
        "reference_yaml" => yaml(),
        "config_json" | "transforms_json" => {
            vec![("nested lists", nested("[", "]")), ("nested objects", nested("{\"frames\":", "}"))]
        }
        "colmap_binary" => vec![(
            "as many cameras as there are numbers",
            joined(&[("cameras.bin", &[0xff; 64]), ("images.bin", &[0xff; 64])]),
        )],
        _ => Vec::new(),
    }
}

/// PNG files whose pixels are there, deflated to a thousandth.
fn pictures() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("gray, 12600 x 12600", png(12600, 12600, 8, 0, true)),
        ("with alpha of 16 bits, 8190 x 8190", png(8190, 8190, 16, 6, true)),
        ("gray, 12700 x 12700", png(12700, 12700, 8, 0, true)),
        ("2147483647 pixels square", png(0x7fff_ffff, 0x7fff_ffff, 8, 6, false)),
        ("no pixel of 12000 x 12000", png(12000, 12000, 8, 2, false)),
    ]
}

/// A black PNG; without its pixels where they are not asked for.
fn png(width: u32, height: u32, bits: u8, kind: u8, with_pixels: bool) -> Vec<u8> {
    let channels = [1, 0, 3, 0, 2, 0, 4][usize::from(kind)];
    let mut header = [width, height].map(u32::to_be_bytes).concat();
    header.extend([bits, kind, 0, 0, 0]);
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    if with_pixels {
        let line = vec![0; 1 + channels * usize::from(bits / 8) * width as usize];
        (0..height).for_each(|_| encoder.write_all(&line).unwrap_or_else(|e| panic!("{e}")));
    }
    let data = encoder.finish().unwrap_or_else(|e| panic!("{e}"));
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let mut crc = Crc::new();
        crc.update(kind);
        crc.update(data);
        [&(data.len() as u32).to_be_bytes()[..], kind, data, &crc.sum().to_be_bytes()].concat()
    };
    let chunks = [chunk(b"IHDR", &header), chunk(b"IDAT", &data), chunk(b"IEND", &[])].concat();
    [b"\x89PNG\r\n\x1a\n", &chunks[..]].concat()
}

/// A sound JPEG with another size in its frame, which is made progressive.
fn jpeg_of(width: u16, height: u16) -> Vec<u8> {
    let mut bytes = jpeg().remove(0);
    let frame = bytes.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap_or_else(|| panic!("there is no frame"));
    bytes[frame + 1] = 0xc2;
    bytes[frame + 5..frame + 7].copy_from_slice(&height.to_be_bytes());
    bytes[frame + 7..frame + 9].copy_from_slice(&width.to_be_bytes());
    bytes
}

/// BMP, GIF and TIFF of many pixels and no data.
fn bitmaps() -> Vec<(&'static str, Vec<u8>)> {
    let mut bmp = b"BM\0\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0".to_vec();
    bmp.extend([30_000u32, 30_000].map(u32::to_le_bytes).concat());
    bmp.extend([1, 0, 24, 0].iter().chain(&[0; 24]));
    let gif = [b"GIF89a", &[0xff; 4][..], &[0, 0, 0, 0x2c, 0, 0, 0, 0], &[0xff; 4], &[0, 2, 1, 0x44, 0, 0x3b]].concat();
    let entry = |tag: u16, kind: u16, value: u32| {
        [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &1u32.to_le_bytes(), &value.to_le_bytes()].concat()
    };
    let entries = [
        (256, 4, 40_000),
        (257, 4, 40_000),
        (258, 3, 8),
        (259, 3, 1),
        (262, 3, 1),
        (273, 4, 8),
        (277, 3, 1),
        (278, 4, 40_000),
        (279, 4, 1_600_000_000),
    ];
    let entries: Vec<u8> = entries.iter().flat_map(|&(tag, kind, value)| entry(tag, kind, value)).collect();
    let tiff = [b"II*\0\x08\0\0\0\x09\0", entries.as_slice(), &[0; 4]].concat();
    vec![("a BMP of 30000 x 30000", bmp), ("a GIF of 65535 x 65535", gif), ("a TIFF of 40000 x 40000", tiff)]
}

/// A header with a very long list of channels.
fn channels_of_names() -> Vec<u8> {
    let mut bytes = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
    let list: Vec<u8> = (0..1000u32)
        .flat_map(|i| [format!("c{i:07}\0").as_bytes(), &[1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]].concat())
        .collect();
    bytes.extend(b"channels\0chlist\0");
    bytes.extend(0x7fff_ffffu32.to_le_bytes());
    bytes.extend(list);
    bytes
}

/// Archives whose entries inflate to more than their limit, or say that they do.
fn archives() -> Vec<(&'static str, Vec<u8>)> {
    let inflating = |kind: &str, shape: &str, bytes: usize| {
        let head = npy_of(kind, false, shape, &[]);
        zip_of("a.npy", CompressionMethod::Deflated, |zip| {
            zip.write_all(&head)?;
            let zeros = vec![0; 1 << 20];
            (0..bytes >> 20).try_for_each(|_| zip.write_all(&zeros))
        })
    };
    let header = npy_of("<f8", false, "(3, 3)", &[]);
    let spaces = zip_of("a.npy", CompressionMethod::Deflated, |zip| {
        zip.write_all(&header[..8])?;
        zip.write_all(&[0xff, 0xff, 0xff, 0x7f])?;
        zip.write_all(&vec![b' '; 64 << 20])
    });
    vec![
        ("256 MB of doubles", inflating("<f8", "(33554432,)", 256 << 20)),
        ("640 MB of doubles", inflating("<f8", "(83886080,)", 640 << 20)),
        ("128 MB of bytes to be widened", inflating("|i1", "(134217728,)", 128 << 20)),
        ("a small array, then 640 MB", inflating("<f8", "(3,)", 640 << 20)),
        ("a header of gigabytes", spaces),
    ]
}

fn arrays() -> Vec<(&'static str, Vec<u8>)> {
    let nested = |open: &str, close: &str| format!("{}1,{}", open.repeat(4000), close.repeat(4000));
    vec![
        ("33 million doubles", npy_of("<f8", false, "(33000000,)", &[0; 8])),
        ("brackets in brackets", npy_of("<f8", false, &nested("(", ")"), &[0; 8])),
        (
            "twenty brackets in brackets",
            npy_of("<f8", false, &format!("{}1{}", "(".repeat(20), ")".repeat(20)), &[0; 8]),
        ),
        ("braces in braces", npy_of("<f8", false, &nested("{1:", "}"), &[0; 8])),
        ("more than can be counted", npy_of("<f8", false, "(4294967296, 4294967296, 4294967296)", &[0; 8])),
        ("records of records", npy_of("[('a', '<f4', (99999999, 99999999))]", false, "(1,)", &[0; 8])),
    ]
}

/// Arrays that inflate to more than their limit, or say that they do.
fn matlab_arrays() -> Vec<(&'static str, Vec<u8>)> {
    let inflating = |stored: u32, shape: [u32; 3], bytes: u32| {
        let mut head = MatEntry { name: "ObsMask", shape: &shape, class: 9, stored, data: &[] }.element();
        let length = head.len() - 4;
        head[length..].copy_from_slice(&bytes.to_le_bytes());
        let element = deflated_element(|encoder| {
            encoder.write_all(&head)?;
            let zeros = vec![0; 1 << 20];
            (0..bytes >> 20).try_for_each(|_| encoder.write_all(&zeros))
        });
        [mat_header(), element].concat()
    };
    let numbers = [0; 8];
    let claiming = |shape: &[u32]| mat_file(&[MatEntry::doubles("ObsMask", shape, &numbers)]);
    vec![
        ("256 MB of truth values", inflating(2, [256, 1024, 1024], 256 << 20)),
        ("256 MB of doubles", inflating(9, [32, 1024, 1024], 256 << 20)),
        ("512 MB of truth values", inflating(2, [512, 1024, 1024], 512 << 20)),
        ("small numbers to be widened", inflating(3, [64, 1024, 1024], 128 << 20)),
        ("more than can be counted", claiming(&[u32::MAX; 4])),
        ("a million axes", claiming(&vec![1; 1 << 20])),
    ]
}

fn polygon_files() -> Vec<(&'static str, Vec<u8>)> {
    let binary = |elements: &str, data: &[u8]| {
        [b"ply\nformat binary_little_endian 1.0\n", elements.as_bytes(), b"end_header\n", data].concat()
    };
    let list = "element face 1\nproperty list uint int vertex_indices\n";
    vec![
        ("elements of nothing", binary("element nothing 18446744073709551615\n", &[])),
        ("vertices of nothing", binary("element vertex 9999999999\n", &[])),
        ("a list of 4294967295 corners", binary(list, &[0xff; 16])),
        ("vertices that are not there", binary("element vertex 4294967295\nproperty float x\n", &[0; 64])),
    ]
}

/// Corners of a comb, as lines of an OBJ or OFF file.
fn comb(count: usize, prefix: &str) -> String {
    (0..count).map(|i| format!("{prefix}{i} {} 0\n", i % 2)).collect()
}

fn off_comb(count: usize) -> Vec<u8> {
    let corners: String = (0..count).map(|i| format!(" {i}")).collect();
    format!("OFF\n{count} 1 0\n{}{count}{corners}\n", comb(count, "")).into_bytes()
}

/// A polygon that winds inwards and out again: hardly a corner is an ear.
fn off_spiral() -> Vec<u8> {
    let turns = |i: usize, inset: f32| {
        let (angle, radius) = (i as f32 * 0.1, 1.0 + i as f32 * 0.01 - inset);
        format!("{} {} 0\n", radius * angle.cos(), radius * angle.sin())
    };
    let out: String = (0..2000).map(|i| turns(i, 0.0)).collect();
    let back: String = (0..2000).rev().map(|i| turns(i, 0.2)).collect();
    let corners: String = (0..4000).map(|i| format!(" {i}")).collect();
    format!("OFF\n4000 1 0\n{out}{back}4000{corners}\n").into_bytes()
}

fn objects() -> Vec<(&'static str, Vec<u8>)> {
    let long: String = (1..=100_000).map(|i| format!(" {i}")).collect();
    let face = format!("{}f{long}\n", comb(100_000, "v "));
    let many: String = (0..5000).map(|i| format!("newmtl m{i}\nmap_Kd t.png\n")).collect();
    let texture = png(4000, 4000, 8, 2, true);
    let big = png(12000, 12000, 8, 2, true);
    let user = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m1\nf 1 2 3\n";
    vec![
        ("one polygon of 100000 corners", joined(&[("a.obj", face.as_bytes())])),
        ("5000 materials of one texture", joined(&[("a.obj", user), ("a.mtl", many.as_bytes()), ("t.png", &texture)])),
        ("a texture of 12000 x 12000", joined(&[("a.obj", user), ("a.mtl", many.as_bytes()), ("t.png", &big)])),
        ("an index below all", joined(&[("a.obj", b"v 0 0 0\nf -9223372036854775808 1 1\n")])),
    ]
}

/// glTF whose nodes, primitives and buffers share what is there once.
fn scenes(binary: bool) -> Vec<(&'static str, Vec<u8>)> {
    let nodes = vec!["{\"mesh\":0}"; 20_000].join(",");
    let all: Vec<String> = (0..20_000).map(|i| i.to_string()).collect();
    let all = all.join(",");
    let primitive = "{\"attributes\":{\"POSITION\":0}}";
    let json = |nodes: &str, roots: &str, primitives: &str, stride: &str, count: u64, buffers: &str| {
        format!(
            "{{\"asset\":{{\"version\":\"2.0\"}},\"scene\":0,\"scenes\":[{{\"nodes\":[{roots}]}}],\"nodes\":[{nodes}],\
             \"meshes\":[{{\"primitives\":[{primitives}]}}],\"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\
             \"count\":{count},\"type\":\"VEC3\",\"min\":[0,0,0],\"max\":[1,1,1]}}],\"bufferViews\":[{{\"buffer\":0,\
             \"byteLength\":36000{stride}}}],\"buffers\":[{buffers}]}}"
        )
    };
    let data = vec![0; 36_000];
    let own = if binary { "{\"byteLength\":36000}" } else { "{\"uri\":\"a.bin\",\"byteLength\":36000}" };
    let shared_buffers = vec![own; 5000].join(",");
    let primitives = vec![primitive; 5000].join(",");
    let circle = vec!["{\"children\":[0,0,0,0,0,0,0,0,0,0]}"; 1000].join(",");
    let texts = [
        ("20000 nodes of one mesh", json(&nodes, &all, primitive, "", 3000, own)),
        ("5000 primitives in 20000 nodes", json(&nodes, &all, &primitives, "", 3, own)),
        ("elements that lie on each other", json("{\"mesh\":0}", "0", primitive, ",\"byteStride\":4", 8000, own)),
        ("4294967295 elements", json("{\"mesh\":0}", "0", primitive, "", 4_294_967_295, own)),
        ("nodes in circles", json(&circle, "0", primitive, "", 3, own)),
        ("5000 buffers in one file", json("{\"mesh\":0}", "0", primitive, "", 3, &shared_buffers)),
    ];
    let file = |json: &str| {
        if !binary {
            return joined(&[("a.gltf", json.as_bytes()), ("a.bin", &data)]);
        }
        let mut json = json.as_bytes().to_vec();
        json.resize(json.len().next_multiple_of(4), b' ');
        let words = [2, (28 + json.len() + data.len()) as u32, json.len() as u32].map(u32::to_le_bytes).concat();
        [b"glTF", &words[..], b"JSON", &json, &(data.len() as u32).to_le_bytes(), b"BIN\0", &data].concat()
    };
    texts.map(|(name, json)| (name, file(&json))).into()
}

/// Grids of as many nodes as a header can say, with and without what they need.
fn fields() -> Vec<(&'static str, Vec<u8>)> {
    let field = |nodes: u32, colors: u32, stream: &[u8]| {
        let mut head = b"DVRL\x03\0\0\0".to_vec();
        head.extend([nodes, colors].map(u32::to_le_bytes).concat());
        head.extend(0.55f32.to_le_bytes());
        with_checksum(head, stream)
    };
    let noise: Vec<u8> = (0..1u32 << 20).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    vec![
        ("2049 nodes", field(2049, 2049, &[0; 64])),
        ("513 nodes and nothing else", field(513, 257, &[])),
        ("513 nodes of zeros", field(513, 257, &[0; 64])),
        ("513 nodes of ones", field(513, 257, &[0xff; 1 << 16])),
        ("513 nodes of noise", field(513, 257, &noise)),
        ("2 nodes and 513 of colour", field(2, 513, &[0; 8])),
        ("65 nodes, all stored", networks::field_of(65, 33, |[x, y, z]| (x + y + z) % 2 == 0)),
        ("129 nodes, all inside", networks::field_of(129, 65, |_| true)),
    ]
}

/// References that multiply, and keys in keys.
fn yaml() -> Vec<(&'static str, Vec<u8>)> {
    let mut laughs = String::from("a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n");
    for i in 1..12 {
        let again = vec![format!("*a{}", i - 1); 10].join(", ");
        laughs += &format!("a{i}: &a{i} [{again}]\n");
    }
    let deep: String = (0..2000).map(|i| format!("{}a:\n", " ".repeat(i))).collect();
    let itself = "inherit_from: a.yaml\n";
    vec![
        ("references to references", laughs.into_bytes()),
        ("keys in keys", deep.into_bytes()),
        ("lists in lists", nested("[", "]")),
        ("itself", itself.as_bytes().to_vec()),
    ]
}

fn nested(open: &str, close: &str) -> Vec<u8> {
    [open.repeat(20_000), "1".to_owned(), close.repeat(20_000)].concat().into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_claims_much_is_small() {
        for reader in crate::fuzz::READERS {
            for (name, bytes) in claims(reader.name) {
                assert!(bytes.len() < 6_000_000, "{}: {name}: {} bytes", reader.name, bytes.len());
            }
        }
    }
}
