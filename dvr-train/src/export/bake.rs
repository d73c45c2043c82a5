//! Vertex colours from the photographs themselves, and how many of them saw what they colour.
//!
//! The texture field is smooth on purpose: fine colour would explain the pictures on a wrong surface. Once the surface
//! is known, its colours can be read where they are sharp.

use dvr_core::mesh::Mesh;
use dvr_core::{Bilinear, Cancellation, Cancelled, Exposure, Observation, Sight, View, Visibility, weighted_median};
use glam::{DVec2, Vec3};
use rayon::prelude::*;

/// Views that a vertex takes its colour from, at most: those that see it best.
const BEST_VIEWS: usize = 5;

/// What one view shows at a vertex, and how much that counts.
struct Shown {
    weight: f64,
    color: [f32; 3],
}

/// Notes on a mesh in object space how well `views` see its vertices, and replaces its colours by what they show there;
/// vertices that no view sees keep theirs. Returns how many took a new colour.
///
/// A vertex takes the weighted median of the views that see it best (most frontally, from the shortest distance in
/// pixels), channel by channel: a highlight or a wrong mask in one of them does not count. Views are taken at their mean
/// exposure where that is known to change ([`View::exposure`]).
///
/// # Errors
/// [`Cancelled`] where somebody wants it to end; the mesh is then as it was.
pub fn bake_colors(mesh: &mut Mesh, views: &[&View], cancellation: &Cancellation) -> Result<usize, Cancelled> {
    let visibility = Visibility::new(mesh);
    let seen: Vec<(Observation, Option<[f32; 3]>)> = (0..mesh.vertices.len())
        .into_par_iter()
        .map(|vertex| {
            cancellation.check()?;
            let sees = |(i, view): (usize, &&View)| visibility.sight(vertex, i, &view.camera);
            let sights: Vec<Sight> = views.iter().enumerate().filter_map(sees).collect();
            let mut shown: Vec<Shown> = sights.iter().filter_map(|sight| shown(views[sight.view], sight)).collect();
            shown.sort_by(|a, b| b.weight.total_cmp(&a.weight));
            shown.truncate(BEST_VIEWS);
            let color = (!shown.is_empty()).then(|| {
                [0, 1, 2].map(|channel| weighted_median(&mut shown, |each| (each.color[channel], each.weight)))
            });
            Ok((Observation::of(sights.iter().map(|sight| sight.cosine)), color))
        })
        .collect::<Result<_, Cancelled>>()?;
    let count = seen.iter().filter(|(_, color)| color.is_some()).count();
    if let Some(colors) = &mut mesh.colors {
        colors.iter_mut().zip(&seen).for_each(|(color, (_, seen))| *color = seen.unwrap_or(*color));
    }
    mesh.observations = Some(seen.into_iter().map(|(observation, _)| observation).collect());
    Ok(count)
}

/// What a view that sees a vertex shows there; `None` where that is not the object.
fn shown(view: &View, sight: &Sight) -> Option<Shown> {
    // Pixels a unit of surface: focal length over depth; squared it is the area's share of the picture.
    let scale = view.camera.intrinsics.x_axis.x / sight.z_depth;
    // Where the light changes and this view's is not known, its colours say nothing.
    let exposure = view.exposure?;
    let color = sample(view, sight.pixel)?;
    let is_corrected = exposure != Exposure::default();
    let color = if is_corrected { exposure.corrected(color.into()).clamp(Vec3::ZERO, Vec3::ONE).into() } else { color };
    Some(Shown { weight: (sight.cosine * scale).powi(2), color })
}

/// The bilinear colour at pixel coordinates, or `None` where one of the four pixels is not the object's.
fn sample(view: &View, pixel: DVec2) -> Option<[f32; 3]> {
    let at = Bilinear::at(pixel, view.image.dimensions())?;
    let mut color = [0.0; 3];
    for ((u, v), weight) in at.pixels.into_iter().zip(at.weights()) {
        if !view.is_training_object(u, v) {
            return None;
        }
        let pixel = view.image.get_pixel(u, v).0;
        (0..3).for_each(|c| color[c] += weight * f32::from(pixel[c]) / 255.0);
    }
    Some(color)
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes;
    use dvr_core::{Camera, Mask, stored};
    use glam::DVec3;

    use super::*;

    /// A camera on an axis that shows a ball in one colour.
    fn view(eye: DVec3, color: [u8; 3]) -> View {
        let camera = Camera::look_at(60, 60, 60.0, eye, DVec3::ZERO, DVec3::new(0.1, 1.0, 0.2));
        let mut mask = image::GrayImage::new(60, 60);
        for (u, v, pixel) in mask.enumerate_pixels_mut() {
            let ray = camera.pixel_ray(u, v);
            let closest = ray.at(-ray.origin.dot(ray.direction) / ray.direction.length_squared());
            pixel.0[0] = if closest.length() < 0.4 { 255 } else { 0 };
        }
        let image = stored(image::RgbImage::from_pixel(60, 60, image::Rgb(color)));
        View::new(format!("{eye}"), camera, image, Mask::from(mask))
    }

    fn ball() -> Mesh {
        let mut mesh = shapes::icosphere(3, 0.4);
        mesh.normals = Some(mesh.vertices.iter().map(|v| v.normalize()).collect());
        mesh.colors = Some(vec![[0.0, 0.0, 1.0]; mesh.vertices.len()]);
        mesh
    }

    #[test]
    fn vertices_take_the_colour_of_the_view_that_faces_them_and_unseen_ones_keep_theirs() {
        let mut mesh = ball();
        let views = [view(DVec3::Z * 2.0, [255, 0, 0]), view(DVec3::Y * 2.0, [0, 255, 0])];
        let seen = bake_colors(&mut mesh, &views.iter().collect::<Vec<_>>(), &Cancellation::default()).unwrap();
        assert!(seen > mesh.vertices.len() / 3 && seen < mesh.vertices.len());
        let color_near = |direction: Vec3| {
            let nearest = (0..mesh.vertices.len())
                .max_by(|&a, &b| mesh.vertices[a].dot(direction).total_cmp(&mesh.vertices[b].dot(direction)))
                .unwrap();
            mesh.colors.as_ref().unwrap()[nearest]
        };
        assert_eq!(color_near(Vec3::Z), [1.0, 0.0, 0.0]);
        assert_eq!(color_near(Vec3::Y), [0.0, 1.0, 0.0]);
        assert_eq!(color_near(Vec3::NEG_Z), [0.0, 0.0, 1.0], "nobody sees the back");
        let unseen = mesh.observations.as_ref().unwrap().iter().filter(|observation| observation.views == 0).count();
        assert!(unseen > mesh.vertices.len() / 3 && unseen <= mesh.vertices.len() - seen);
    }

    #[test]
    fn one_odd_view_of_three_does_not_count() {
        let mut mesh = ball();
        let views = [
            view(DVec3::new(0.0, 0.2, 2.0), [200, 100, 50]),
            view(DVec3::new(0.2, 0.0, 2.0), [200, 100, 50]),
            view(DVec3::new(0.0, 0.0, 2.0), [255, 255, 255]),
        ];
        bake_colors(&mut mesh, &views.iter().collect::<Vec<_>>(), &Cancellation::default()).unwrap();
        let front =
            (0..mesh.vertices.len()).max_by(|&a, &b| mesh.vertices[a].z.total_cmp(&mesh.vertices[b].z)).unwrap();
        assert!((mesh.colors.unwrap()[front][1] - 100.0 / 255.0).abs() < 1e-6);
    }

    #[test]
    fn colours_are_those_of_the_mean_exposure_where_the_light_changes() {
        let exposed = |eye: DVec3, exposure: Option<Exposure>| View { exposure, ..view(eye, [100, 100, 100]) };
        let color_at_z = |exposure: Option<Exposure>| {
            let mut mesh = ball();
            bake_colors(&mut mesh, &[&exposed(DVec3::Z * 2.0, exposure)], &Cancellation::default()).unwrap();
            let front = |&a: &usize, &b: &usize| mesh.vertices[a].z.total_cmp(&mesh.vertices[b].z);
            mesh.colors.as_ref().unwrap()[(0..mesh.vertices.len()).max_by(front).unwrap()]
        };
        let brighter = Exposure::from_logs([0.2; 3]);
        let expected = brighter.corrected(Vec3::splat(100.0 / 255.0));
        assert!((Vec3::from(color_at_z(Some(brighter))) - expected).length() < 1e-5);
        assert_eq!(color_at_z(Some(Exposure::from_logs([2.0; 3]))), [1.0; 3], "in the range of colours");
        assert_eq!(color_at_z(None), [0.0, 0.0, 1.0], "a view of unknown exposure says nothing");
    }

    #[test]
    fn an_occluder_hides_what_is_behind_it() {
        let mut mesh = ball();
        let screen = shapes::cuboid(Vec3::new(-0.6, -0.6, 0.8), Vec3::new(0.6, 0.6, 0.82));
        let ball_vertices = mesh.vertices.len();
        mesh = shapes::union([mesh, screen]);
        mesh.normals = Some(shapes::vertex_normals(&mesh.vertices, &mesh.faces));
        mesh.colors = Some(vec![[0.0, 0.0, 1.0]; mesh.vertices.len()]);
        bake_colors(&mut mesh, &[&view(DVec3::Z * 2.0, [255, 0, 0])], &Cancellation::default()).unwrap();
        assert!(mesh.colors.unwrap()[..ball_vertices].iter().all(|&c| c == [0.0, 0.0, 1.0]));
    }
}
