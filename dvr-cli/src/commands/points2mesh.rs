//! `dvr points2mesh`: a surface of a cloud of points, or of the points that stereo finds in a scene.

use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use dvr_core::dataset::ReadOptions;
use dvr_core::files::check_file;
use dvr_core::mesh::{Mesh, check_mesh_format, read_mesh_with_warnings, write_mesh};
use dvr_core::metrics::Simplification;
use dvr_core::{Cancellation, HOLD_OUT_EVERY, Scene, ViewSplit, stereo_cloud};
use dvr_sfm::{PoissonOptions, poisson_surface};
use dvr_train::{Observer, method_by_name, with_faces};

use super::simplified::simplified_to;
use super::{SceneReading, print_notes, refinement_notes};
use crate::args::{FaceBudget, Points2MeshArgs};
use crate::progress::Progress;

/// Reads, makes the surface and writes it.
pub fn run(args: &Points2MeshArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    check_mesh_format(&args.out)?;
    check_file(&args.out, args.overwrite)?;
    let cloud = cloud(args, cancellation)?;
    let options = PoissonOptions { cancellation: cancellation.clone(), ..args.options() };
    let mut surface = poisson_surface(&cloud, &options).with_context(|| args.cloud.display().to_string())?;
    println!("{} points became {} faces", cloud.vertices.len(), surface.faces.len());
    let mut notes = Vec::new();
    if let Some(simple) = with_faces(&surface, args.faces.and_then(FaceBudget::limit), false, &mut notes) {
        print_notes(&notes);
        println!("{}", simplified_to(simple.faces.len(), &Simplification::between(&surface, &simple), false));
        surface = simple;
    }
    write_mesh(&args.out, &surface)?;
    println!("wrote {}", args.out.display());
    Ok(ExitCode::SUCCESS)
}

/// The points of the file, or of the scene.
fn cloud(args: &Points2MeshArgs, cancellation: &Cancellation) -> Result<Mesh> {
    let is_scene =
        args.cloud.is_dir() || args.cloud.extension().is_some_and(|ending| ending == "json" || ending == "npz");
    if !is_scene {
        if args.cloud_out.is_some() {
            bail!("--cloud-out writes the points of a scene, and {} has points already", args.cloud.display());
        }
        if args.reading.read_options() != ReadOptions::default() || args.reading.no_mask_refinement {
            bail!("options of scenes say how photographs are read, and {} has points already", args.cloud.display());
        }
        let mut warnings = Vec::new();
        let cloud = read_mesh_with_warnings(&args.cloud, &mut warnings)?.mesh;
        print_notes(&warnings);
        return Ok(cloud);
    }
    if let Some(path) = &args.cloud_out {
        if path.extension().is_none_or(|ending| ending != "ply") {
            bail!("{}: points are written as .ply", path.display());
        }
        check_file(path, args.overwrite)?;
    }
    let reading = SceneReading::of_arguments(&args.reading);
    let divide = |scene: &mut Scene| Ok(scene.hold_out(HOLD_OUT_EVERY));
    let (scene, _, refined) = reading.read(&args.cloud, divide, cancellation)?;
    print_notes(&scene.warnings);
    print_notes(&refinement_notes(&refined));
    scene.require_masks()?;
    let train = ViewSplit::of(&scene)?.train;
    let mut progress = Progress::new();
    progress.phase("stereo", 1);
    let maps = method_by_name("grid", None)?.stereo_depths(&train, cancellation)?;
    let cloud = stereo_cloud(&maps, &train).transformed(&scene.object_to_world);
    progress.progress(1, "");
    if cloud.vertices.is_empty() {
        bail!(
            "{}: stereo finds no depths in these {} photographs; it compares neighbours that are up to 35 degrees apart and \
             show the same texture",
            args.cloud.display(),
            train.len()
        );
    }
    println!("stereo found {} points in {} photographs", cloud.vertices.len(), train.len());
    if let Some(path) = &args.cloud_out {
        write_mesh(path, &cloud)?;
        println!("wrote {}", path.display());
    }
    Ok(cloud)
}
