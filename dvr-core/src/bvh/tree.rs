//! The hierarchy and its traversal.

use glam::Vec3;
use rayon::prelude::*;

use super::build::{MAX_CODE_DEPTH, build};
use super::node::{Node, Slabs};
use super::triangle::{RayHit, Shear};
use crate::mesh::Mesh;
use crate::ray::Ray;

/// Below the depth of codes, a `u32` of triangles allows 32 halvings.
pub(super) const STACK_SIZE: usize = MAX_CODE_DEPTH + 32;

/// A bounding volume hierarchy over a mesh's triangles.
#[derive(Clone, Debug)]
pub struct Bvh {
    /// The root comes first; the children of an inner node lie side by side.
    pub(super) nodes: Vec<Node>,
    /// Corners, in the order of the leaves.
    pub(super) triangles: Vec<[Vec3; 3]>,
    /// Face of each triangle.
    pub(super) faces: Vec<u32>,
}

impl Bvh {
    /// Builds the hierarchy. Faces without area are kept and never hit; those with a corner that is not finite are left out.
    ///
    /// # Panics
    /// When a face names a vertex that is not there; meshes that were read from files never do.
    pub fn new(mesh: &Mesh) -> Self {
        let of_faces: Vec<[Vec3; 3]> = (0..mesh.faces.len()).into_par_iter().map(|face| mesh.triangle(face)).collect();
        let (faces, nodes) = build(&of_faces);
        let triangles = faces.par_iter().map(|&face| of_faces[face as usize]).collect();
        Self { nodes, triangles, faces }
    }

    /// The first hit with `ray_depth` in `[min_depth, max_depth]`; from both sides of the faces.
    ///
    /// Where two faces are hit at the very same depth (on a shared edge) the one with the smaller index is given.
    pub fn closest_hit(&self, ray: &Ray, min_depth: f64, max_depth: f64) -> Option<RayHit> {
        let mut closest: Option<RayHit> = None;
        self.traverse(ray, min_depth, max_depth, |hit| {
            let nearer = |c: RayHit| hit.ray_depth < c.ray_depth || (hit.ray_depth == c.ray_depth && hit.face < c.face);
            if closest.is_none_or(nearer) {
                closest = Some(hit);
            }
            closest.map_or(max_depth, |c| c.ray_depth)
        });
        closest
    }

    /// Whether anything is hit with `ray_depth` in `[min_depth, max_depth]`: shadows.
    pub fn any_hit(&self, ray: &Ray, min_depth: f64, max_depth: f64) -> bool {
        let mut any = false;
        self.traverse(ray, min_depth, max_depth, |_| {
            any = true;
            f64::NEG_INFINITY
        });
        any
    }

    /// Visits hits, nearer boxes first. `visit` returns up to which depth further hits matter.
    fn traverse(&self, ray: &Ray, min_depth: f64, mut max_depth: f64, mut visit: impl FnMut(RayHit) -> f64) {
        let Some(shear) = Shear::new(ray).filter(|_| !self.faces.is_empty()) else { return };
        let slabs = Slabs::new(ray, &self.nodes[0]);
        let mut range = slabs.range(min_depth, max_depth);
        let mut stack = [(0u32, f32::NEG_INFINITY); STACK_SIZE];
        let mut height = usize::from(slabs.entry(&self.nodes[0], range).is_some());
        while height > 0 {
            height -= 1;
            let (index, entry) = stack[height];
            if entry > range[1] {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count() > 0 {
                for i in node.first()..node.first() + node.count() {
                    let hit = shear.intersect(&self.triangles[i as usize], self.faces[i as usize]);
                    if let Some(hit) = hit.filter(|h| h.ray_depth >= min_depth && h.ray_depth <= max_depth) {
                        max_depth = visit(hit);
                        range = slabs.range(min_depth, max_depth);
                    }
                }
                continue;
            }
            let child = |i: u32| slabs.entry(&self.nodes[i as usize], range).map(|entry| (i, entry));
            let (mut near, mut far) = (child(node.first()), child(node.first() + 1));
            if let (Some(a), Some(b)) = (near, far)
                && a.1 > b.1
            {
                (near, far) = (far, near);
            }
            for next in [far, near].into_iter().flatten() {
                stack[height] = next;
                height += 1;
            }
        }
    }
}
