//! `dvr synth`: renders meshes into a ShapeNet-style dataset.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use dvr_core::synth::{CorpusObject, SplitRatios, SynthConfig, render_corpus};
use dvr_train::Observer;

use super::print_notes;
use crate::args::SynthArgs;
use crate::progress::Progress;

/// File extensions of meshes.
const MESH_ENDINGS: [&str; 5] = ["obj", "ply", "off", "glb", "gltf"];

/// Renders and writes.
pub fn run(args: &SynthArgs) -> Result<ExitCode> {
    let config = configuration(args)?;
    if args.print_config {
        println!("{}", serde_json::to_string_pretty(&config)?);
        return Ok(ExitCode::SUCCESS);
    }
    let Some(out) = &args.out else { bail!("no folder for the dataset was given: add --out DIR") };
    let objects = collect(&args.meshes, args.category.as_deref())?;
    let mut progress = Progress::new();
    progress.phase("rendering objects", objects.len());
    let report =
        render_corpus(&objects, out, &config, SplitRatios::default(), &mut |done, _| progress.progress(done, ""))?;
    for (object, warning) in &report.warnings {
        print_notes(&[format!("{object}: {warning}")]);
    }
    for (object, problem) in &report.skipped {
        print_notes(&[format!("{object} was skipped: {problem}")]);
    }
    println!(
        "rendered {} object(s) with {} views each to {}; {} were there already, {} skipped",
        report.rendered.len(),
        config.views,
        out.display(),
        report.kept.len(),
        report.skipped.len()
    );
    if report.rendered.is_empty() && report.kept.is_empty() {
        bail!("no object could be rendered");
    }
    Ok(ExitCode::SUCCESS)
}

/// The settings that the arguments ask for.
fn configuration(args: &SynthArgs) -> Result<SynthConfig> {
    let mut config = match &args.config {
        None => SynthConfig::default(),
        Some(path) => {
            let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
            serde_json::from_str(&text).with_context(|| path.display().to_string())?
        }
    };
    config.views = args.views as usize;
    (config.width, config.height) = args.size;
    config.seed = args.seed;
    Ok(config)
}

/// The objects of files and folders, in a fixed order.
fn collect(paths: &[PathBuf], category: Option<&str>) -> Result<Vec<CorpusObject>> {
    let mut objects = Vec::new();
    for path in paths {
        if path.is_dir() {
            let before = objects.len();
            walk(path, &mut objects)?;
            if objects.len() == before {
                bail!("{}: no mesh was found; looked for {}", path.display(), MESH_ENDINGS.join(", "));
            }
        } else if path.exists() {
            let name = category.map_or_else(|| folder_name(path), str::to_owned);
            objects.push(object(path, name));
        } else {
            bail!("{}: there is no such file or folder", path.display());
        }
    }
    Ok(objects)
}

/// Meshes below a folder; the folder that a mesh lies in is its category.
fn walk(folder: &Path, objects: &mut Vec<CorpusObject>) -> Result<()> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    paths.sort();
    for path in paths {
        if path.is_dir() {
            walk(&path, objects)?;
        } else if is_mesh(&path) {
            objects.push(object(&path, folder_name(&path)));
        }
    }
    Ok(())
}

fn is_mesh(path: &Path) -> bool {
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
    MESH_ENDINGS.contains(&ending.as_str())
}

fn object(path: &Path, category: String) -> CorpusObject {
    let name = path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    CorpusObject { name, category, mesh: path.to_owned() }
}

/// The name of the folder a file lies in.
fn folder_name(path: &Path) -> String {
    let folder = path.canonicalize().ok().and_then(|p| p.parent().map(Path::to_owned));
    folder.and_then(|f| Some(f.file_name()?.to_string_lossy().into_owned())).unwrap_or_else(|| "objects".to_owned())
}
