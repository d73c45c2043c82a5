//! Renders photographs of an object in two poses, and measures what was made of them:
//!
//! ```sh
//! cargo run --release -p dvr-stress --example two_poses -- render poses/ 24 480 masks
//! dvr train poses/top poses/bottom --out run/
//! cargo run --release -p dvr-stress --example two_poses -- measure poses/ poses/top-bottom-joined run/mesh.ply
//! ```

use std::error::Error;
use std::path::Path;

use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::mesh::{Mesh, read_mesh};
use dvr_core::metrics::alignment::align_to_surface;
use dvr_core::metrics::shape::score_surface;
use dvr_core::sampling::sample_surface;
use dvr_core::{Bvh, Camera, PointCloud, Similarity};
use dvr_stress::{TWO_SETS, TwoPoses, seam};
use glam::{DVec3, Vec3};

/// Points on each surface.
const SAMPLES: usize = 100_000;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    match args[..] {
        ["render", out, views, width, ref masks @ ..] if masks.is_empty() || masks == ["masks"] => {
            let poses = TwoPoses { views: views.parse()?, width: width.parse()?, samples: 3, masks: !masks.is_empty() };
            Ok(poses.write(Path::new(out))?)
        }
        ["measure", poses, joined, mesh] => measure(Path::new(poses), Path::new(joined), Path::new(mesh)),
        _ => Err("give `render OUT VIEWS WIDTH [masks]`, or `measure OUT JOINED MESH`".into()),
    }
}

/// Cameras by the names of their pictures.
type NamedCameras = Vec<(String, Camera)>;

/// The cameras of a scene by the names of its views, in its own world.
fn cameras(scene: &Path) -> Result<(NamedCameras, f64), Box<dyn Error>> {
    let scene = read_scene(scene, &ReadOptions::default())?;
    let world = |camera: &Camera| camera.into_world(&scene.object_to_world);
    let cameras = scene.views.iter().map(|view| (view.name.clone(), world(&view.camera))).collect();
    Ok((cameras, scene.object_to_world.scale))
}

fn measure(poses: &Path, joined: &Path, mesh: &Path) -> Result<(), Box<dyn Error>> {
    let (found, edge) = cameras(&joined.join("transforms.json"))?;
    let (mut ours, mut theirs) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    for (set, name) in TWO_SETS.iter().enumerate() {
        for (view, camera) in cameras(&poses.join("truth").join(name).join("transforms.json"))?.0 {
            let placed = found.iter().find(|(found, _)| *found == format!("{name}_{view}"));
            if let Some((_, placed)) = placed {
                ours[set].push(placed.clone());
                theirs[set].push(camera);
            }
        }
    }
    println!("{} and {} cameras", ours[0].len(), ours[1].len());
    let truth = read_mesh(poses.join("truth/mesh.ply"))?.mesh;
    let true_points: PointCloud = sample_surface(&truth, SAMPLES, 0).into();
    let centers = |cameras: &[Vec<Camera>; 2]| cameras.iter().flatten().map(Camera::center).collect::<Vec<DVec3>>();
    let to_truth = Similarity::between(&centers(&ours), &centers(&theirs)).ok_or("the cameras are no cameras")?;
    // The edge of the cube that the field is in, in units of the truth.
    let cube = edge * to_truth.scale;
    let (mean, largest) = seam([&ours[0], &ours[1]], [&theirs[0], &theirs[1]], &true_points.points)
        .ok_or("the cameras are no cameras")?;
    println!("seam: {:.5} of the cube in the mean, {:.5} at most", mean / cube, largest / cube);

    let mesh = read_mesh(mesh)?.mesh;
    let moved = |by: &Similarity, mesh: &Mesh| Mesh {
        vertices: mesh.vertices.iter().map(|vertex| by.transform_point_f32(*vertex)).collect(),
        normals: None,
        ..mesh.clone()
    };
    let by_cameras = moved(&to_truth, &mesh);
    let samples = |mesh: &Mesh| PointCloud::from(sample_surface(mesh, SAMPLES, 1));
    let aligned = moved(&align_to_surface(&samples(&by_cameras), &true_points, 0.1)?, &by_cameras);
    for (what, mesh) in [("by its cameras", &by_cameras), ("by its surface", &aligned)] {
        let score = score_surface(&samples(mesh), &true_points, &[])?;
        println!(
            "placed {what}: Chamfer-L1 {:.5} of the cube (accuracy {:.5}, completeness {:.5})",
            score.chamfer_l1 / cube,
            score.accuracy / cube,
            score.completeness / cube
        );
    }
    let bvh = Bvh::new(&aligned);
    for (what, axis) in [("facing down in the first pose", -1.0), ("facing up", 1.0)] {
        let normals = true_points.normals.iter().flatten();
        let facing: Vec<Vec3> = (true_points.points.iter().zip(normals))
            .filter(|(_, normal)| axis * normal.y > 0.7)
            .map(|(point, _)| *point)
            .collect();
        let mut distances: Vec<f64> =
            facing.iter().filter_map(|point| Some(bvh.nearest(point.as_dvec3())?.distance)).collect();
        distances.sort_by(f64::total_cmp);
        let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
        println!(
            "{what}: {:.5} of the cube from the mesh in the mean, 95 % within {:.5}",
            mean / cube,
            distances.get(distances.len() * 95 / 100).copied().unwrap_or_default() / cube
        );
    }
    Ok(())
}
