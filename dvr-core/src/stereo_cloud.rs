//! Depth maps of stereo as one cloud of points with normals and colours, as dense stereo programs write it.

use glam::{Vec2, Vec3};

use crate::mesh::Mesh;
use crate::metrics::depth_maps::{MAX_STEP, StereoDepth};
use crate::scene::View;
use crate::visibility::MIN_COSINE;

/// A vertex for each pixel that has a depth and, beside and above or below it, neighbours on the same surface: these give its
/// normal, which looks to the camera. Positions are in object space, colours those of the photographs; there are no faces.
pub fn stereo_cloud(maps: &[StereoDepth], views: &[&View]) -> Mesh {
    let (mut vertices, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    for map in maps {
        let photograph = views.iter().find(|view| view.name == map.name).map(|view| &view.image);
        for y in 0..map.depth.height {
            for x in 0..map.depth.width {
                let Some((point, normal)) = oriented_point(map, x, y) else { continue };
                vertices.push(point);
                normals.push(normal);
                let color = photograph.map_or([0.5; 3], |photograph| {
                    // The middle of the pixels that one of the map stands for.
                    let middle = |at: u32, size: u32| {
                        (at * map.shrunk_by as u32 + map.shrunk_by as u32 / 2).min(size.saturating_sub(1))
                    };
                    let (width, height) = photograph.dimensions();
                    photograph.get_pixel(middle(x, width), middle(y, height)).0.map(|c| f32::from(c) / 255.0)
                });
                colors.push(color);
            }
        }
    }
    Mesh { vertices, normals: Some(normals), colors: Some(colors), ..Mesh::default() }
}

/// The point that a pixel shows, with its normal.
fn oriented_point(map: &StereoDepth, x: u32, y: u32) -> Option<(Vec3, Vec3)> {
    let camera = &map.camera;
    let depth = map.depth.get(x, y);
    if !depth.is_finite() {
        return None;
    }
    let point = |x: u32, y: u32, depth: f32| {
        camera.center + depth * camera.direction_through(Vec2::new(x as f32 + 0.5, y as f32 + 0.5))
    };
    let here = point(x, y, depth);
    let limit = MAX_STEP * camera.to_direction.x_axis.length() * depth;
    let neighbour = |dx: i64, dy: i64| {
        let (x, y) = (u32::try_from(i64::from(x) + dx).ok()?, u32::try_from(i64::from(y) + dy).ok()?);
        let there = (x < map.depth.width && y < map.depth.height).then(|| map.depth.get(x, y))?;
        ((there - depth).abs() < limit).then(|| point(x, y, there))
    };
    // Over both neighbours where there are two, else from or to the pixel itself.
    let along = |dx: i64, dy: i64| {
        let (before, after) = (neighbour(-dx, -dy), neighbour(dx, dy));
        (before.is_some() || after.is_some()).then(|| after.unwrap_or(here) - before.unwrap_or(here))
    };
    let normal = along(1, 0)?.cross(along(0, 1)?).try_normalize()?;
    let to_camera = (camera.center - here).normalize();
    let facing = if normal.dot(to_camera) < 0.0 { -normal } else { normal };
    (f64::from(facing.dot(to_camera)) >= MIN_COSINE).then_some((here, facing))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::depth_maps::ball::{RADIUS, depth_maps};

    #[test]
    fn a_ball_becomes_points_with_outward_normals() {
        let mut maps = depth_maps(1.0);
        let known: usize = maps.iter().map(StereoDepth::known_pixels).sum();
        // A depth without neighbours has no normal.
        maps[0].depth.z_depth[0] = 2.0;
        let cloud = stereo_cloud(&maps, &[]);
        assert!(cloud.vertices.len() * 10 > 8 * known && cloud.faces.is_empty(), "{} of {known}", cloud.vertices.len());
        let normals = cloud.normals.unwrap();
        for (point, normal) in cloud.vertices.iter().zip(&normals) {
            assert!((point.length() - RADIUS as f32).abs() < 1e-3, "{point}");
            assert!(normal.dot(point.normalize()) > 0.9, "{point} {normal}");
        }
        let near = normals.iter().zip(&cloud.vertices).filter(|(n, p)| n.dot(p.normalize()) > 0.995).count();
        assert!(near * 10 > 9 * normals.len(), "{near} of {}", normals.len());
        assert_eq!(cloud.colors.unwrap()[0], [0.5; 3], "of no photograph");
    }
}
