//! Photographs of one object in two poses, standing and turned over, each on a table of its own: plain pictures, whose
//! cameras and masks are to be found.

use std::path::Path;

use dvr_core::dataset::write_transforms;
use dvr_core::mesh::shapes::{icosphere, vertex_normals};
use dvr_core::mesh::{Mesh, write_mesh};
use dvr_core::{Bvh, Camera, Error, Result, Sighting, Similarity, triangulate};
use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;

use crate::tabletop::{Coat, Surroundings, Tabletop, orbit};

/// The names of the two sets.
pub const SETS: [&str; 2] = ["top", "bottom"];

/// What is around each.
const TABLES: [Surroundings; 2] = [Surroundings::Cloth, Surroundings::Tiles];

/// Where the object is cut flat, below and above: it stands on either.
const FLAT: [f32; 2] = [-0.25, 0.3];

/// Elevations of rings of cameras above the object's middle, degrees: half of them are low, and see in both poses the same
/// of the sides.
const ELEVATIONS: [f64; 4] = [8.0, 32.0, 8.0, 58.0];

/// How the two poses are photographed.
#[derive(Clone, Copy, Debug)]
pub struct TwoPoses {
    /// Photographs of each.
    pub views: usize,
    /// Width of a photograph in pixels; it is three quarters as high.
    pub width: u32,
    /// Samples along each axis of a pixel.
    pub samples: u32,
    /// Whether the photographs have masks, in the folder `masks` of each set.
    pub masks: bool,
}

impl TwoPoses {
    /// The object: a stone with dents, a nose on one side, and two flat ends.
    pub fn object() -> Mesh {
        let ball = icosphere(6, 1.0);
        let of = |n: &Vec3| {
            let waves = (4.0 * n.x + 1.0).sin() * (3.5 * n.y).cos() + 0.8 * (4.5 * n.z + 0.5).sin() * (3.0 * n.x).cos();
            let nose = 0.16 * (-(18.0 * (1.0 - n.dot(Vec3::new(0.8, 0.1, 0.59).normalize())))).exp();
            let place = (0.34 * (1.0 + 0.14 * waves) + nose) * *n * Vec3::new(1.15, 1.0, 0.9);
            Vec3::new(place.x, place.y.clamp(FLAT[0], FLAT[1]), place.z)
        };
        let vertices: Vec<Vec3> = ball.vertices.iter().map(of).collect();
        let normals = Some(vertex_normals(&vertices, &ball.faces));
        Mesh { vertices, normals, ..ball }
    }

    /// Takes the object to the table of a set: as it is, or turned over by 180 degrees and some more about the vertical.
    fn pose(set: usize) -> Similarity {
        let (rotation, foot) = match set {
            0 => (DQuat::IDENTITY, FLAT[0]),
            _ => (DQuat::from_rotation_y(0.7) * DQuat::from_rotation_x(std::f64::consts::PI), -FLAT[1]),
        };
        Similarity { scale: 1.0, rotation, translation: DVec3::new(0.0, -f64::from(foot), 0.0) }
    }

    /// The cameras of a set, in the object's coordinates.
    pub fn cameras(&self, set: usize) -> Vec<Camera> {
        let pose = Self::pose(set);
        let on_table = orbit(self.views, self.width, &ELEVATIONS, set as f64);
        on_table.iter().map(|camera| camera.into_object_space(&pose)).collect()
    }

    /// Writes the photographs to `top/` and `bottom/` in a folder, and the truth, the mesh and the cameras in its
    /// coordinates, to `truth/`.
    ///
    /// # Errors
    /// [`Error::Io`] where something cannot be written.
    pub fn write(&self, out: &Path) -> Result<()> {
        let mesh = Self::object();
        let bvh = Bvh::new(&mesh);
        for (set, name) in SETS.iter().enumerate() {
            let (folder, truth) = (out.join(name), out.join("truth").join(name));
            let masks = folder.join("masks");
            for folder in [&folder, &truth].into_iter().chain(self.masks.then_some(&masks)) {
                std::fs::create_dir_all(folder).map_err(|source| Error::Io { path: folder.clone(), source })?;
            }
            let cameras = self.cameras(set);
            let (pose, surroundings) = (Self::pose(set), TABLES[set]);
            let tabletop = Tabletop { mesh: &mesh, bvh: &bvh, pose, coat: Coat::Stone, surroundings };
            tabletop.write(&cameras, self.samples, &folder, self.masks.then_some(masks.as_path()))?;
            let names: Vec<String> = (0..cameras.len()).map(|i| format!("../../{name}/{i:04}.jpg")).collect();
            write_transforms(&truth.join("transforms.json"), names.iter().map(String::as_str).zip(&cameras), None)?;
        }
        write_mesh(out.join("truth/mesh.ply"), &mesh)
    }
}

/// How far apart two sets of cameras that were placed in one world have what both show: where the cameras of each
/// triangulate the points of the surface, from where the true cameras see these. The mean and the largest distance, in
/// the units of the truth; `None` where cameras determine no points.
pub fn seam(found: [&[Camera]; 2], truth: [&[Camera]; 2], points: &[Vec3]) -> Option<(f64, f64)> {
    let centers = |sets: [&[Camera]; 2]| sets.iter().flat_map(|set| set.iter().map(Camera::center)).collect::<Vec<_>>();
    let to_truth = Similarity::between(&centers(found), &centers(truth))?;
    let place = |set: usize, point: Vec3| {
        let bearing = |found: &Camera, truth: &Camera| {
            let p = truth.rotation * point.as_dvec3() + truth.translation;
            // What a lens does beyond its focal length hardly counts in the middle of a picture.
            let zoom = truth.intrinsics.x_axis.x / found.intrinsics.x_axis.x;
            zoom * p.truncate() / p.z
        };
        let sightings: Vec<Sighting> = (found[set].iter().zip(truth[set]))
            .map(|(camera, truth)| Sighting { camera, bearing: bearing(camera, truth) })
            .collect();
        Some(triangulate(&sightings)?.point)
    };
    let distances: Vec<f64> = (points.par_iter())
        .map(|point| Some(to_truth.scale * (place(0, *point)? - place(1, *point)?).length()))
        .collect::<Option<_>>()?;
    let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
    Some((mean, distances.into_iter().fold(0.0, f64::max)))
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::Topology;

    use super::*;

    #[test]
    fn the_object_is_closed_and_stands_on_both_tables() {
        let mesh = TwoPoses::object();
        assert_eq!(Topology::of(&mesh).handles(), Some(0));
        for set in [0, 1] {
            let pose = TwoPoses::pose(set);
            let lowest =
                mesh.vertices.iter().map(|v| pose.transform_point(v.as_dvec3()).y).fold(f64::INFINITY, f64::min);
            assert!(lowest.abs() < 1e-6, "{lowest}");
        }
    }

    #[test]
    fn a_seam_is_what_one_set_is_moved_by() {
        let poses = TwoPoses { views: 9, width: 40, samples: 1, masks: false };
        let truth = [poses.cameras(0), poses.cameras(1)];
        let elsewhere = Similarity { scale: 2.0, rotation: DQuat::from_rotation_z(1.0), translation: DVec3::ONE };
        let all_of = |set: usize| truth[set].iter().map(|camera| camera.into_world(&elsewhere)).collect::<Vec<_>>();
        let (top, bottom) = (all_of(0), all_of(1));
        let points = &TwoPoses::object().vertices;
        let (mean, largest) = seam([&top, &bottom], [&truth[0], &truth[1]], points).unwrap();
        assert!(mean < 1e-9 && largest < 1e-9);
        let shift = Similarity { translation: DVec3::new(0.02, 0.0, 0.0), ..Similarity::default() };
        let moved: Vec<Camera> = bottom.iter().map(|camera| camera.into_world(&shift)).collect();
        let (mean, largest) = seam([&top, &moved], [&truth[0], &truth[1]], points).unwrap();
        // In units of the truth, which are half as large; all cameras together tell by how much, and some were moved.
        assert!((mean - 0.01).abs() < 1e-4 && (largest - 0.01).abs() < 1e-4, "{mean} {largest}");
    }
}
