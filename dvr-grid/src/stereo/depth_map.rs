//! The depths of a view.

use dvr_core::DepthMap as ZDepths;
use dvr_core::metrics::depth_maps::StereoDepth;

use super::picture::Picture;

/// A depth for every pixel of a view's picture.
#[derive(Clone, Debug)]
pub(super) struct DepthMap {
    /// Z-depth; no number where none is known.
    pub z_depth: Vec<f32>,
    /// How sure a depth is: the correlation of its match, up to 1.
    pub confidence: Vec<f32>,
    /// Z-depth at which the pixel's ray enters the hull.
    pub hull: Vec<f32>,
}

impl DepthMap {
    /// Nothing known of this many pixels.
    pub fn unknown(pixels: usize) -> Self {
        Self { z_depth: vec![f32::NAN; pixels], confidence: vec![0.0; pixels], hull: vec![f32::NAN; pixels] }
    }

    /// As it is measured and kept: of the view of this name, matched with these others.
    pub fn of_view(&self, name: &str, picture: &Picture, neighbours: &[usize]) -> StereoDepth {
        StereoDepth {
            name: name.to_owned(),
            camera: picture.camera,
            depth: ZDepths {
                width: picture.width as u32,
                height: picture.height as u32,
                z_depth: self.z_depth.clone(),
            },
            object_pixels: (0..picture.grey.len()).filter(|&pixel| picture.is_object(pixel)).count(),
            shrunk_by: picture.factor,
            neighbours: neighbours.to_vec(),
        }
    }

    /// Believes in the hull where a depth lies behind it by no more than depths are wrong by, `doubt`: in the hull alone
    /// up to half of that, in the depth alone from one and a half times on.
    pub fn trust_hull(&mut self, doubt: f32) {
        for (depth, hull) in self.z_depth.iter_mut().zip(&self.hull) {
            let behind = *depth - hull;
            *depth = hull + behind * ((behind - 0.5 * doubt) / doubt).clamp(0.0, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_differences_from_the_hull_are_its_own_and_large_ones_stay() {
        let mut map = DepthMap {
            z_depth: vec![1.04, 1.1, 1.3, f32::NAN],
            confidence: vec![1.0; 4],
            hull: vec![1.0, 1.0, 1.0, 1.0],
        };
        map.trust_hull(0.1);
        assert!((map.z_depth[0] - 1.0).abs() < 1e-6 && (map.z_depth[1] - 1.05).abs() < 1e-6);
        assert!((map.z_depth[2] - 1.3).abs() < 1e-6 && map.z_depth[3].is_nan());
    }
}
