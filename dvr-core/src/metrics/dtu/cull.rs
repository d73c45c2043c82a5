//! Leaving out what masks do not show.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::distance_transform::signed_distance;
use crate::mesh::Mesh;
use crate::raster::Mask;

/// The mesh without the faces that have a corner, and without the vertices, whose pixel lies more than `dilation` pixels
/// outside the mask of a view. Views that do not have it in their frame say nothing.
///
/// Publications on DTU cull so before they measure a method that is not held by masks, or that closes the object where
/// nobody looked. Cameras are in the space of the mesh. Colours, normals and observations are not kept.
pub fn cull(mesh: &Mesh, views: &[(Camera, &Mask)], dilation: f64) -> Mesh {
    let mut stays = vec![true; mesh.vertices.len()];
    for (camera, mask) in views {
        let (width, height) = mask.size();
        let inside: Vec<bool> =
            (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).map(|(u, v)| mask.is_object(u, v)).collect();
        // Of a pixel outside, the distance to the outline is half a pixel less than that to the nearest pixel inside.
        let distance = signed_distance(&inside, width as usize);
        let shows = |vertex: &Vec3| {
            let (pixel, z) = camera.project(DVec3::from(*vertex));
            let place = pixel.x.max(0.0) as usize + width as usize * pixel.y.max(0.0) as usize;
            z <= 0.0 || !camera.sees(pixel) || distance.get(place).is_none_or(|d| f64::from(*d) >= 0.5 - dilation)
        };
        stays.par_iter_mut().zip(&mesh.vertices).for_each(|(stays, vertex)| *stays = *stays && shows(vertex));
    }
    let mut place = vec![0; stays.len()];
    let mut vertices = Vec::new();
    for (index, vertex) in mesh.vertices.iter().enumerate().filter(|(index, _)| stays[*index]) {
        place[index] = vertices.len() as u32;
        vertices.push(*vertex);
    }
    let whole = mesh.faces.iter().filter(|face| face.iter().all(|&corner| stays[corner as usize]));
    Mesh { faces: whole.map(|face| face.map(|corner| place[corner as usize])).collect(), vertices, ..Mesh::default() }
}
