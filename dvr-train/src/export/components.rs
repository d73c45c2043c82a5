//! Small loose pieces of a mesh: rubbish, unless photographs show them.

use dvr_core::mesh::{Mesh, connected_components};
use dvr_core::{Bvh, Ray, View};
use dvr_render::extract::drop_small_components;
use glam::DVec3;

/// Places of a piece that are looked up in the pictures.
const PLACES: usize = 16;

/// Views that must show a piece beside everything else.
const WITNESSES: usize = 2;

/// A piece goes where there is one view that sees background in its place for so many that show it.
const PER_DENIAL: usize = 4;

/// Drops connected pieces whose area is below `min_share` of the largest one's, unless views show them: object where
/// nothing of the large pieces is in the line of sight. Returns how many were dropped.
pub(crate) fn drop_unshown(mesh: &mut Mesh, min_share: f64, views: &[&View]) -> usize {
    let (labels, pieces) = pieces(mesh);
    let largest = pieces.iter().map(|piece| piece.area).fold(0.0, f64::max);
    let is_small = |label: usize| pieces[label].area < min_share * largest;
    if !(0..pieces.len()).any(is_small) {
        return 0;
    }
    let of = |keep: &dyn Fn(usize) -> bool| {
        let faces =
            mesh.faces.iter().zip(&labels).filter(|(_, label)| keep(**label as usize)).map(|(face, _)| *face).collect();
        Mesh { faces, vertices: mesh.vertices.clone(), ..Mesh::default() }
    };
    let large = Bvh::new(&of(&|label| !is_small(label)));
    let stays: Vec<bool> =
        (0..pieces.len()).map(|label| !is_small(label) || is_shown(&pieces[label].places, &large, views)).collect();
    mesh.faces = of(&|label| stays[label]).faces;
    // Nothing is too small any more: this takes the vertices away that no face uses.
    drop_small_components(mesh, 0.0);
    stays.iter().filter(|stays| !**stays).count()
}

/// A connected piece.
#[derive(Default)]
struct Piece {
    area: f64,
    /// Middles of some of its faces.
    places: Vec<DVec3>,
}

/// The piece of each face, and all pieces.
fn pieces(mesh: &Mesh) -> (Vec<u32>, Vec<Piece>) {
    let (labels, count) = connected_components(mesh.vertices.len(), &mesh.faces);
    let mut pieces: Vec<Piece> = (0..count).map(|_| Piece::default()).collect();
    for (face, &label) in labels.iter().enumerate() {
        let piece = &mut pieces[label as usize];
        let [a, b, c] = mesh.triangle(face).map(|corner| corner.as_dvec3());
        piece.area += 0.5 * (b - a).cross(c - a).length();
        if piece.places.len() < PLACES {
            piece.places.push((a + b + c) / 3.0);
        }
    }
    (labels, pieces)
}

/// Whether enough views show object at these places that nothing large explains, and hardly any shows background.
fn is_shown(places: &[DVec3], large: &Bvh, views: &[&View]) -> bool {
    let (mut shown, mut denied) = (0, 0);
    for view in views {
        let camera = &view.camera;
        let (mut alone, mut outside) = (0, 0);
        for &place in places {
            let (pixel, depth) = camera.project(place);
            if depth <= 0.0 || !camera.sees(pixel) {
                continue;
            }
            let is_object = view.is_training_object(pixel.x as u32, pixel.y as u32);
            outside += usize::from(!is_object);
            let ray = Ray { origin: camera.center(), direction: place - camera.center() };
            alone += usize::from(is_object && !large.any_hit(&ray, 0.0, f64::INFINITY));
        }
        shown += usize::from(2 * alone > places.len());
        denied += usize::from(2 * outside > places.len());
    }
    shown >= WITNESSES && PER_DENIAL * denied <= shown
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes::{icosphere, union};
    use dvr_core::stored;
    use dvr_core::synth::{MeshRenderer, SynthConfig, place_cameras};
    use glam::Vec3;

    use super::*;

    fn ball(radius: f32, center: Vec3) -> Mesh {
        let mut mesh = icosphere(2, radius);
        mesh.vertices.iter_mut().for_each(|v| *v += center);
        Mesh { normals: None, ..mesh }
    }

    #[test]
    fn a_small_piece_stays_where_pictures_show_it_and_rubbish_goes() {
        let (large, tiny) = (ball(0.25, Vec3::ZERO), ball(0.02, Vec3::X * 0.4));
        let truth = dvr_core::mesh::TexturedMesh { mesh: union([large.clone(), tiny.clone()]), ..Default::default() };
        let config = SynthConfig { views: 12, samples_per_axis: 2, ..SynthConfig::default() };
        let renderer = MeshRenderer::new(&truth, &config);
        let views: Vec<View> = (place_cameras(&config).into_iter().enumerate())
            .map(|(i, camera)| {
                let picture = renderer.render(&camera, i as u64);
                let image = stored(picture.image);
                View::new(i.to_string(), camera, image, picture.mask)
            })
            .collect();
        let views: Vec<&View> = views.iter().collect();
        let found = union([large, tiny.clone(), ball(0.02, -Vec3::X * 0.4)]);
        let mut mesh = found.clone();
        assert_eq!(drop_unshown(&mut mesh, 0.01, &views), 1, "the one that no picture shows");
        let near = |mesh: &Mesh, place: Vec3| mesh.vertices.iter().any(|v| v.distance(place) < 0.03);
        assert!(near(&mesh, Vec3::X * 0.4) && !near(&mesh, -Vec3::X * 0.4));
        let mut mesh = found;
        assert_eq!(drop_unshown(&mut mesh, 0.01, &[]), 2, "without pictures small ones go");
        assert_eq!(mesh.faces.len(), 320);
    }
}
