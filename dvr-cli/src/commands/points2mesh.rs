//! `dvr points2mesh`: a surface of a cloud of points.

use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use dvr_core::Cancellation;
use dvr_core::files::check_file;
use dvr_core::mesh::{read_mesh_with_warnings, write_mesh};
use dvr_core::metrics::Simplification;
use dvr_sfm::{PoissonOptions, poisson_surface};
use dvr_train::over_budget;

use super::print_notes;
use super::simplified::simplified_to;
use crate::args::{FaceBudget, Points2MeshArgs};

/// Reads, makes the surface and writes it.
pub fn run(args: &Points2MeshArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    match args.out.extension().unwrap_or_default().to_string_lossy().to_lowercase().as_str() {
        "ply" | "glb" | "obj" => check_file(&args.out, args.overwrite)?,
        _ => bail!("{}: a surface is written as .ply, .glb or .obj", args.out.display()),
    }
    let mut warnings = Vec::new();
    let cloud = read_mesh_with_warnings(&args.cloud, &mut warnings)?.mesh;
    print_notes(&warnings);
    let options = PoissonOptions { cancellation: cancellation.clone(), ..args.options() };
    let mut surface = poisson_surface(&cloud, &options).with_context(|| args.cloud.display().to_string())?;
    println!("{} points became {} faces", cloud.vertices.len(), surface.faces.len());
    let most = args.faces.and_then(FaceBudget::limit);
    if let Some(most) = most.filter(|&most| surface.faces.len() > most) {
        let simple = surface.within_faces(most);
        print_notes(over_budget(&simple, most).as_slice());
        println!("{}", simplified_to(simple.faces.len(), &Simplification::between(&surface, &simple)));
        surface = simple;
    }
    write_mesh(&args.out, &surface)?;
    println!("wrote {}", args.out.display());
    Ok(ExitCode::SUCCESS)
}
