//! Charts of a surface, laid side by side on a square.
//!
//! Patches that face the same way ([`segments`]) are seen along their mean normals, cut where they cover themselves
//! ([`charts`]), and packed ([`packing`]). Every step takes time in proportion to the faces.

mod adjacency;
mod charts;
mod packing;
mod segments;

use dvr_core::Cancellation;
use dvr_core::mesh::Mesh;
use glam::Vec2;

use crate::error::TextureError;

/// Share of a square that charts are expected to cover.
const EXPECTED_COVER: f32 = 0.5;

/// A surface cut into charts that lie side by side on a square of `size` x `size` texels.
#[derive(Clone, Debug)]
pub struct Atlas {
    /// Edge in texels.
    pub size: u32,
    /// Where the corners of each face lie, in texels: x to the right, y down, the middle of the first texel at
    /// (0.5, 0.5).
    pub corners: Vec<[Vec2; 3]>,
    /// Number of charts.
    pub charts: usize,
    /// Share of the square that charts cover.
    pub cover: f32,
}

impl Atlas {
    /// Cuts a mesh into charts and packs them, `padding` texels from each other's and from the square's edges.
    ///
    /// # Errors
    /// [`TextureError::TooManyCharts`] where the square is too small for their padding; [`TextureError::Cancelled`].
    pub fn unwrap(mesh: &Mesh, size: u32, padding: u32, cancellation: &Cancellation) -> Result<Self, TextureError> {
        let neighbours = adjacency::neighbours(mesh);
        let patches = segments::segments(mesh, &neighbours);
        cancellation.check()?;
        let area: f32 = (0..mesh.faces.len()).map(|face| area(mesh.triangle(face))).sum();
        let cell = (area / EXPECTED_COVER).sqrt() / size as f32;
        let charts = charts::charts(mesh, &neighbours, &patches, cell);
        cancellation.check()?;
        let packing = packing::pack(&charts, size, padding);
        let packing = packing.ok_or(TextureError::TooManyCharts { charts: charts.len(), size })?;
        let mut corners = vec![[Vec2::ZERO; 3]; mesh.faces.len()];
        for (chart, place) in charts.iter().zip(&packing.places) {
            for (&face, flat) in chart.faces.iter().zip(&chart.corners) {
                corners[face as usize] = flat.map(|p| packing.scale * p + *place);
            }
        }
        let covered: f32 = corners.iter().map(|[a, b, c]| 0.5 * (b - a).perp_dot(c - a).abs()).sum();
        Ok(Self { size, corners, charts: charts.len(), cover: covered / (size as f32).powi(2) })
    }
}

fn area([a, b, c]: [glam::Vec3; 3]) -> f32 {
    0.5 * (b - a).cross(c - a).length()
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes;
    use glam::Vec3;

    use super::*;
    use crate::texels::{FREE, Texels};

    fn unwrapped(mesh: &Mesh) -> Atlas {
        Atlas::unwrap(mesh, 512, 4, &Cancellation::default()).unwrap()
    }

    #[test]
    fn no_texel_belongs_to_two_faces_and_most_faces_keep_their_shape() {
        // A torus covers itself from every side; the thin box in its hole is another component.
        let box_ = shapes::cuboid(Vec3::new(-0.02, -0.02, -0.3), Vec3::new(0.02, 0.02, 0.3));
        let mesh = shapes::union([shapes::torus(0.3, 0.12, 60, 40), box_]);
        let atlas = unwrapped(&mesh);
        assert!(atlas.charts >= 6 && atlas.charts < 60, "{}", atlas.charts);
        assert!(atlas.cover > 0.35, "{}", atlas.cover);
        let mut owner = vec![FREE; 512 * 512];
        for (face, corners) in atlas.corners.iter().enumerate() {
            let alone = Texels::of_faces(512, [(face as u32, *corners)]);
            for (texel, _) in alone.iter().enumerate().filter(|(_, face)| **face != FREE) {
                assert!(owner[texel] == FREE || shares_corner(&mesh, owner[texel], face as u32), "{face}");
                owner[texel] = face as u32;
            }
        }
        let stretch = |face: usize| {
            let [a, b, c] = atlas.corners[face];
            0.5 * (b - a).perp_dot(c - a).abs() / area(mesh.triangle(face))
        };
        let mut stretches: Vec<f32> = (0..mesh.faces.len()).map(stretch).collect();
        stretches.sort_by(f32::total_cmp);
        assert!(stretches[0] > 0.2 * stretches[stretches.len() / 2], "no face vanishes");
    }

    fn shares_corner(mesh: &Mesh, a: u32, b: u32) -> bool {
        mesh.faces[a as usize].iter().any(|corner| mesh.faces[b as usize].contains(corner))
    }

    #[test]
    fn a_square_without_room_is_refused() {
        let balls = (0..300).map(|_| shapes::icosphere(0, 0.1));
        let error = Atlas::unwrap(&shapes::union(balls), 64, 4, &Cancellation::default()).unwrap_err();
        assert!(error.to_string().contains("64"), "{error}");
    }
}
