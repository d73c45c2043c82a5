//! Surfaces of point clouds: screened Poisson reconstruction (Kazhdan and Hoppe, *Screened Poisson Surface
//! Reconstruction*, ACM Transactions on Graphics 2013) and trimming, by the authors' own code, which COLMAP has as
//! `poisson_mesher`.

use std::path::PathBuf;

use dvr_core::Cancellation;
use dvr_core::mesh::{Mesh, read_mesh, shapes, write_mesh};

use crate::child::{Log, Task, run};
use crate::engine::Engine;
use crate::error::{Result, SfmError};

/// How a surface is made of points.
#[derive(Clone, Debug)]
pub struct PoissonOptions {
    /// Depth of the octree: the finest cells divide the longest edge of the cloud, and a tenth around it, by two to this
    /// power.
    pub depth: u32,
    /// Parts of the surface where the octree of the points is less deep than this are cut away: where no points were, the
    /// surface is a guess. 0 keeps all, which closes the surface.
    pub trim: f64,
    /// Weight of the points against their normals (the paper's `alpha`).
    pub point_weight: f64,
    /// Threads; `None` takes as many as the machine has.
    pub threads: Option<usize>,
    /// COLMAP's program; `None` looks for `colmap` in the folders of `PATH`.
    pub program: Option<PathBuf>,
    /// Ends the work early; COLMAP is ended with it.
    pub cancellation: Cancellation,
}

impl Default for PoissonOptions {
    fn default() -> Self {
        Self {
            depth: 9,
            trim: 0.0,
            point_weight: 1.0,
            threads: None,
            program: None,
            cancellation: Cancellation::default(),
        }
    }
}

/// The surface of a cloud of points with outward normals, given as a mesh whose faces are not looked at. Colours of the
/// points become those of the vertices; normals are those of the surface.
///
/// # Errors
/// [`SfmError::NoNormals`] where the points have none; [`SfmError::NoSurface`] where nothing is left of the surface, and
/// those of COLMAP as [`find_cameras`](crate::find_cameras) has them.
pub fn poisson_surface(cloud: &Mesh, options: &PoissonOptions) -> Result<Mesh> {
    let points = oriented(cloud)?;
    let engine = Engine::find(options.program.as_deref(), "makes surfaces of points", &options.cancellation)?;
    let folder = tempfile::tempdir().map_err(|source| dvr_core::Error::io(std::env::temp_dir(), source))?;
    let [input, output] = ["points.ply", "surface.ply"].map(|name| folder.path().join(name));
    write_mesh(&input, &points)?;
    let known = engine.options("poisson_mesher");
    let mut command = engine.command("poisson_mesher");
    command.arg("--input_path").arg(&input).arg("--output_path").arg(&output);
    known.set(&mut command, &["PoissonMeshing.depth"], options.depth);
    known.set(&mut command, &["PoissonMeshing.trim"], options.trim);
    known.set(&mut command, &["PoissonMeshing.point_weight"], options.point_weight);
    if points.colors.is_none() {
        known.set(&mut command, &["PoissonMeshing.color"], 0);
    }
    if let Some(threads) = options.threads {
        known.set(&mut command, &["PoissonMeshing.num_threads"], threads);
    }
    // Its threads wait for each other by spinning: minutes in place of seconds, where other programs run.
    command.env("OMP_WAIT_POLICY", "passive");
    let task = Task { program: "colmap", step: "surface", takes_bytes: false };
    run(&mut command, task, &mut Log::none(), &options.cancellation, &mut |_| ())?;
    let surface = if output.is_file() { read_mesh(&output)?.mesh } else { Mesh::default() };
    if surface.faces.is_empty() {
        return Err(SfmError::NoSurface { points: points.vertices.len(), trim: options.trim });
    }
    let normals = shapes::vertex_normals(&surface.vertices, &surface.faces);
    Ok(Mesh { normals: Some(normals), colors: surface.colors.filter(|_| points.colors.is_some()), ..surface })
}

/// The points that have a normal.
fn oriented(cloud: &Mesh) -> Result<Mesh> {
    let count = cloud.vertices.len();
    let Some(normals) = &cloud.normals else { return Err(SfmError::NoNormals { points: count }) };
    let oriented: Vec<usize> = (0..count).filter(|&i| normals[i].length_squared() > 0.0).collect();
    if oriented.is_empty() {
        return Err(SfmError::NoNormals { points: count });
    }
    Ok(Mesh {
        vertices: oriented.iter().map(|&i| cloud.vertices[i]).collect(),
        normals: Some(oriented.iter().map(|&i| normals[i]).collect()),
        colors: cloud.colors.as_ref().map(|colors| oriented.iter().map(|&i| colors[i]).collect()),
        ..Mesh::default()
    })
}

#[cfg(test)]
mod tests {
    use dvr_core::sampling::sample_surface;
    use dvr_test_support::test_with;
    use glam::Vec3;

    use super::*;

    /// Points of a ball of radius 2, without those above 1.2.
    fn open_ball() -> Mesh {
        let samples = sample_surface(&shapes::icosphere(5, 2.0), 20_000, 1);
        let low: Vec<usize> = (0..samples.points.len()).filter(|&i| samples.points[i].z < 1.2).collect();
        let pick = |all: &[Vec3]| low.iter().map(|&i| all[i]).collect::<Vec<Vec3>>();
        Mesh { vertices: pick(&samples.points), normals: Some(pick(&samples.normals)), ..Mesh::default() }
    }

    #[test_with(colmap)]
    fn a_surface_goes_through_its_points_and_trimming_leaves_open_what_no_point_shows() {
        let options = PoissonOptions { depth: 6, threads: Some(1), ..PoissonOptions::default() };
        let cloud = open_ball();
        let closed = poisson_surface(&cloud, &options).unwrap();
        let trimmed = poisson_surface(&cloud, &PoissonOptions { trim: 5.0, ..options.clone() }).unwrap();
        let highest = |mesh: &Mesh| mesh.vertices.iter().fold(-9.0f32, |most, vertex| most.max(vertex.z));
        assert!(highest(&closed) > 1.7, "{}", highest(&closed));
        assert!((1.0..1.6).contains(&highest(&trimmed)), "{}", highest(&trimmed));
        let off = |mesh: &Mesh| {
            let low = mesh.vertices.iter().filter(|vertex| vertex.z < 1.0);
            low.map(|vertex| (vertex.length() - 2.0).abs()).fold(0.0, f32::max)
        };
        assert!(off(&closed) < 0.05 && off(&trimmed) < 0.05, "{} {}", off(&closed), off(&trimmed));
        let outward = trimmed.vertices.iter().zip(trimmed.normals.as_ref().unwrap());
        assert!(outward.filter(|(vertex, normal)| vertex.dot(**normal) < 0.0).count() == 0);
        assert_eq!(trimmed.colors, None, "the points have none");

        let colors = cloud.vertices.iter().map(|vertex| if vertex.x > 0.0 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] });
        let colored = Mesh { colors: Some(colors.collect()), ..cloud.clone() };
        let colored = poisson_surface(&colored, &options).unwrap();
        let red = colored.vertices.iter().zip(colored.colors.as_ref().unwrap()).filter(|(vertex, _)| vertex.x > 0.5);
        assert!(red.clone().count() > 100 && red.clone().all(|(_, color)| color[0] > color[2]));

        let none = poisson_surface(&cloud, &PoissonOptions { trim: 20.0, ..options }).unwrap_err();
        assert!(matches!(none, SfmError::NoSurface { trim: 20.0, .. }), "{none}");
    }

    #[test]
    fn points_without_normals_are_refused_before_anything_is_run() {
        let program = Some(PathBuf::from("/nowhere/colmap"));
        let options = PoissonOptions { program, ..PoissonOptions::default() };
        let bare = Mesh { normals: None, ..open_ball() };
        assert!(matches!(poisson_surface(&bare, &options), Err(SfmError::NoNormals { points: 15_000.. })));
        let zero = Mesh { normals: Some(vec![Vec3::ZERO; bare.vertices.len()]), ..bare };
        assert!(matches!(poisson_surface(&zero, &options), Err(SfmError::NoNormals { .. })));
        assert!(matches!(poisson_surface(&open_ball(), &options), Err(SfmError::NotInstalled { .. })));
    }
}
