//! An object on a table before several kinds of background: photographs with cameras and without masks, for what is to
//! find these.

use std::path::Path;

use dvr_core::dataset::write_transforms;
use dvr_core::mesh::shapes::{cuboid, revolve, union, vertex_normals};
use dvr_core::mesh::{Mesh, write_mesh};
use dvr_core::{Bvh, Camera, Error, Result, Similarity};
use glam::{Vec2, Vec3};

use crate::tabletop::{Coat, Surroundings, Tabletop, orbit};
use crate::two_poses::TwoPoses;

/// Elevations of rings of cameras above the object's middle, degrees.
const ELEVATIONS: [f64; 3] = [15.0, 38.0, 60.0];

/// What stands on the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Body {
    /// That of [`TwoPoses`]: a stone with dents and a nose.
    Stone,
    /// A stool: a round seat on four legs.
    Stool,
}

/// How an object on a table is photographed.
#[derive(Clone, Copy, Debug)]
pub struct StillLife {
    /// The object.
    pub body: Body,
    /// What it is painted with.
    pub coat: Coat,
    /// What is around it.
    pub surroundings: Surroundings,
    /// Photographs.
    pub views: usize,
    /// Width of a photograph in pixels; it is three quarters as high.
    pub width: u32,
    /// Samples along each axis of a pixel.
    pub samples: u32,
}

impl StillLife {
    /// The object; `y` is up, and the table is `y = 0`.
    pub fn object(&self) -> Mesh {
        match self.body {
            Body::Stone => {
                let mut mesh = TwoPoses::object();
                let foot = mesh.vertices.iter().map(|v| v.y).fold(f32::INFINITY, f32::min);
                mesh.vertices.iter_mut().for_each(|v| v.y -= foot);
                mesh
            }
            Body::Stool => stool(),
        }
    }

    /// The cameras.
    pub fn cameras(&self) -> Vec<Camera> {
        orbit(self.views, self.width, &ELEVATIONS, 0.0)
    }

    /// Writes the photographs and their cameras to a folder, and there to `truth/` the mesh and the masks.
    ///
    /// # Errors
    /// [`Error::Io`] where something cannot be written.
    pub fn write(&self, out: &Path) -> Result<()> {
        let masks = out.join("truth/masks");
        std::fs::create_dir_all(&masks).map_err(|source| Error::Io { path: masks.clone(), source })?;
        let (mesh, cameras) = (self.object(), self.cameras());
        let (coat, surroundings) = (self.coat, self.surroundings);
        let tabletop = Tabletop { mesh: &mesh, bvh: &Bvh::new(&mesh), pose: Similarity::default(), coat, surroundings };
        tabletop.write(&cameras, self.samples, out, Some(&masks))?;
        let names: Vec<String> = (0..cameras.len()).map(|i| format!("{i:04}.jpg")).collect();
        write_transforms(&out.join("transforms.json"), names.iter().map(String::as_str).zip(&cameras), None)?;
        write_mesh(out.join("truth/mesh.ply"), &mesh)
    }
}

/// A round seat with a rim on four square legs that it rests on.
fn stool() -> Mesh {
    let profile = [
        Vec2::new(0.0, 0.4),
        Vec2::new(0.3, 0.4),
        Vec2::new(0.36, 0.43),
        Vec2::new(0.36, 0.52),
        Vec2::new(0.3, 0.54),
        Vec2::new(0.24, 0.5),
        Vec2::new(0.0, 0.5),
    ];
    let leg = |[x, z]: [f32; 2]| {
        cuboid(Vec3::new(0.2 * x - 0.035, 0.0, 0.2 * z - 0.035), Vec3::new(0.2 * x + 0.035, 0.4, 0.2 * z + 0.035))
    };
    let legs = [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]].map(leg);
    let mesh = union(std::iter::once(revolve(&profile, 96)).chain(legs));
    // Corners of faces of their own, since edges are sharp.
    let vertices: Vec<Vec3> = mesh.faces.iter().flatten().map(|corner| mesh.vertices[*corner as usize]).collect();
    let faces: Vec<[u32; 3]> = (0..vertices.len() as u32 / 3).map(|face| [0, 1, 2].map(|i| 3 * face + i)).collect();
    let normals = Some(vertex_normals(&vertices, &faces));
    Mesh { vertices, faces, normals, ..Mesh::default() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_photographed_rests_on_the_table() {
        for body in [Body::Stone, Body::Stool] {
            let (coat, surroundings) = (Coat::Plain, Surroundings::Cloth);
            let mesh = StillLife { body, coat, surroundings, views: 1, width: 4, samples: 1 }.object();
            let lowest = mesh.vertices.iter().map(|v| v.y).fold(f32::INFINITY, f32::min);
            let resting = mesh.vertices.iter().filter(|v| v.y - lowest < 1e-6).count();
            assert!(lowest.abs() < 1e-6 && resting >= 12, "{body:?}: {lowest}, {resting}");
        }
    }
}
