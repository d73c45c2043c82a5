//! Rendered datasets against what is known by formula.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use dvr_core::Cancellation;
use dvr_core::dataset::{Normalise, ReadOptions, read_scene};
use dvr_core::files::{read_depth_exr, read_mask, read_rgb};
use dvr_core::mesh::{Material, Mesh, TexturedMesh, read_mesh, shapes, write_mesh};
use dvr_core::npz::NpzFile;
use dvr_core::synth::{
    CameraPlacement, CorpusObject, DirectionalLight, EdgeColor, Gloss, Lighting, MeshRenderer, RenderedView,
    SplitRatios, SynthConfig, render_corpus, render_dataset,
};
use dvr_core::{Camera, DepthMap, Error, Scene};
use dvr_test_support::test_with;
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4, Vec2, Vec3};

fn textured(mesh: Mesh) -> TexturedMesh {
    TexturedMesh { mesh, ..TexturedMesh::default() }
}

fn small() -> SynthConfig {
    SynthConfig { views: 3, surface_points: 500, occupancy_points: 500, ..SynthConfig::default() }
}

fn quiet(_: usize, _: usize) {}

/// From the front, 2 units away, y up.
fn front_camera(size: u32) -> Camera {
    Camera::look_at(size, size, f64::from(size), DVec3::Z * 2.0, DVec3::ZERO, DVec3::Y)
}

fn render(mesh: &TexturedMesh, config: &SynthConfig) -> RenderedView {
    MeshRenderer::new(mesh, config).render(&front_camera(64), 0)
}

/// Colours as they are, without shading.
fn flat_light() -> Lighting {
    Lighting { ambient: 1.0, lights: Vec::new(), ..Lighting::default() }
}

#[test]
fn a_sphere_looks_as_the_formula_says() {
    let (radius, distance) = (0.45, 2.0);
    let sphere = textured(shapes::icosphere(6, radius as f32));
    let (config, camera) = (SynthConfig::default(), front_camera(64));
    let view = MeshRenderer::new(&sphere, &config).render(&camera, 0);
    // A cone of half angle asin(r/D) touches the sphere.
    let silhouette = 64.0 * f64::tan(f64::asin(radius / distance));
    let area = std::f64::consts::PI * silhouette * silhouette;
    assert!((view.mask.object_pixels() as f64 / area - 1.0).abs() < 0.01);
    for v in 0..64 {
        for u in 0..64 {
            let center = DVec2::new(f64::from(u) + 0.5, f64::from(v) + 0.5);
            let from_edge = center.distance(DVec2::splat(32.0)) - silhouette;
            if from_edge.abs() > 1.0 {
                assert_eq!(view.mask.is_object(u, v), from_edge < 0.0);
            }
            let ray = camera.ray(center);
            let (a, b) = (ray.direction.length_squared(), ray.origin.dot(ray.direction));
            let discriminant = b * b - a * (ray.origin.length_squared() - radius * radius);
            // The mesh's facets lie a little inside; at grazing rays that is far along the ray.
            if discriminant > 0.02 {
                let z = (-b - discriminant.sqrt()) / a;
                assert!((f64::from(view.depth.get(u, v)) - z).abs() < 1e-4, "pixel {u}, {v}");
            } else if discriminant < 0.0 {
                assert_eq!(view.depth.get(u, v), f32::INFINITY);
            }
            if !view.mask.is_object(u, v) {
                assert_eq!(view.image.get_pixel(u, v).0, [255; 3], "the background is white");
            }
        }
    }
}

#[test]
fn a_texture_is_upright_and_not_mirrored() {
    let [red, green, blue, grey] = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [90, 90, 90]];
    let mut texture = image::RgbaImage::new(64, 64);
    for (u, v, pixel) in texture.enumerate_pixels_mut() {
        let [r, g, b] = [[red, green], [blue, grey]][usize::from(v >= 32)][usize::from(u >= 32)];
        *pixel = image::Rgba([r, g, b, 255]);
    }
    let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    let faces = [[0, 1, 2], [0, 2, 3]];
    let quad = TexturedMesh {
        mesh: Mesh {
            vertices: corners.map(|c| (c - 0.5).extend(0.0)).to_vec(),
            faces: faces.map(|f| f.map(|i| i as u32)).to_vec(),
            ..Mesh::default()
        },
        corner_uvs: faces.map(|f: [usize; 3]| f.map(|i| corners[i])).to_vec(),
        materials: vec![Material { base_color: [1.0; 3], texture: Some(Arc::new(texture)) }],
        ..TexturedMesh::default()
    };
    let view = render(&quad, &SynthConfig { lighting: flat_light(), ..SynthConfig::default() });
    let at = |u, v| view.image.get_pixel(u, v).0;
    assert_eq!([at(24, 24), at(40, 24), at(24, 40), at(40, 40)], [red, green, blue, grey]);
}

#[test]
fn light_comes_from_where_it_is_said_to_and_shadows_fall_away_from_it() {
    // A small plate floats over a large one; the camera looks down on both, slanted.
    let plate = |low: Vec3, high: Vec3| shapes::cuboid(low, high);
    let scene = textured(shapes::union([
        plate(Vec3::new(-0.5, -0.1, -0.5), Vec3::new(0.5, 0.0, 0.5)),
        plate(Vec3::new(-0.1, 0.3, -0.1), Vec3::new(0.1, 0.31, 0.1)),
    ]));
    let sun = DirectionalLight { direction: DVec3::new(-1.0, 1.0, 0.0), intensity: 0.8 };
    let lighting = Lighting { ambient: 0.1, lights: vec![sun], shadows: true, ..Lighting::default() };
    let config = SynthConfig { lighting, ..SynthConfig::default() };
    let camera = Camera::look_at(128, 128, 128.0, DVec3::new(0.0, 1.5, 1.0), DVec3::ZERO, DVec3::Y);
    let view = MeshRenderer::new(&scene, &config).render(&camera, 0);
    let brightness = |point: DVec3| {
        let (pixel, _) = camera.project(point);
        view.image.get_pixel(pixel.x as u32, pixel.y as u32).0[0]
    };
    // The light comes from -x, so the shadow of the plate at height 0.3 lies at x = 0.3.
    let (lit, shadow) = (brightness(DVec3::new(-0.35, 0.0, 0.3)), brightness(DVec3::new(0.3, 0.0, 0.0)));
    assert!(lit > 120 && shadow < 90, "{lit} {shadow}");
}

#[test]
fn highlights_sit_where_the_surface_mirrors_the_light() {
    let sphere = textured(shapes::icosphere(5, 0.45));
    let shiny = Lighting { ambient: 0.2, lights: Vec::new(), headlight: 0.5, specular: 1.0, ..Lighting::default() };
    let view = render(&sphere, &SynthConfig { lighting: shiny, ..SynthConfig::default() });
    let at = |u, v| i32::from(view.image.get_pixel(u, v).0[0]);
    assert!(at(32, 32) > at(38, 32) + 30 && at(38, 32) > at(42, 32), "bright in the middle");
}

#[test]
fn pixels_of_the_silhouette_are_the_objects_or_mixed_as_asked() {
    let red = Material { base_color: [1.0, 0.0, 0.0], texture: None };
    let sphere = TexturedMesh { materials: vec![red], ..textured(shapes::icosphere(4, 0.4)) };
    let config = SynthConfig { lighting: flat_light(), ..SynthConfig::default() };
    let pure = render(&sphere, &config);
    assert!(pure.image.pixels().all(|p| p.0 == [255, 0, 0] || p.0 == [255; 3]));
    let mixed = render(&sphere, &SynthConfig { edge_color: EdgeColor::Mixed, ..config });
    assert!(mixed.image.pixels().any(|p| p.0[1] > 20 && p.0[1] < 235));
    assert_eq!((&mixed.mask, &mixed.depth), (&pure.mask, &pure.depth));
}

#[test]
fn noise_and_exposure_change_pictures_and_nothing_else() {
    let sphere = textured(shapes::icosphere(3, 0.4));
    let clean = render(&sphere, &SynthConfig::default());
    let noisy = SynthConfig { noise: 0.02, exposure_jitter: 0.3, ..SynthConfig::default() };
    let renderer = MeshRenderer::new(&sphere, &noisy);
    let (first, second) = (renderer.render(&front_camera(64), 0), renderer.render(&front_camera(64), 1));
    assert_eq!((&first.mask, &first.depth), (&clean.mask, &clean.depth));
    let mean = |view: &RenderedView| {
        let values = || (26..38).flat_map(|v| (26..38).map(move |u| f64::from(view.image.get_pixel(u, v).0[0])));
        values().sum::<f64>() / values().count() as f64
    };
    assert!((mean(&first) - mean(&second)).abs() > 2.0, "the exposure differs between views");
    assert_eq!(first, renderer.render(&front_camera(64), 0), "the same view has the same noise");
}

#[test]
fn a_white_balance_that_differs_changes_red_and_blue_and_leaves_green() {
    let sphere = textured(shapes::icosphere(3, 0.4));
    let config = SynthConfig { lighting: flat_light(), noise: 0.01, ..SynthConfig::default() };
    let renderer = |config| MeshRenderer::new(&sphere, config).render(&front_camera(64), 3);
    let dim = SynthConfig { lighting: Lighting { ambient: 0.2, ..flat_light() }, ..config };
    let jittered = SynthConfig { white_balance_jitter: 0.5, ..dim.clone() };
    let (plain, tinted) = (renderer(&dim), renderer(&jittered));
    let of = |view: &RenderedView, channel: usize| i32::from(view.image.get_pixel(32, 32).0[channel]);
    assert_eq!(of(&plain, 1), of(&tinted, 1), "green, its noise included");
    let moved = [0, 2].map(|channel| of(&tinted, channel) - of(&plain, channel));
    assert!(moved.iter().all(|d| d.abs() > 2) && moved[0] != moved[1], "{moved:?}");
    assert_eq!(tinted.mask, plain.mask);
}

#[test]
fn a_glossy_ball_mirrors_a_light_where_it_should_and_the_reflection_moves_with_the_view() {
    let sphere = textured(shapes::icosphere(5, 0.45));
    let light = DirectionalLight { direction: DVec3::Z, intensity: 0.05 };
    let gloss = Gloss { roughness: 0.1, metallic: 1.0, light_half_angle: 10.0 };
    let lighting = Lighting { ambient: 0.05, lights: vec![light], gloss: Some(gloss), ..Lighting::default() };
    let config = SynthConfig { lighting, ..SynthConfig::default() };
    let renderer = MeshRenderer::new(&sphere, &config);
    for degrees in [0.0f64, 40.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let eye = 1.5 * DVec3::new(sin, 0.0, cos);
        let camera = Camera::look_at(64, 64, 56.0, eye, DVec3::ZERO, DVec3::Y);
        let view = renderer.render(&camera, 0);
        // The normal is halfway between light and camera, nearly: the camera is near.
        let pixels = (0..64 * 64).map(|i| (i % 64, i / 64)).filter(|&(u, v)| view.mask.is_object(u, v));
        let (u, v) = pixels.max_by_key(|&(u, v)| view.image.get_pixel(u, v).0[0]).unwrap();
        let brightest = DVec2::new(f64::from(u), f64::from(v)) + 0.5;
        let (sin, cos) = (0.5 * degrees).to_radians().sin_cos();
        let (expected, _) = camera.project(0.45 * DVec3::new(sin, 0.0, cos));
        assert!((brightest - expected).length() < 5.0, "{degrees}: {brightest} instead of {expected}");
    }
}

struct ReadBack {
    folder: PathBuf,
    arrays: NpzFile,
}

impl ReadBack {
    fn open(folder: PathBuf) -> Self {
        Self { arrays: NpzFile::open(&folder.join("cameras.npz")).unwrap(), folder }
    }

    fn matrix(&mut self, kind: &str, view: usize) -> DMat4 {
        let array = self.arrays.read(&format!("{kind}_{view}")).unwrap();
        assert_eq!(array.shape, [4, 4]);
        DMat4::from_cols_slice(&array.to_f64()).transpose()
    }

    /// Pixel and z of a point of object space, by the three matrices as the original multiplies them.
    fn project(&mut self, point: Vec3, view: usize, size: (u32, u32)) -> (DVec2, f64) {
        let world = self.matrix("world_mat", view) * self.matrix("scale_mat", view);
        let p: DVec4 = self.matrix("camera_mat", view) * world * point.as_dvec3().extend(1.0);
        let unit = DVec2::new(p.x, p.y) / p.z;
        (0.5 * (unit + 1.0) * DVec2::new(size.0.into(), size.1.into()), p.z)
    }

    fn points(&self, file: &str) -> Vec<Vec3> {
        let array = NpzFile::open(&self.folder.join(file)).unwrap().read("points").unwrap();
        array.to_f32().chunks_exact(3).map(Vec3::from_slice).collect()
    }
}

#[test]
fn the_files_agree_with_each_other_in_the_meshs_own_units() {
    // A torus three metres wide and one high, far from the origin, in pictures that are not square.
    let offset = Vec3::new(40.0, -7.0, 12.0);
    let mut mesh = shapes::torus(1.0, 0.5, 96, 48);
    mesh.vertices.iter_mut().for_each(|v| *v += offset);
    let out = tempfile::tempdir().unwrap();
    let config = SynthConfig { width: 96, height: 64, ..small() };
    render_dataset(&textured(mesh), "ring", "things", out.path(), &config, &quiet).unwrap();
    let mut files = ReadBack::open(out.path().join("things/ring"));
    let scale = 3.0 / 0.9;
    assert!((files.matrix("scale_mat", 0).x_axis.x - scale).abs() < 1e-6);
    let in_world = files.matrix("scale_mat", 0).transform_point3(DVec3::ZERO);
    assert!((in_world - offset.as_dvec3()).length() < 1e-5);
    let points = files.points("pointcloud.npz");
    assert_eq!(points.len(), 500);
    for view in 0..3 {
        let name = |kind: &str, end: &str| files.folder.join(format!("{kind}/{view:04}.{end}"));
        let mask = read_mask(&name("mask", "png")).unwrap();
        let depth = read_depth_exr(&name("depth", "exr")).unwrap();
        assert_eq!(read_rgb(&name("image", "png")).unwrap().dimensions(), (96, 64));
        assert_eq!((mask.size(), depth.width, depth.height), ((96, 64), 96, 64));
        let (mut seen, mut inside, mut before) = (0, 0, 0);
        for &point in &points {
            let (pixel, z) = files.project(point, view, (96, 64));
            let (u, v) = (pixel.x as u32, pixel.y as u32);
            inside += usize::from(mask.is_object(u, v));
            // Pixels that the object fills by less than half are not in the mask, but then a neighbour is.
            let mut around = (v - 1..=v + 1).flat_map(|v| (u - 1..=u + 1).map(move |u| (u, v)));
            assert!(around.any(|(u, v)| mask.is_object(u, v)), "a point of the surface is outside the mask");
            let surface = f64::from(depth.get(u, v));
            seen += usize::from((z - surface).abs() < 0.2);
            // On the rims the centre of the pixel may see what lies behind.
            before += usize::from(surface.is_finite() && z < surface - 0.2);
        }
        // From the side a quarter of a torus is visible, from above nearly half.
        assert!(inside > 450 && seen > 90 && before < 25, "{inside} {seen} {before}");
    }
    let occupied = NpzFile::open(&files.folder.join("points.npz")).unwrap().read("occupancies").unwrap().to_bool();
    for (point, occupied) in files.points("points.npz").iter().zip(occupied) {
        let to_ring = Vec2::new(point.x.hypot(point.z) - 0.3, point.y).length();
        assert!((to_ring < 0.15) == occupied || (to_ring - 0.15).abs() < 0.002);
    }
}

#[test]
fn the_reader_finds_what_was_rendered() {
    let mut ball = shapes::icosphere(5, 5.0);
    ball.vertices.iter_mut().for_each(|v| v.x += 100.0);
    let out = tempfile::tempdir().unwrap();
    render_dataset(&textured(ball), "ball", "things", out.path(), &small(), &quiet).unwrap();
    let scene = Scene::read(out.path().join("things/ball")).unwrap();
    assert_eq!((scene.views.len(), scene.format), (3, "DVR"));
    assert!((scene.object_to_world.scale - 10.0 / 0.9).abs() < 1e-5);
    assert!((scene.object_to_world.translation - DVec3::X * 100.0).length() < 1e-4);
    for view in &scene.views {
        // The ball has radius 0.45 in object space, seen from 1.5.
        let depth = view.depth.as_ref().unwrap();
        let ray = view.camera.pixel_ray(34, 30);
        let (a, b) = (ray.direction.length_squared(), ray.origin.dot(ray.direction));
        let z = (-b - (b * b - a * (1.5 * 1.5 - 0.45 * 0.45)).sqrt()) / a;
        assert!((f64::from(depth.get(34, 30)) - z).abs() < 1e-3);
        assert!(view.is_object(34, 30) && depth.get(0, 0) == f32::INFINITY);
    }
    let surface = scene.ground_truth.surface.unwrap();
    assert!(surface.points.iter().all(|p| (p.length() - 0.45).abs() < 1e-3));
    let outward = surface.points.iter().zip(surface.normals.unwrap()).all(|(p, n)| p.normalize().dot(n) > 0.99);
    assert!(outward, "normals point outwards");
}

#[test]
fn a_scene_that_is_read_again_at_the_place_it_had_is_the_same_bit_for_bit() {
    let out = tempfile::tempdir().unwrap();
    for (i, radius) in [5.0, 0.7, 1.3, 2.9, 0.31, 11.7].into_iter().enumerate() {
        let mut ball = shapes::icosphere(2, radius);
        ball.vertices.iter_mut().for_each(|v| v.y += 0.37);
        let name = format!("ball{i}");
        render_dataset(&textured(ball), &name, "things", out.path(), &small(), &quiet).unwrap();
        let folder = out.path().join("things").join(name);
        let scene = Scene::read(&folder).unwrap();
        let placed = ReadOptions { normalise: Normalise::Given(scene.object_to_world), ..ReadOptions::default() };
        let again = read_scene(&folder, &placed).unwrap();
        assert_eq!(again.object_to_world, scene.object_to_world, "radius {radius}");
        for (again, view) in again.views.iter().zip(&scene.views) {
            assert_eq!(again.camera, view.camera, "radius {radius}");
        }
    }
}

#[test]
fn the_demo_scene_is_small_and_sound() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenes"));
    let size: usize = bytes_below(folder).iter().map(|(_, bytes)| bytes.len()).sum();
    assert!(size < 1_500_000, "{size} bytes");
    let scene = Scene::read(folder.join("mug/mug")).unwrap();
    assert_eq!(scene.warnings, Vec::<String>::new());
    assert_eq!(scene.views.len(), 28);
    let occupancy = scene.ground_truth.occupancy.unwrap();
    let inside = |test: &dyn Fn(Vec3) -> bool| {
        let chosen: Vec<bool> =
            occupancy.points.iter().zip(&occupancy.inside).filter(|(p, _)| test(**p)).map(|(_, &o)| o).collect();
        assert!(chosen.len() > 20, "too few points to tell");
        chosen.iter().filter(|&&o| o).count() as f64 / chosen.len() as f64
    };
    // The vessel's axis is left of the middle, as the handle is on the right.
    let from_axis = |p: Vec3| Vec2::new(p.x + 0.12, p.z).length();
    assert_eq!(inside(&|p| from_axis(p) < 0.22 && p.y.abs() < 0.25), 0.0, "a mug is empty");
    assert!(inside(&|p| (from_axis(p) - 0.32).abs() < 0.03 && p.y.abs() < 0.25) > 0.5, "its wall is not");
}

fn bytes_below(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files = Vec::new();
    let mut stack = vec![folder.to_owned()];
    while let Some(path) = stack.pop() {
        if path.is_dir() {
            stack.extend(std::fs::read_dir(&path).unwrap().map(|e| e.unwrap().path()));
        } else {
            files.push((path.strip_prefix(folder).unwrap().to_owned(), std::fs::read(&path).unwrap()));
        }
    }
    files.sort();
    files
}

#[test]
fn equal_seeds_give_equal_files_on_any_number_of_threads() {
    let mesh = textured(shapes::wire_cube(0.9, 0.04));
    let dataset = |threads: usize, seed: u64| {
        let out = tempfile::tempdir().unwrap();
        let config = SynthConfig { seed, noise: 0.01, exposure_jitter: 0.1, width: 32, height: 32, ..small() };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| render_dataset(&mesh, "rods", "shapes", out.path(), &config, &quiet)).unwrap();
        bytes_below(out.path())
    };
    let one = dataset(1, 7);
    assert_eq!(one.len(), 3 * 3 + 3 + 3 + 1);
    assert!(one == dataset(3, 7));
    assert!(one != dataset(1, 8));
}

#[test]
fn open_meshes_are_seen_from_both_sides_and_hollow_ones_are_hollow() {
    let sheet = Mesh {
        vertices: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec(),
        faces: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    let mut inner = shapes::cuboid(Vec3::splat(-0.6), Vec3::splat(0.6));
    inner.faces.iter_mut().for_each(|f| f.swap(0, 1));
    let shell = shapes::union([shapes::cuboid(Vec3::splat(-1.0), Vec3::splat(1.0)), inner]);
    let out = tempfile::tempdir().unwrap();
    let config = SynthConfig { views: 6, placement: CameraPlacement::Ring { elevation: 10.0 }, ..small() };
    render_dataset(&textured(sheet), "sheet", "open", out.path(), &config, &quiet).unwrap();
    render_dataset(&textured(shell), "shell", "hollow", out.path(), &config, &quiet).unwrap();
    let folder = out.path().join("open/sheet");
    let seen = |view: usize| read_mask(&folder.join(format!("mask/{view:04}.png"))).unwrap().object_pixels();
    assert!((0..6).filter(|&view| seen(view) > 100).count() >= 4, "most sides show the sheet");
    let files = ReadBack::open(out.path().join("hollow/shell"));
    let occupied = NpzFile::open(&files.folder.join("points.npz")).unwrap().read("occupancies").unwrap().to_bool();
    let in_cavity = |p: &Vec3| p.abs().max_element() < 0.26;
    let points = files.points("points.npz");
    assert!(points.iter().any(in_cavity) && occupied.iter().any(|&o| o));
    assert!(points.iter().zip(&occupied).all(|(p, &occupied)| !(occupied && in_cavity(p))));
}

#[test]
fn what_cannot_be_rendered_leaves_nothing_behind() {
    let out = tempfile::tempdir().unwrap();
    let sphere = textured(shapes::icosphere(1, 1.0));
    let point = textured(Mesh { vertices: vec![Vec3::ONE; 3], faces: vec![[0, 1, 2]], ..Mesh::default() });
    for (mesh, name) in [(&TexturedMesh::default(), "empty"), (&point, "point"), (&sphere, "../up"), (&sphere, "")] {
        let error = render_dataset(mesh, name, "c", out.path(), &small(), &quiet).unwrap_err();
        assert!(matches!(error, Error::NoExtent { .. } | Error::FolderName { .. }), "{error}");
    }
    assert!(bytes_below(out.path()).is_empty());
    render_dataset(&sphere, "ball", "c", out.path(), &small(), &quiet).unwrap();
    let before = bytes_below(out.path());
    assert!(render_dataset(&sphere, "ball", "c", out.path(), &small(), &quiet).is_err(), "it is there already");
    assert!(before == bytes_below(out.path()));
}

#[test]
fn a_collection_is_rendered_divided_and_taken_up_again() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("dataset");
    let mut objects = Vec::new();
    for i in 0..5 {
        let mesh = folder.path().join(format!("{i}.ply"));
        write_mesh(&mesh, &shapes::icosphere(1, 1.0 + i as f32)).unwrap();
        objects.push(CorpusObject { name: format!("ball{i}"), category: "ball".to_owned(), mesh });
    }
    std::fs::write(folder.path().join("3.ply"), "ply, but not really").unwrap();
    objects.push(CorpusObject { name: "gone".into(), category: "chair".into(), mesh: "gone.obj".into() });
    let config = SynthConfig { views: 2, width: 16, height: 16, ..small() };
    let mut steps = Vec::new();
    let ratios = SplitRatios { val: 0.25, test: 0.25 };
    let report = render_corpus(&objects, &out, &config, ratios, &Cancellation::default(), &mut |done, total| {
        steps.push((done, total))
    })
    .unwrap();
    assert_eq!(report.rendered.len(), 4);
    let skipped: Vec<_> = report.skipped.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(skipped, ["ball/ball3", "chair/gone"]);
    assert_eq!(steps.last(), Some(&(6, 6)));
    let list = |name: &str| std::fs::read_to_string(out.join("ball").join(name)).unwrap().lines().count();
    assert_eq!((list("train.lst"), list("val.lst"), list("test.lst")), (2, 1, 1));
    assert!(std::fs::read_to_string(out.join("metadata.yaml")).unwrap().contains("\"ball\":"));
    let again = render_corpus(&objects, &out, &config, ratios, &Cancellation::default(), &mut quiet).unwrap();
    assert_eq!((again.rendered.len(), again.kept.len(), again.skipped.len()), (0, 4, 2));
    assert!(
        render_corpus(
            &[objects[0].clone(), objects[0].clone()],
            &out,
            &config,
            ratios,
            &Cancellation::default(),
            &mut quiet
        )
        .is_err()
    );
}

#[test_with(scene("rendered/res64"))]
fn another_renderers_depth_maps_are_met() {
    let folder = dvr_test_support::scene("rendered/res64");
    for scene in ["bunny", "rods", "plate", "sharp"] {
        let mut files = ReadBack::open(folder.join(scene).join(scene));
        let mesh = read_mesh(files.folder.join("mesh.ply")).unwrap();
        let config = SynthConfig { samples_per_axis: 1, ..SynthConfig::default() };
        let renderer = MeshRenderer::new(&mesh, &config);
        for view in [0, 11] {
            let half = DMat3::from_cols(DVec3::X * 32.0, DVec3::Y * 32.0, DVec3::new(32.0, 32.0, 1.0));
            let projection =
                DMat4::from_mat3(half) * files.matrix("camera_mat", view) * files.matrix("world_mat", view);
            let left = DMat3::from_mat4(projection);
            let camera = Camera::from_projection(64, 64, left, projection.w_axis.truncate()).unwrap();
            let ours = renderer.render(&camera, 0).depth;
            let theirs = read_depth_exr(&files.folder.join(format!("depth/{view:04}.exr"))).unwrap();
            let differs = |a: &f32, b: &f32| a.is_finite() != b.is_finite() || (a.is_finite() && (a - b).abs() > 1e-4);
            let count =
                |a: &DepthMap, b: &DepthMap| a.z_depth.iter().zip(&b.z_depth).filter(|(a, b)| differs(a, b)).count();
            assert!(count(&ours, &theirs) <= 4, "{scene} {view}: {}", count(&ours, &theirs));
        }
    }
}
