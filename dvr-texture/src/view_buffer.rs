//! What a camera sees of a mesh: the nearest face and its depth at points of the picture, by a z-buffer.
//!
//! Rays through a hierarchy tell the same of single points ([`dvr_core::Visibility`]); here all pixels of all pictures are
//! asked.

use dvr_core::mesh::Mesh;
use dvr_core::{Camera, Pinhole, View};
use glam::{Vec2, Vec3};

/// No face is seen.
pub(crate) const NOTHING: u32 = u32::MAX;

/// Pixels by which what is in front of an edge is taken to be wider than it is: neither the surface nor the camera is
/// known better, and its colours must not be found on what is behind.
const FRONT_RIM: usize = 1;

/// Share of its depth that a point may lie behind what is seen in its pixel.
const CLEARANCE: f32 = 2e-3;

/// Steepest slope, as a tangent between line of sight and normal, for which the margin of the depth test grows.
const MAX_TANGENT: f32 = 5.0;

/// Cells of all z-buffers together, at most, where the texture's size does not ask for more. Where photographs have more
/// pixels, a cell is several pixels wide.
const MAX_CELLS: u64 = 64_000_000;

/// Pixels along the edge of a cell where all of these views are drawn.
pub(crate) fn stride(views: &[&View]) -> u32 {
    let pixels: u64 = views.iter().map(|view| u64::from(view.camera.width) * u64::from(view.camera.height)).sum();
    (pixels as f64 / MAX_CELLS as f64).sqrt().ceil().max(1.0) as u32
}

/// The nearest face and its z-depth at the middles of cells of `stride` x `stride` pixels.
#[derive(Clone, Debug)]
pub(crate) struct ViewBuffer {
    pub camera: Pinhole,
    /// Size of the picture in pixels.
    pub picture: (u32, u32),
    /// Edge of a cell in pixels.
    pub stride: u32,
    pub width: u32,
    pub height: u32,
    /// The least z-depth within [`FRONT_RIM`] cells.
    front: Vec<f32>,
    face: Vec<u32>,
}

impl ViewBuffer {
    /// Columns and rows of cells of `stride` x `stride` pixels.
    pub fn cells(camera: &Camera, stride: u32) -> [u32; 2] {
        [camera.width, camera.height].map(|side| side.div_ceil(stride))
    }

    /// Draws a mesh of the camera's space. Faces that reach behind the camera are left out.
    pub fn draw(mesh: &Mesh, camera: &Camera, stride: u32) -> Self {
        let [width, height] = Self::cells(camera, stride);
        let cells = width as usize * height as usize;
        let mut buffer = Self {
            camera: Pinhole::new(camera),
            picture: (camera.width, camera.height),
            stride,
            width,
            height,
            front: vec![f32::INFINITY; cells],
            face: vec![NOTHING; cells],
        };
        let scale = 1.0 / stride as f32;
        let corners: Vec<Vec3> = (mesh.vertices.iter())
            .map(|&vertex| {
                let (pixel, z) = buffer.camera.project(vertex);
                (pixel * scale).extend(z)
            })
            .collect();
        for (face, indices) in mesh.faces.iter().enumerate() {
            buffer.draw_face(face as u32, indices.map(|i| corners[i as usize]));
        }
        buffer.widen_front();
        buffer
    }

    /// From the z-depth of each cell to the least of those around it.
    fn widen_front(&mut self) {
        let width = self.width as usize;
        if width == 0 {
            return;
        }
        let rows: Vec<Vec<f32>> = self.front.chunks(width).map(least_around).collect();
        for (v, row) in self.front.chunks_mut(width).enumerate() {
            let around = &rows[v.saturating_sub(FRONT_RIM)..(v + FRONT_RIM + 1).min(rows.len())];
            for (u, front) in row.iter_mut().enumerate() {
                *front = around.iter().map(|row| row[u]).fold(f32::INFINITY, f32::min);
            }
        }
    }

    fn draw_face(&mut self, face: u32, [a, b, c]: [Vec3; 3]) {
        let nearest = a.z.min(b.z).min(c.z);
        if nearest <= 0.0 || nearest.is_nan() {
            return;
        }
        let low = a.min(b).min(c);
        let high = a.max(b).max(c);
        let first = |x: f32| (x - 0.5).ceil().max(0.0) as i64;
        let last = |x: f32, count: u32| ((x - 0.5).floor() as i64).min(i64::from(count) - 1);
        let (u_first, u_last) = (first(low.x), last(high.x, self.width));
        let (v_first, v_last) = (first(low.y), last(high.y, self.height));
        if u_first > u_last || v_first > v_last {
            return;
        }
        let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if area == 0.0 {
            return;
        }
        // 1/z is linear in the picture.
        let inverse = [a.z, b.z, c.z].map(f32::recip);
        for v in v_first..=v_last {
            for u in u_first..=u_last {
                let (x, y) = (u as f32 + 0.5, v as f32 + 0.5);
                let weight = |p: Vec3, q: Vec3| ((q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x)) / area;
                let weights = [weight(b, c), weight(c, a), weight(a, b)];
                if weights.iter().any(|&weight| weight < -1e-4) {
                    continue;
                }
                let z = (weights[0] * inverse[0] + weights[1] * inverse[1] + weights[2] * inverse[2]).recip();
                let cell = v as usize * self.width as usize + u as usize;
                if z > 0.0 && z < self.front[cell] {
                    self.front[cell] = z;
                    self.face[cell] = face;
                }
            }
        }
    }

    /// The face that is seen in a cell, [`NOTHING`] where there is none.
    pub fn face(&self, u: u32, v: u32) -> u32 {
        self.face[v as usize * self.width as usize + u as usize]
    }

    /// Cells in which a face is seen.
    pub fn seen_cells(&self) -> usize {
        self.face.iter().filter(|&&face| face != NOTHING).count()
    }

    /// Pixel coordinates of the middle of a cell.
    pub fn pixel(&self, u: u32, v: u32) -> Vec2 {
        self.stride as f32 * Vec2::new(u as f32 + 0.5, v as f32 + 0.5)
    }

    /// Whether nothing stands in front of a point with this projection, where the surface is seen under this cosine; also
    /// nothing beside it within a pixel.
    pub fn is_open(&self, pixel: Vec2, z_depth: f32, cosine: f32) -> bool {
        let cell = pixel / self.stride as f32;
        let tangent = ((1.0 - cosine * cosine).max(0.0).sqrt() / cosine).min(MAX_TANGENT);
        // What a slope changes within the cells that are looked at.
        let per_cell = self.stride as f32 * z_depth / self.camera.focal;
        let margin = CLEARANCE * z_depth + 2.5 * per_cell * tangent;
        let (u, v) = ((cell.x as u32).min(self.width - 1), (cell.y as u32).min(self.height - 1));
        self.front[v as usize * self.width as usize + u as usize] >= z_depth - margin
    }

    /// Barycentric coordinates of the point at which the line of sight through a pixel meets the plane of a triangle.
    pub fn barycentric(&self, pixel: Vec2, triangle: [Vec3; 3]) -> Option<[f32; 3]> {
        let corners = triangle.map(|corner| self.camera.project(corner));
        let [(a, _), (b, _), (c, _)] = corners;
        let cross = |p: Vec2, q: Vec2| (q - p).perp_dot(pixel - p);
        let area = (b - a).perp_dot(c - a);
        let flat = [cross(b, c) / area, cross(c, a) / area, cross(a, b) / area];
        let over_z = [0, 1, 2].map(|k| flat[k] / corners[k].1);
        let sum = over_z[0] + over_z[1] + over_z[2];
        let weights = over_z.map(|weight| (weight / sum).clamp(0.0, 1.0));
        weights.iter().all(|weight| weight.is_finite()).then_some(weights)
    }
}

/// The least number within [`FRONT_RIM`] places of each.
fn least_around(row: &[f32]) -> Vec<f32> {
    let around = |u: usize| &row[u.saturating_sub(FRONT_RIM)..(u + FRONT_RIM + 1).min(row.len())];
    (0..row.len()).map(|u| around(u).iter().copied().fold(f32::INFINITY, f32::min)).collect()
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes;
    use dvr_core::{Bvh, Ray};
    use glam::DVec3;

    use super::*;

    fn camera() -> Camera {
        Camera::look_at(60, 50, 60.0, DVec3::new(0.3, 0.4, 2.0), DVec3::ZERO, DVec3::Y)
    }

    #[test]
    fn the_face_that_is_drawn_is_the_one_that_a_ray_meets_first() {
        let screen = shapes::cuboid(Vec3::new(-0.1, -0.6, 0.5), Vec3::new(0.1, 0.6, 0.55));
        let mesh = shapes::union([shapes::icosphere(3, 0.4), screen]);
        let (camera, bvh) = (camera(), Bvh::new(&mesh));
        let buffer = ViewBuffer::draw(&mesh, &camera, 1);
        let (mut same, mut all) = (0, 0);
        for (u, v) in (0..50).flat_map(|v| (0..60).map(move |u| (u, v))) {
            let ray: Ray = camera.pixel_ray(u, v);
            let hit = bvh.closest_hit(&ray, 0.0, f64::INFINITY);
            let face = buffer.face(u, v);
            assert!(hit.is_none() || face != NOTHING || u == 0, "a hole at {u} {v}");
            if let Some(hit) = hit {
                all += 1;
                same += usize::from(hit.face == face);
                if hit.face == face {
                    let found = buffer.barycentric(buffer.pixel(u, v), mesh.triangle(face as usize)).unwrap();
                    (0..3).for_each(|k| assert!((f64::from(found[k]) - hit.barycentric[k]).abs() < 1e-2, "{u} {v}"));
                }
            }
        }
        assert!(all > 600 && same * 100 > all * 98, "{same} of {all}");
    }

    #[test]
    fn what_stands_in_front_hides_also_beside_its_edge() {
        let wall = shapes::cuboid(Vec3::new(-0.5, -0.5, -0.1), Vec3::new(0.5, 0.5, 0.0));
        let screen = shapes::cuboid(Vec3::new(-0.5, -0.5, 0.5), Vec3::new(0.0, 0.5, 0.55));
        let camera = Camera::look_at(64, 64, 64.0, 2.0 * DVec3::Z, DVec3::ZERO, DVec3::Y);
        let (alone, both) = (wall.clone(), shapes::union([wall, screen]));
        let open = |mesh: &Mesh, x: f32| {
            let buffer = ViewBuffer::draw(mesh, &camera, 1);
            let (pixel, z) = buffer.camera.project(Vec3::new(x, 0.0, 0.0));
            buffer.is_open(pixel, z, 1.0)
        };
        // A pixel is a 32nd of a unit wide at the wall.
        assert!([-0.3, 0.02, 0.3].into_iter().all(|x| open(&alone, x)));
        assert!(!open(&both, -0.3) && !open(&both, 0.02) && open(&both, 0.3));
    }
}
