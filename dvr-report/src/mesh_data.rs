//! A mesh as text that a page can hold: simplified to what a screen shows, quantised, in differences, deflated, in
//! base64.
//!
//! The bytes before deflating, little end first: the vertices' positions (three of 16 bits), normals (octahedral, two
//! of 8 bits), colours (three of 8 bits), confidence (8 bits) and views (8 bits), each component by itself as zigzag
//! differences from the vertex before; with a texture, its coordinates (two of 16 bits) in the same way; then the corners of the faces, each as a number of 7 bits a byte that says how
//! far it lies below the next vertex not yet named. Neighbours in the file are neighbours on the surface, so that most
//! bytes are small. `assets/mesh.js` reads it.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use dvr_core::Observation;
use dvr_core::mesh::{Mesh, shapes};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::{Vec2, Vec3};
use meshopt::SimplifyOptions;

/// How much a difference of colour, of the whole range, counts against moving the surface by the object's size.
const COLOR_WEIGHT: f32 = 0.3;

/// How much a difference of texture coordinates, of the whole texture, counts.
const UV_WEIGHT: f32 = 1.0;

/// How much a difference of confidence counts.
const CONFIDENCE_WEIGHT: f32 = 0.1;

/// A mesh for a page.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodedMesh {
    /// Base64 of the deflated bytes.
    pub text: String,
    /// Vertices that are left.
    pub vertices: usize,
    /// Faces that are left.
    pub faces: usize,
    /// Smallest and largest coordinates: positions are 65535ths from one to the other.
    pub bounds: [Vec3; 2],
}

/// Encodes a mesh with at most about `max_faces` faces; colours are white and observations zero where it has none. `uvs`
/// are texture coordinates of its vertices, (0, 0) the bottom left corner; empty for a mesh without a texture.
/// `None` for a mesh without faces.
pub fn encode(mesh: &Mesh, uvs: &[Vec2], max_faces: usize) -> Option<EncodedMesh> {
    let (low, high) = mesh.bounds().filter(|_| !mesh.is_empty())?;
    let corners = meshopt::optimize_vertex_cache(&simplified(mesh, uvs, max_faces), mesh.vertices.len());
    let (used, corners) = numbered(&corners, mesh.vertices.len());

    let normals = match &mesh.normals {
        Some(normals) => normals.clone(),
        None => shapes::vertex_normals(&mesh.vertices, &mesh.faces),
    };
    let extent = (high - low).max(Vec3::splat(1e-9));
    let mut bytes = Vec::new();
    for axis in 0..3 {
        push_shares(&mut bytes, used.iter().map(|&i| (mesh.vertices[i][axis] - low[axis]) / extent[axis]));
    }
    let mut component = |values: &dyn Fn(usize) -> u8| {
        bytes.extend(differences(used.iter().map(|&i| values(i)), |a, b| {
            let difference = a.wrapping_sub(b) as i8;
            ((difference << 1) ^ (difference >> 7)) as u8
        }));
    };
    for axis in 0..2 {
        component(&|i| (octahedral(normals[i])[axis] * 127.5 + 127.5).round() as u8);
    }
    for channel in 0..3 {
        component(&|i| mesh.colors.as_ref().map_or(255, |colors| byte(colors[i][channel])));
    }
    let observation = |i: usize| mesh.observations.as_ref().map_or(Observation::default(), |seen| seen[i]);
    // What was seen at all, however badly, is never rounded to what was not.
    component(&|i| byte(observation(i).confidence).max(u8::from(observation(i).views > 0)));
    component(&|i| observation(i).views.min(255) as u8);
    if !uvs.is_empty() {
        push_shares(&mut bytes, used.iter().map(|&i| uvs[i].x));
        push_shares(&mut bytes, used.iter().map(|&i| uvs[i].y));
    }
    push_corners(&mut bytes, &corners);

    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    // Writing to memory cannot fail.
    encoder.write_all(&bytes).ok()?;
    let text = STANDARD.encode(encoder.finish().ok()?);
    Some(EncodedMesh { text, vertices: used.len(), faces: corners.len() / 3, bounds: [low, high] })
}

/// The corners of at most about `max_faces` faces that show the same surface in the same colours.
fn simplified(mesh: &Mesh, uvs: &[Vec2], max_faces: usize) -> Vec<u32> {
    let corners: Vec<u32> = mesh.faces.iter().flatten().copied().collect();
    if mesh.faces.len() <= max_faces {
        return corners;
    }
    let positions: Vec<[f32; 3]> = mesh.vertices.iter().map(Vec3::to_array).collect();
    let attributes: Vec<f32> = (0..mesh.vertices.len())
        .flat_map(|i| {
            let [r, g, b] = mesh.colors.as_ref().map_or([1.0; 3], |colors| colors[i]);
            let seen = mesh.observations.as_ref().map_or(0.0, |observations| observations[i].confidence);
            let uv = uvs.get(i).copied().unwrap_or_default();
            [r, g, b, seen, uv.x, uv.y]
        })
        .collect();
    let weights = [COLOR_WEIGHT, COLOR_WEIGHT, COLOR_WEIGHT, CONFIDENCE_WEIGHT, UV_WEIGHT, UV_WEIGHT];
    let unlocked = vec![false; mesh.vertices.len()];
    meshopt::simplify_with_attributes_and_locks_decoder(
        &corners,
        &positions,
        &attributes,
        &weights,
        weights.len() * size_of::<f32>(),
        &unlocked,
        3 * max_faces,
        1.0,
        SimplifyOptions::None,
        None,
    )
}

/// The vertices in the order in which corners first name them, and the corners by that order.
fn numbered(corners: &[u32], vertices: usize) -> (Vec<usize>, Vec<u32>) {
    let mut place = vec![u32::MAX; vertices];
    let mut used = Vec::new();
    let number = |&corner: &u32| {
        let place = &mut place[corner as usize];
        if *place == u32::MAX {
            *place = used.len() as u32;
            used.push(corner as usize);
        }
        *place
    };
    let corners = corners.iter().map(number).collect();
    (used, corners)
}

/// Each corner as its distance from the next vertex that was not named yet, seven bits a byte, the lowest first.
fn push_corners(bytes: &mut Vec<u8>, corners: &[u32]) {
    let mut next = 0;
    for &corner in corners {
        let mut code = next - corner;
        next += u32::from(code == 0);
        while code >= 0x80 {
            bytes.push(code as u8 | 0x80);
            code >>= 7;
        }
        bytes.push(code as u8);
    }
}

/// Shares in `[0, 1]` as 16 bits: zigzag differences, all low bytes, then all high ones, most of which are zero.
fn push_shares(bytes: &mut Vec<u8>, shares: impl Iterator<Item = f32>) {
    let quantised = shares.map(|share| (share.clamp(0.0, 1.0) * 65535.0).round() as u16);
    let differences = differences(quantised, |a, b| {
        let difference = a.wrapping_sub(b) as i16;
        ((difference << 1) ^ (difference >> 15)) as u16
    });
    bytes.extend(differences.iter().map(|d| *d as u8));
    bytes.extend(differences.iter().map(|d| (d >> 8) as u8));
}

/// Each value's difference from the one before, the first one's from zero.
fn differences<T: Copy + Default>(values: impl Iterator<Item = T>, difference: impl Fn(T, T) -> T) -> Vec<T> {
    let mut before = T::default();
    values.map(|value| difference(value, std::mem::replace(&mut before, value))).collect()
}

/// A share in `[0, 1]` as a byte.
fn byte(share: f32) -> u8 {
    (share.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// A unit vector on the unfolded octahedron, `[-1, 1]^2`. (Cigolle et al. 2014, "A survey of efficient representations
/// for independent unit vectors".)
fn octahedral(normal: Vec3) -> Vec2 {
    let n = normal / normal.abs().element_sum().max(1e-9);
    if n.z >= 0.0 {
        return Vec2::new(n.x, n.y);
    }
    let sign = |value: f32| if value >= 0.0 { 1.0 } else { -1.0 };
    Vec2::new((1.0 - n.y.abs()) * sign(n.x), (1.0 - n.x.abs()) * sign(n.y))
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    /// What the page's script does: positions of the vertices, views of each, and faces.
    fn decode(encoded: &EncodedMesh) -> (Vec<Vec3>, Vec<u8>, Vec<[u32; 3]>) {
        let deflated = STANDARD.decode(&encoded.text).unwrap();
        let mut bytes = Vec::new();
        flate2::read::ZlibDecoder::new(deflated.as_slice()).read_to_end(&mut bytes).unwrap();
        let n = encoded.vertices;
        let [low, high] = encoded.bounds;
        let mut positions = vec![Vec3::ZERO; n];
        for axis in 0..3 {
            let mut value = 0u16;
            for i in 0..n {
                let code = u16::from(bytes[2 * axis * n + i]) | u16::from(bytes[(2 * axis + 1) * n + i]) << 8;
                value = value.wrapping_add((code >> 1) ^ (code & 1).wrapping_neg());
                positions[i][axis] = low[axis] + (high - low)[axis] * f32::from(value) / 65535.0;
            }
        }
        let mut views = 0u8;
        let of_views = bytes[12 * n..13 * n].iter().map(|&code| {
            views = views.wrapping_add((code >> 1) ^ (code & 1).wrapping_neg());
            views
        });
        let of_views = of_views.collect();
        let (mut at, mut next) = (13 * n, 0);
        let corners: Vec<u32> = (0..3 * encoded.faces)
            .map(|_| {
                let (mut code, mut shift) = (0u32, 0);
                loop {
                    code |= u32::from(bytes[at] & 0x7f) << shift;
                    (at, shift) = (at + 1, shift + 7);
                    if bytes[at - 1] < 0x80 {
                        break;
                    }
                }
                let corner = next - code;
                next += u32::from(code == 0);
                corner
            })
            .collect();
        assert_eq!(at, bytes.len());
        (positions, of_views, corners.as_chunks::<3>().0.to_vec())
    }

    #[test]
    fn a_mesh_comes_back_to_a_65535th_of_its_size() {
        let mut mesh = shapes::torus(0.3, 0.1, 40, 20);
        let seen = |v: &Vec3| Observation { views: if v.x > 0.0 { 300 } else { 0 }, confidence: 0.5 };
        mesh.observations = Some(mesh.vertices.iter().map(seen).collect());
        let encoded = encode(&mesh, &[], 1_000_000).unwrap();
        let (positions, views, faces) = decode(&encoded);
        assert_eq!((positions.len(), faces.len()), (mesh.vertices.len(), mesh.faces.len()));
        // The order is another one: faces are known by their middles.
        let middles = |vertices: &[Vec3], faces: &[[u32; 3]]| -> Vec<Vec3> {
            faces.iter().map(|face| face.iter().map(|&i| vertices[i as usize]).sum::<Vec3>() / 3.0).collect()
        };
        let expected = middles(&mesh.vertices, &mesh.faces);
        let is_there = |found: &Vec3| expected.iter().any(|middle| (*middle - *found).length() < 2e-5);
        assert!(middles(&positions, &faces).iter().all(is_there));
        assert!(positions.iter().zip(&views).all(|(v, &n)| v.x.abs() < 1e-5 || n == if v.x > 0.0 { 255 } else { 0 }));
    }

    #[test]
    fn a_large_mesh_is_simplified_and_small_to_store() {
        let mesh = shapes::icosphere(6, 0.4);
        let encoded = encode(&mesh, &[], 20_000).unwrap();
        assert!(encoded.faces <= 20_000 && encoded.faces > 10_000, "{}", encoded.faces);
        assert!(encoded.text.len() < 20_000 * 12, "{} characters", encoded.text.len());
        let (positions, ..) = decode(&encoded);
        assert!(positions.iter().all(|v| (v.length() - 0.4).abs() < 1e-3));
        assert!(encode(&Mesh::default(), &[], 10).is_none());
    }
}
