//! The object as a volume that all pictures agree about.

use dvr_core::voxel::{VoxelGrid, least_area};
use dvr_core::{Cancellation, Cancelled, flood};
use glam::Vec3;
use rayon::prelude::*;

use crate::HALF;
use crate::shrunk::Shrunk;

/// By how much the share of views that disagree must exceed what is borne with, so that a node certainly is empty.
const RANGE: f32 = 0.15;

/// How much larger the cube around what is solid is, as a share.
const MARGIN: f32 = 0.25;

/// Views that must have a place in their frames.
const MIN_SEEING: usize = 3;

/// What a node costs that fewer see.
const UNSEEN: f32 = 0.3;

/// A part that does not hang together with the main one is kept from this share of its nodes on.
const MIN_PART: f64 = 0.5;

/// How fast a node counts less the further it is from the middle, in half edges of the cube.
const NEAR_MIDDLE: f32 = 2.0;

/// Nodes of a grid, solid or not.
pub(crate) struct Volume {
    grid: VoxelGrid,
    /// The middle of the grid.
    origin: Vec3,
    solid: Vec<bool>,
}

/// A cube in object space that is divided into nodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cube {
    /// Its middle.
    pub origin: Vec3,
    /// Half its edge.
    pub half: f32,
}

/// How views come to agree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Round {
    /// Nodes along an edge of the volume.
    pub nodes: usize,
    /// The share of the views that may show background where the object is.
    pub disagreeing: f32,
}

impl Volume {
    /// What most views show as object, by how much each of their pixels belongs to it, and where `is_allowed`: up to a
    /// share `disagreeing` of the views that see a place may show background there.
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn agreed(
        views: &[(&Shrunk, &[f32])],
        cube: Cube,
        Round { nodes, disagreeing }: Round,
        is_allowed: impl Fn(Vec3) -> bool + Sync,
        cancellation: &Cancellation,
    ) -> Result<Self, Cancelled> {
        let grid = VoxelGrid::new(nodes, cube.half);
        let position = |node: usize| cube.origin + grid.position(node);
        let allowed: Vec<bool> = (0..grid.len()).into_par_iter().map(|node| is_allowed(position(node))).collect();
        let price = |node: usize| {
            if !allowed[node] {
                return 1.0;
            }
            let point = position(node);
            let (mut seeing, mut background) = (0usize, 0f32);
            for (view, belongs) in views {
                let (place, z) = view.camera.project(point);
                if z > 0.0
                    && let Some(pixel) = view.pixel_at(place)
                {
                    seeing += 1;
                    background += 1.0 - belongs[pixel];
                }
            }
            if seeing < MIN_SEEING {
                return UNSEEN;
            }
            ((background / seeing as f32 - disagreeing) / RANGE).clamp(-1.0, 1.0)
        };
        let price: Vec<f32> = (0..grid.len()).into_par_iter().map(price).collect();
        cancellation.check()?;
        let solid = least_area(&grid, &price, &allowed, cancellation)?;
        let mut volume = Self { grid, origin: cube.origin, solid };
        volume.keep_main_parts();
        Ok(volume)
    }

    /// Keeps the part that is largest where it is near the middle, and those that are not much smaller.
    fn keep_main_parts(&mut self) {
        let grid = self.grid;
        let weight = |&node: &usize| {
            let distance = (self.origin + grid.position(node)).length() / HALF;
            f64::from((-(NEAR_MIDDLE * distance).powi(2)).exp())
        };
        let mut left = self.solid.clone();
        let mut parts: Vec<Vec<usize>> = Vec::new();
        for start in 0..grid.len() {
            if left[start] {
                parts.push(flood(start, &mut left, |node| grid.neighbours(node)));
            }
        }
        let weights: Vec<f64> = parts.iter().map(|part| part.iter().map(weight).sum()).collect();
        let Some(main) = (0..parts.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b])) else { return };
        let least = MIN_PART * parts[main].len() as f64;
        for part in parts.iter().filter(|part| (part.len() as f64) < least) {
            part.iter().for_each(|&node| self.solid[node] = false);
        }
    }

    /// Whether nothing is solid.
    pub fn is_empty(&self) -> bool {
        !self.solid.contains(&true)
    }

    /// The cube around what is solid, with a margin; `None` where nothing is.
    pub fn cube_around(&self) -> Option<Cube> {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for node in (0..self.grid.len()).filter(|&node| self.solid[node]) {
            let at = self.origin + self.grid.position(node);
            (low, high) = (low.min(at), high.max(at));
        }
        let half = 0.5 * (high - low).max_element() + self.grid.spacing();
        (low.x <= high.x).then(|| Cube { origin: 0.5 * (low + high), half: (1.0 + MARGIN) * half })
    }

    /// Which pixels of a view show the volume.
    pub fn silhouette(&self, view: &Shrunk) -> Vec<bool> {
        let grid = &self.grid;
        let last = grid.nodes() - 1;
        let strides = [1, grid.nodes(), grid.nodes().pow(2)];
        let is_surface = |node: usize| {
            let at = grid.coordinates(node);
            (0..3).any(|axis| {
                at[axis] == 0
                    || at[axis] == last
                    || !self.solid[node - strides[axis]]
                    || !self.solid[node + strides[axis]]
            })
        };
        let mut shown = vec![false; view.len()];
        for node in (0..grid.len()).filter(|&node| self.solid[node] && is_surface(node)) {
            let (place, z) = view.camera.project(self.origin + grid.position(node));
            if z <= 0.0 {
                continue;
            }
            let half = 0.5 * grid.spacing() * view.camera.focal / z;
            let range = |center: f32, side: usize| {
                let low = (center - half).clamp(0.0, side as f32) as usize;
                low..((center + half).clamp(-1.0, side as f32 - 1.0).floor() + 1.0) as usize
            };
            for v in range(place.y, view.height) {
                for u in range(place.x, view.width) {
                    shown[v * view.width + u] = true;
                }
            }
        }
        shown
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::{Camera, View, stored};
    use glam::DVec3;
    use image::RgbImage;

    use super::*;

    #[test]
    fn a_place_is_kept_where_no_more_views_disagree_than_is_borne_with() {
        // A ring of views that all show a disc, but for some that show nothing.
        let eye = |index: usize| {
            let angle = std::f64::consts::TAU * index as f64 / 16.0;
            2.0 * DVec3::new(angle.cos(), 0.0, angle.sin())
        };
        let camera = |index| Camera::look_at(32, 32, 32.0, eye(index), DVec3::ZERO, DVec3::Y);
        let view = |index: usize| View::new(index.to_string(), camera(index), stored(RgbImage::new(32, 32)), None);
        let views: Vec<Shrunk> = (0..16).map(|index| Shrunk::new(&view(index), 32)).collect();
        let distance = |pixel: usize| ((pixel % 32) as f32 - 15.5).hypot((pixel / 32) as f32 - 15.5);
        let disc: Vec<f32> = (0..32 * 32).map(|pixel| if distance(pixel) < 6.0 { 1.0 } else { 0.0 }).collect();
        let nothing = vec![0.0; 32 * 32];
        let is_solid = |blind: usize, disagreeing: f32| {
            let belongs = |index: usize| if index < blind { &nothing } else { &disc };
            let views: Vec<(&Shrunk, &[f32])> =
                views.iter().enumerate().map(|(index, view)| (view, belongs(index).as_slice())).collect();
            let cube = Cube { origin: Vec3::ZERO, half: HALF };
            let round = Round { nodes: 17, disagreeing };
            !Volume::agreed(&views, cube, round, |_| true, &Cancellation::default()).unwrap().is_empty()
        };
        // Sixteenths.
        assert!(is_solid(0, 0.08) && is_solid(1, 0.16) && is_solid(2, 0.24));
        assert!(!is_solid(2, 0.08) && !is_solid(4, 0.16));
    }
}
