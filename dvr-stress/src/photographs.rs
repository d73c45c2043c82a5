//! Axes of what photographs have and easy renders lack.

use dvr_core::mesh::Mesh;
use dvr_core::synth::{CameraPlacement, DirectionalLight, Gloss, Lighting};
use glam::{DVec3, Vec3};

use crate::axis::{Axis, Case, Group, usual_footprint};
use crate::paint::{Paint, painted};
use crate::shapes::{bowl, pebble};

/// Height of arcs of cameras above the object's middle, degrees: that of somebody who looks down at a table.
const ELEVATION: f64 = 30.0;

/// The axes, in the order of the tables. Exposure, objects at the edge of the frame and views from one side, which
/// photographs have as well, are among the errors of pictures and the placements of views.
pub(crate) fn photograph_axes() -> Vec<Axis> {
    let photographs =
        |words, difficulties, quick, case| Axis::of_scenes(Group::Photographs, words, difficulties, quick, case);
    vec![
        photographs(
            ["roughness", "roughness", "a bowl half as deep as wide, of painted metal that mirrors three lamps (GGX)"],
            &[1.0, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05],
            &[0.5, 0.3, 0.1, 0.05],
            metal_bowl,
        ),
        photographs(
            [
                "plain-area",
                "share of the surface",
                "a bowl half as deep as wide with plain grey patches in its noise texture",
            ],
            &[0.0, 0.25, 0.5, 0.75, 0.9, 1.0],
            &[0.25, 0.75, 1.0],
            |share| Case::of(painted(bowl(0.5), Paint::Patches(share))),
        ),
        photographs(
            ["white-balance", "stops", "standard deviation of the gains of red and blue from view to view"],
            &[0.05, 0.1, 0.25, 0.5, 1.0, 2.0],
            &[0.1, 0.5, 2.0],
            |stops| {
                let mut case = Case::of(painted(pebble(), Paint::CLEAR));
                case.config.white_balance_jitter = stops as f32;
                case
            },
        ),
        photographs(
            [
                "frame",
                "widths of the object",
                "frames this wide at the same scale: below one the object is cut on all sides",
            ],
            &[2.0, 1.25, 1.0, 0.75, 0.5],
            &[2.0, 1.0, 0.75],
            framed_pebble,
        ),
        photographs(
            ["arc", "degrees", "24 views on an arc, all looking down by 30 degrees; judged is what two of them see"],
            &[360.0, 180.0, 120.0, 90.0, 60.0, 30.0, 15.0, 8.0],
            &[90.0, 30.0, 8.0],
            |angle| {
                let mut case = Case::of(painted(pebble(), Paint::CLEAR));
                case.config.placement = CameraPlacement::Arc { elevation: ELEVATION, angle };
                case
            },
        ),
        photographs(
            [
                "picture-size",
                "pixels",
                "a bowl half as deep as wide in larger pictures: its texture has fewer details per pixel",
            ],
            &[64.0, 96.0, 128.0, 192.0, 256.0],
            &[64.0, 128.0],
            |pixels| {
                let mut case = Case::of(painted(bowl(0.5), Paint::CLEAR));
                (case.config.width, case.config.height) = (pixels as u32, pixels as u32);
                case
            },
        ),
    ]
}

/// A bowl of metal of this roughness, whose paint tints what it mirrors.
fn metal_bowl(roughness: f64) -> Case {
    let mut case = Case::of(painted(bowl(0.5), Paint::CLEAR));
    let light = |x: f64, y: f64, z: f64, intensity: f32| DirectionalLight { direction: DVec3::new(x, y, z), intensity };
    case.config.lighting = Lighting {
        ambient: 0.5,
        lights: vec![light(0.5, 0.8, 0.4, 0.5), light(-0.7, 0.3, 0.6, 0.3), light(0.1, -0.5, -0.9, 0.3)],
        gloss: Some(Gloss { roughness, metallic: 1.0, light_half_angle: 20.0 }),
        ..Lighting::default()
    };
    case
}

/// A pebble in frames that are this many times as wide as it is. A pixel is half as wide as usual.
fn framed_pebble(widths: f64) -> Case {
    let mut case = Case::of(painted(pebble(), Paint::CLEAR));
    let pixels = (widths * width(&case.object.mesh) / (0.5 * usual_footprint())).round();
    (case.config.width, case.config.height) = (pixels as u32, pixels as u32);
    // The footprint is distance / (focal * pixels / 2).
    case.config.focal = case.config.distance / (0.25 * usual_footprint() * pixels);
    case
}

/// The longest edge of a mesh's bounding box.
fn width(mesh: &Mesh) -> f64 {
    let low = mesh.vertices.iter().copied().fold(Vec3::INFINITY, Vec3::min);
    let high = mesh.vertices.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    (high - low).max_element().into()
}

#[cfg(test)]
mod tests {
    use dvr_core::sampling::sample_surface;
    use dvr_core::synth::{MeshRenderer, RenderedView, SynthConfig};
    use dvr_core::{Bvh, Camera, Ray};

    use super::*;
    use crate::scene::true_cameras;

    fn case(name: &str, difficulty: f64) -> Case {
        photograph_axes().into_iter().find(|axis| axis.name == name).unwrap().case(difficulty).unwrap()
    }

    /// All views, in fewer samples per pixel, which is quicker.
    fn views(case: &Case) -> Vec<(Camera, RenderedView)> {
        let config = SynthConfig { samples_per_axis: 2, ..case.config.clone() };
        let renderer = MeshRenderer::new(&case.object, &config);
        let render = |(i, camera): (usize, Camera)| (camera.clone(), renderer.render(&camera, i as u64));
        true_cameras(case, 0).into_iter().enumerate().map(render).collect()
    }

    /// Colours of each of some surface points in the views that see it frontally, in bytes.
    fn seen_colors(case: &Case) -> Vec<Vec<Vec3>> {
        let mesh = &case.object.mesh;
        let (bvh, samples, views) = (Bvh::new(mesh), sample_surface(mesh, 300, 0), views(case));
        let color = |point: Vec3, normal: Vec3, (camera, view): &(Camera, RenderedView)| {
            let (point, (pixel, _)) = (point.as_dvec3(), camera.project(point.as_dvec3()));
            let toward = camera.center() - point;
            let is_frontal = normal.as_dvec3().dot(toward) > 0.6 * toward.length() && camera.sees(pixel);
            let sight = Ray { origin: camera.center(), direction: -toward };
            (is_frontal && !bvh.any_hit(&sight, 0.0, 0.999))
                .then(|| Vec3::from(view.image.get_pixel(pixel.x as u32, pixel.y as u32).0.map(f32::from)))
        };
        let colors =
            |(&point, &normal): (&Vec3, &Vec3)| views.iter().filter_map(|view| color(point, normal, view)).collect();
        samples.points.iter().zip(&samples.normals).map(colors).collect()
    }

    /// How much the colour of a surface point differs between the views that see it: the root mean square over points.
    fn spread(colors: &[Vec<Vec3>]) -> f32 {
        let variance = |colors: &Vec<Vec3>| {
            let mean = colors.iter().sum::<Vec3>() / colors.len() as f32;
            colors.iter().map(|color| color.distance_squared(mean)).sum::<f32>() / colors.len() as f32
        };
        let seen: Vec<f32> = colors.iter().filter(|colors| colors.len() > 1).map(variance).collect();
        assert!(seen.len() > 100);
        (seen.iter().sum::<f32>() / seen.len() as f32).sqrt()
    }

    #[test]
    fn a_smoother_bowl_looks_more_different_from_view_to_view() {
        let spreads = [1.0, 0.5, 0.3, 0.1].map(|roughness| spread(&seen_colors(&case("roughness", roughness))));
        let matt = spread(&seen_colors(&case("white-balance", 0.05)));
        assert!(spreads.windows(2).all(|pair| pair[1] > 1.1 * pair[0]), "{spreads:?}, matt {matt}");
        assert!(spreads[3] > 2.0 * matt, "{spreads:?}, matt {matt}");
    }

    #[test]
    fn pictures_of_metal_are_neither_burnt_nor_dark() {
        for roughness in [1.0, 0.5, 0.3, 0.1, 0.05] {
            let views = views(&case("roughness", roughness));
            let pixels = |(_, view): &(Camera, RenderedView)| {
                let inside = view.image.enumerate_pixels().filter(|&(u, v, _)| view.mask.is_object(u, v));
                inside.map(|(_, _, pixel)| pixel.0[1]).collect::<Vec<_>>()
            };
            let mut green: Vec<u8> = views.iter().flat_map(pixels).collect();
            green.sort_unstable();
            let (median, burnt) = (green[green.len() / 2], green.iter().filter(|&&g| g == 255).count());
            assert!((60..200).contains(&median), "median {median} at {roughness}");
            assert!(burnt < green.len() / 10, "{burnt} of {} burnt at {roughness}", green.len());
        }
    }

    #[test]
    fn plain_patches_cover_their_share_of_the_surface() {
        for share in [0.0, 0.25, 0.5, 0.75, 0.9, 1.0] {
            let object = case("plain-area", share).object;
            let (mut plain, mut all) = (0.0, 0.0);
            for face in 0..object.mesh.faces.len() {
                let [a, b, c] = object.mesh.triangle(face);
                let area = f64::from((b - a).cross(c - a).length());
                for place in [[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8], [0.4, 0.4, 0.2], [0.3, 0.2, 0.5]] {
                    let color = object.base_color(face, place);
                    all += area;
                    plain += if (color - color.x).abs().max_element() < 1e-6 { area } else { 0.0 };
                }
            }
            assert!((plain / all - share).abs() < 0.04, "{} instead of {share}", plain / all);
        }
    }

    #[test]
    fn views_are_tinted_as_far_as_the_axis_says() {
        let means = |stops: f64| {
            // Dim, so that no channel is clipped at white.
            let mut case = case("white-balance", stops);
            case.config.lighting = Lighting { ambient: 0.25, lights: Vec::new(), ..Lighting::default() };
            let mean = |(_, view): &(Camera, RenderedView)| {
                let linear = |byte: u8| ((f32::from(byte) / 255.0 + 0.055) / 1.055).powf(2.4);
                let inside = view.image.enumerate_pixels().filter(|&(u, v, _)| view.mask.is_object(u, v));
                inside.map(|(_, _, pixel)| Vec3::from(pixel.0.map(linear))).sum::<Vec3>()
            };
            views(&case).iter().map(mean).collect::<Vec<_>>()
        };
        let usual = means(1e-6);
        for stops in [0.1, 0.5] {
            let gains: Vec<Vec3> =
                means(stops).iter().zip(&usual).map(|(tinted, plain)| (tinted / plain).map(f32::log2)).collect();
            let deviation = |channel: usize| {
                (gains.iter().map(|gain| gain[channel].powi(2)).sum::<f32>() / gains.len() as f32).sqrt()
            };
            assert!(deviation(1) < 1e-3, "green stays");
            for channel in [0, 2] {
                let found = f64::from(deviation(channel));
                assert!((0.6 * stops..1.5 * stops).contains(&found), "{found} instead of {stops}");
            }
        }
    }

    #[test]
    fn frames_cut_the_object_where_they_are_narrower_and_pixels_stay_as_they_are() {
        for (widths, is_cut) in [(2.0, false), (1.25, false), (0.75, true), (0.5, true)] {
            let case = case("frame", widths);
            assert!((case.footprint() / (0.5 * usual_footprint()) - 1.0).abs() < 1e-9);
            let edge = case.footprint() * f64::from(case.config.width);
            assert!((edge / width(&case.object.mesh) / widths - 1.0).abs() < 0.03, "{edge}");
            let last = case.config.width - 1;
            let touches = |(_, view): &(Camera, RenderedView)| {
                (0..=last)
                    .any(|i| [(i, 0), (i, last), (0, i), (last, i)].iter().any(|&(u, v)| view.mask.is_object(u, v)))
            };
            assert!(views(&case).iter().all(|view| touches(view) == is_cut), "{widths}");
        }
    }

    #[test]
    fn arcs_and_pictures_have_their_angles_and_sizes() {
        for angle in [30.0, 180.0] {
            let cameras = true_cameras(&case("arc", angle), 0);
            let azimuth = |camera: &Camera| camera.center().x.atan2(camera.center().z).to_degrees();
            let widest = cameras.iter().map(|camera| azimuth(camera).abs()).fold(0.0, f64::max);
            assert!((0.4 * angle..0.56 * angle).contains(&widest), "{widest} of {angle}");
            let height = |camera: &Camera| (camera.center().y / camera.center().length()).asin().to_degrees();
            assert!(cameras.iter().all(|camera| (height(camera) - ELEVATION).abs() < 4.0));
        }
        let (usual, large) = (case("picture-size", 64.0), case("picture-size", 256.0));
        assert_eq!((large.config.width, large.config.height), (256, 256));
        assert!((usual.footprint() / large.footprint() - 4.0).abs() < 1e-9);
        assert_eq!(SynthConfig { width: 64, height: 64, ..large.config }, usual.config, "nothing else differs");
    }
}
