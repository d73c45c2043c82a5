//! Normals finer than those of the vertices, as a texture.

use std::sync::Arc;

use glam::{Vec3, Vec4};

use crate::camera::Similarity;

/// A tangent-space normal map, over the texture coordinates that the colours have.
///
/// A texel `c` in [0, 255] stands for the direction `x T + y B + z N` with `(x, y, z) = 2 c / 255 - 1`: linear data, no
/// colour. `N` is the normal of the surface and `T` the tangent, both interpolated between the corners of a face and made
/// unit vectors, and `B = w (N x T)`. `x` goes to the right of the picture and `y` up, as glTF 2.0 has it (section 3.9.3,
/// "Additional Textures").
#[derive(Clone, Debug, PartialEq)]
pub struct NormalMap {
    /// The directions; texture coordinate (0, 0) is the *bottom* left corner.
    pub texture: Arc<image::RgbImage>,
    /// Tangents of a face's three corners: a unit vector, and the handedness `w`, 1 or -1.
    pub corner_tangents: Vec<[Vec4; 3]>,
}

impl NormalMap {
    /// The same for a mesh that is moved through a similarity.
    pub(super) fn rotated(mut self, similarity: &Similarity) -> Self {
        for tangent in self.corner_tangents.iter_mut().flatten() {
            *tangent = similarity.transform_direction(tangent.truncate()).extend(tangent.w);
        }
        self
    }

    /// The direction that a texel stands for, of unit length: to the right, up, and away from the surface.
    pub fn direction(texel: [u8; 3]) -> Vec3 {
        (2.0 / 255.0 * Vec3::from(texel.map(f32::from)) - 1.0).normalize_or(Vec3::Z)
    }

    /// The texel that comes closest to a unit vector.
    pub fn texel(direction: Vec3) -> [u8; 3] {
        (127.5 * (direction + 1.0)).round().to_array().map(|channel| channel as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_texel_stands_for_the_direction_that_it_was_made_of() {
        let ring = (0..50).map(|i| (f32::from(i as u8) * 0.4).sin_cos());
        for direction in ring.map(|(x, y)| Vec3::new(0.7 * x, 0.7 * y, 0.7).normalize()) {
            let back = NormalMap::direction(NormalMap::texel(direction));
            assert!(back.angle_between(direction) < 0.006, "{direction} {back}");
        }
        assert_eq!(NormalMap::texel(Vec3::Z), [128, 128, 255]);
        assert_eq!([[255, 128, 128], [128, 255, 128]].map(|c| NormalMap::direction(c).max_position()), [0, 1]);
    }

    #[test]
    fn tangents_turn_with_the_mesh_and_keep_their_handedness() {
        let map = NormalMap { texture: Arc::default(), corner_tangents: vec![[Vec4::new(1.0, 0.0, 0.0, -1.0); 3]] };
        let turn =
            Similarity { scale: 5.0, rotation: glam::DQuat::from_rotation_z(1.0), translation: glam::DVec3::ONE };
        let turned = map.rotated(&turn).corner_tangents[0][2];
        let expected = Vec4::new(1f32.cos(), 1f32.sin(), 0.0, -1.0);
        assert!((turned - expected).abs().max_element() < 1e-6, "{turned}");
    }
}
