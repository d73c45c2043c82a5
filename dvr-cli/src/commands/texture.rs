//! `dvr texture`: a texture from photographs for anybody's mesh.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use dvr_core::files::check_file;
use dvr_core::mesh::{read_mesh_with_warnings, write_textured_mesh};
use dvr_core::metrics::Simplification;
use dvr_core::{Cancellation, HOLD_OUT_EVERY, Scene, View, ViewSplit};
use dvr_texture::{NormalMapReport, PARTS, TextureError, TextureReport, bake_normals, texture_mesh};
use dvr_train::{HostMemory, Observer, with_faces};

use super::real_size::refuse_metres;
use super::simplified::simplified_to;
use super::{SceneReading, print_notes, refinement_notes};
use crate::args::{TextureArgs, texture_settings};
use crate::memory::make_room_for_texture;
use crate::progress::Progress;

/// Reads, colours and writes.
pub fn run(args: &TextureArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    for path in outputs(&args.out)? {
        check_file(&path, args.overwrite)?;
    }
    refuse_metres(&args.mesh)?;
    let mut warnings = Vec::new();
    let found = read_mesh_with_warnings(&args.mesh, &mut warnings)?;
    print_notes(&warnings);
    if found.mesh.is_empty() {
        return Err(TextureError::NoFaces).with_context(|| args.mesh.display().to_string());
    }
    let reading = SceneReading::of_arguments(&args.reading);
    let divide = |scene: &mut Scene| Ok(scene.hold_out(HOLD_OUT_EVERY));
    let (mut scene, parts, refined) = reading.read(&args.data, divide, cancellation)?;
    print_notes(&scene.warnings);
    print_notes(&refinement_notes(&refined));
    let mut settings = texture_settings(args.size, args.preset);
    let needed = HostMemory::of_texture(&scene, &views_of(args, &scene)?, found.mesh.faces.len(), &settings);
    settings.max_bytes = make_room_for_texture(&mut scene, needed, args.reading.memory)?;
    let views = views_of(args, &scene)?;
    if !args.all_views && views.len() < scene.views.len() {
        eprintln!("views as a run with the default settings divides them: {parts}");
    }
    let mut mesh = found.mesh.transformed(&scene.object_to_world.inverse());
    // What it is simplified from, and how far that moves the surface.
    let mut full = None;
    let mut notes = Vec::new();
    let simple = with_faces(&mesh, args.preset.max_faces(args.faces), args.remesh, &mut notes);
    print_notes(&notes);
    if let Some(simple) = simple {
        let moved = Simplification::between(&mesh, &simple);
        let simplification = moved.scaled(scene.object_to_world.scale);
        println!("{}", simplified_to(simple.faces.len(), &simplification, args.remesh));
        full = Some((std::mem::replace(&mut mesh, simple), moved.max_distance));
    }
    let mut progress = Progress::new();
    progress.phase("texture", PARTS);
    let done = |done: usize, part: &str| progress.progress(done, part);
    let mut textured = texture_mesh(&mesh, &views, &settings, cancellation, done)?;
    drop(progress);
    let has_map = args.finish.has_normal_map() && takes_normal_map(&args.out);
    if let Some((full, moved)) = full.filter(|_| has_map) {
        bake_normals(&mut textured, &full, moved, cancellation)?;
    }
    let in_world = textured.mesh.transformed(&scene.object_to_world);
    write_textured_mesh(&args.out, &in_world, args.finish.style())?;
    println!("{}", sentence(&textured.report));
    for path in outputs(&args.out)? {
        println!("wrote {}", path.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// The views that give the colours.
fn views_of<'a>(args: &TextureArgs, scene: &'a Scene) -> Result<Vec<&'a View>> {
    Ok(if args.all_views { scene.views.iter().collect() } else { ViewSplit::of(scene)?.train })
}

/// What a texture is, in a line.
pub fn sentence(report: &TextureReport) -> String {
    let TextureReport { size, charts, cover, seen, cell, normal_map } = report;
    let [cover, seen] = [cover, seen].map(|share| 100.0 * share);
    let normals = normal_map.map_or_else(String::new, |NormalMapReport { size, met }| {
        format!("; normal map: {size}x{size} texels, the full mesh met along the normals at {:.1} %", 100.0 * met)
    });
    let cells = match cell {
        1 => String::new(),
        cell => format!(
            "; one pixel in {cell}x{cell} of the photographs gave it a colour: a larger texture takes more of them where there is memory"
        ),
    };
    format!(
        "texture: {size}x{size} texels, {charts} charts on {cover:.0} % of them; photographs show {seen:.1} %{cells}{normals}"
    )
}

/// Whether a file's format has normal maps.
pub fn takes_normal_map(path: &Path) -> bool {
    path.extension().is_some_and(|extension| ["glb", "usdz"].iter().any(|known| extension.eq_ignore_ascii_case(known)))
}

/// The files that are written.
fn outputs(out: &Path) -> Result<Vec<PathBuf>> {
    match out.extension().unwrap_or_default().to_string_lossy().to_lowercase().as_str() {
        "glb" | "usdz" => Ok(vec![out.to_owned()]),
        "obj" => Ok(vec![out.with_extension("png"), out.with_extension("mtl"), out.to_owned()]),
        _ => bail!("{}: a mesh with a texture is written as .glb, .usdz or .obj", out.display()),
    }
}
