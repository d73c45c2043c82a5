use dvr_core::mesh::{Material, TexturedMesh};
use dvr_core::metrics::Simplification;
use image::RgbaImage;

use super::*;
use crate::atlas::Atlas;
use crate::texture::TextureReport;

/// A mesh over these texture coordinates, as [`crate::texture_mesh`] gives it.
fn textured(mesh: Mesh, size: u32, cover: f64, corner_uvs: Vec<[Vec2; 3]>) -> Textured {
    let picture = RgbaImage::from_pixel(size, size, image::Rgba([128, 128, 128, 255]));
    let materials = vec![Material { base_color: [1.0; 3], texture: Some(Arc::new(picture)) }];
    Textured {
        mesh: TexturedMesh { mesh, corner_uvs, materials, ..TexturedMesh::default() },
        report: TextureReport { size, charts: 1, cover, seen: 1.0, cell: 1, normal_map: None },
    }
}

fn unwrapped(mesh: Mesh, size: u32) -> Textured {
    let atlas = Atlas::unwrap(&mesh, size, 4, &Cancellation::default()).unwrap();
    let uv = |place: Vec2| Vec2::new(place.x / size as f32, 1.0 - place.y / size as f32);
    let corner_uvs = atlas.corners.iter().map(|corners| corners.map(uv)).collect();
    textured(mesh, size, atlas.cover.into(), corner_uvs)
}

/// A ball with dents and bumps, of 81920 faces; it knows its exact normals, or lets its faces tell.
fn bumpy() -> Mesh {
    let mut ball = shapes::icosphere(6, 1.0);
    for vertex in &mut ball.vertices {
        let [x, y, z] = (9.0 * *vertex).to_array().map(f32::sin);
        *vertex *= 1.0 + 0.03 * (x * y + y * z + z * x);
    }
    Mesh { normals: None, ..ball }
}

/// What a renderer sees at a point of a face: the interpolated vertex normal, and the one that the map says.
fn shaded(textured: &Textured, face: usize, weights: [f32; 3]) -> [Vec3; 2] {
    let TexturedMesh { mesh, corner_uvs, normal_map, .. } = &textured.mesh;
    let map = normal_map.as_ref().unwrap();
    let normal = blend(mesh.faces[face].map(|i| mesh.normals.as_ref().unwrap()[i as usize]), weights).normalize();
    let uv: Vec2 = corner_uvs[face].iter().zip(weights).map(|(uv, w)| w * *uv).sum();
    let (x, y) = (uv.x * map.texture.width() as f32 - 0.5, (1.0 - uv.y) * map.texture.height() as f32 - 0.5);
    let at = |dx: u32, dy: u32| {
        let clamped = |c: f32, size: u32| (c.max(0.0) as u32).min(size - 1);
        let (u, v) =
            (clamped(x.floor() + dx as f32, map.texture.width()), clamped(y.floor() + dy as f32, map.texture.height()));
        2.0 / 255.0 * Vec3::from(map.texture.get_pixel(u, v).0.map(f32::from)) - 1.0
    };
    let (s, t) = (x - x.floor(), y - y.floor());
    let texel = at(0, 0).lerp(at(1, 0), s).lerp(at(0, 1).lerp(at(1, 1), s), t);
    let tangents = map.corner_tangents[face];
    let tangent = blend(tangents.map(Vec4::truncate), weights).normalize();
    let bitangent = tangents[0].w * normal.cross(tangent);
    [normal, (texel.x * tangent + texel.y * bitangent + texel.z * normal).normalize()]
}

/// Places on every face.
fn places(mesh: &Mesh) -> impl Iterator<Item = (usize, [f32; 3])> {
    let weights = [[0.34, 0.33, 0.33], [0.7, 0.2, 0.1], [0.1, 0.8, 0.1], [0.05, 0.35, 0.6]];
    (0..mesh.faces.len()).flat_map(move |face| weights.map(|weights| (face, weights)))
}

/// Mean angles in degrees to the full ball's normals, along lines from its middle: of the vertex normals, and of the map.
fn mean_angles(textured: &Textured, full: &Mesh) -> [f64; 2] {
    let (bvh, normals) = (Bvh::new(full), shapes::vertex_normals(&full.vertices, &full.faces));
    let mesh = &textured.mesh.mesh;
    let (mut sums, mut count) = ([0.0; 2], 0);
    for (face, weights) in places(mesh) {
        let direction = blend(mesh.triangle(face), weights).as_dvec3();
        let hit = bvh.closest_hit(&Ray { origin: DVec3::ZERO, direction }, 0.0, 2.0).unwrap();
        let corners = full.faces[hit.face as usize].map(|i| normals[i as usize]);
        let truth = blend(corners, hit.barycentric.map(|w| w as f32)).normalize();
        let angles = shaded(textured, face, weights).map(|normal| f64::from(normal.angle_between(truth).to_degrees()));
        sums = [sums[0] + angles[0], sums[1] + angles[1]];
        count += 1;
    }
    sums.map(|sum| sum / f64::from(count))
}

#[test]
fn a_bumpy_ball_of_few_faces_looks_like_the_full_one() {
    let full = bumpy();
    for (faces, size, factor) in [(3000, 1024, 10.0), (600, 1024, 20.0)] {
        let simple = full.within_faces(faces);
        let moved = Simplification::between(&full, &simple).max_distance;
        let mut textured = unwrapped(simple, size);
        bake_normals(&mut textured, &full, moved, &Cancellation::default()).unwrap();
        let [without, with] = mean_angles(&textured, &full);
        println!("{faces} faces: {without:.2} degrees without, {with:.2} with; {:?}", textured.report);
        assert!(without > factor * with && with < 0.5, "{faces}: {without} without, {with} with");
        assert!(textured.report.normal_map.unwrap().met > 0.97, "{:?}", textured.report);
    }
}

/// A square in the plane z = 0, with a texture that is mirrored or not, and the waves that it stands for.
fn waves(uv: fn(Vec2) -> Vec2) -> (Textured, Mesh) {
    const CELLS: u32 = 60;
    let at = |i: u32| Vec2::new((i % (CELLS + 1)) as f32, (i / (CELLS + 1)) as f32) / CELLS as f32;
    let wave = |p: Vec2| p.extend(0.02 * (12.0 * p.x).sin() + 0.01 * (9.0 * p.y).sin());
    let vertices: Vec<Vec3> = (0..(CELLS + 1).pow(2)).map(|i| wave(at(i))).collect();
    let cell = |i: u32| {
        let a = i / CELLS * (CELLS + 1) + i % CELLS;
        [[a, a + 1, a + CELLS + 2], [a, a + CELLS + 2, a + CELLS + 1]]
    };
    let full = Mesh { vertices, faces: (0..CELLS * CELLS).flat_map(cell).collect(), ..Mesh::default() };
    let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    let faces = vec![[0, 1, 2], [0, 2, 3]];
    let simple = Mesh { vertices: corners.map(|p| p.extend(0.0)).to_vec(), faces, ..Mesh::default() };
    let corner_uvs = simple.faces.iter().map(|face| face.map(|i| uv(corners[i as usize]))).collect();
    (textured(simple, 256, 1.0, corner_uvs), full)
}

#[test]
fn slopes_have_their_sign_on_textures_that_are_mirrored_too() {
    for (uv, w) in [
        ((|p| p) as fn(Vec2) -> Vec2, 1.0),
        (|p| Vec2::new(1.0 - p.x, p.y), -1.0),
        (|p| Vec2::new(p.x, 1.0 - p.y), -1.0),
        (|p| Vec2::new(p.y, 1.0 - p.x), 1.0),
    ] {
        let (mut textured, full) = waves(uv);
        bake_normals(&mut textured, &full, 0.03, &Cancellation::default()).unwrap();
        let tangents = &textured.mesh.normal_map.as_ref().unwrap().corner_tangents;
        assert!(tangents.iter().flatten().all(|tangent| tangent.w == w));
        for (face, weights) in places(&textured.mesh.mesh) {
            let p = blend(textured.mesh.mesh.triangle(face), weights);
            let truth = Vec3::new(-0.24 * (12.0 * p.x).cos(), -0.09 * (9.0 * p.y).cos(), 1.0).normalize();
            let [flat, found] = shaded(&textured, face, weights);
            assert!(found.angle_between(truth) < 0.03, "{found} {truth} at {p}, handedness {w}");
            assert_eq!(flat, Vec3::Z);
        }
    }
    // The picture itself: with the texture as it is, red is larger where the surface falls to the right, and green where it
    // falls upward.
    let (mut textured, full) = waves(|p| p);
    bake_normals(&mut textured, &full, 0.03, &Cancellation::default()).unwrap();
    let picture = &textured.mesh.normal_map.unwrap().texture;
    let texel = |x: f32, y: f32| {
        let edge = picture.width() as f32;
        picture.get_pixel((x * edge) as u32, ((1.0 - y) * edge) as u32).0
    };
    let falls = std::f32::consts::PI / 12.0;
    assert!(texel(falls, 0.5)[0] > 150 && texel(0.005, 0.5)[0] < 106, "{:?}", texel(falls, 0.5));
    assert!(texel(0.5, std::f32::consts::PI / 9.0)[1] > 135 && texel(0.5, 0.005)[1] < 121);
}

#[test]
fn a_mesh_that_was_not_changed_gets_a_flat_map() {
    let ball = shapes::icosphere(3, 1.0);
    let mut textured = unwrapped(ball.clone(), 512);
    bake_normals(&mut textured, &ball, 0.0, &Cancellation::default()).unwrap();
    let picture = &textured.mesh.normal_map.as_ref().unwrap().texture;
    let steepest =
        picture.pixels().map(|texel| NormalMap::direction(texel.0).angle_between(Vec3::Z)).fold(0.0, f32::max);
    assert!(steepest < 0.03, "{steepest}");
}

#[test]
fn another_surface_close_behind_is_not_taken_for_the_own_one() {
    // A thin plate: from the upper side of the simple one, the lower side is as near as the reach.
    let plate = |z: f32| shapes::cuboid(Vec3::new(-1.0, -1.0, -z), Vec3::new(1.0, 1.0, z));
    let mut textured = unwrapped(Mesh { normals: None, ..plate(0.01) }, 256);
    let full = Mesh { normals: None, ..plate(0.012) };
    bake_normals(&mut textured, &full, 0.05, &Cancellation::default()).unwrap();
    let mesh = &textured.mesh.mesh;
    for face in 0..mesh.faces.len() {
        let [a, b, c] = mesh.triangle(face);
        let normal = (b - a).cross(c - a).normalize();
        if normal.z.abs() > 0.5 {
            let found = shaded(&textured, face, [0.34, 0.33, 0.33])[1];
            assert!(found.dot(normal) > 0.5, "{found} {normal}");
        }
    }
}

#[test]
fn the_map_is_no_larger_than_the_full_mesh_asks_for() {
    let simple = shapes::icosphere(2, 1.0);
    let of = |full: &Mesh| {
        let mut textured = unwrapped(simple.clone(), 256);
        bake_normals(&mut textured, full, 0.02, &Cancellation::default()).unwrap();
        textured.report.normal_map.unwrap().size
    };
    assert_eq!((of(&shapes::icosphere(3, 1.0)), of(&shapes::icosphere(5, 1.0))), (128, 256));
}

#[test]
fn nothing_is_baked_from_nothing_and_work_that_is_ended_changes_nothing() {
    let mut textured = unwrapped(shapes::icosphere(1, 1.0), 256);
    let none = bake_normals(&mut textured, &Mesh::default(), 0.1, &Cancellation::default());
    assert!(matches!(none, Err(TextureError::NoFaces)));
    let ended = Cancellation::default();
    ended.cancel();
    assert!(matches!(bake_normals(&mut textured, &bumpy(), 0.1, &ended), Err(TextureError::Cancelled(_))));
    assert!(textured.mesh.normal_map.is_none() && textured.report.normal_map.is_none());
}
