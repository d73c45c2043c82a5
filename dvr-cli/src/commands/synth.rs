//! `dvr synth`: renders meshes into a ShapeNet-style dataset.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use dvr_core::Cancellation;
use dvr_core::files::{Claim, FolderKind, OutputFolder};
use dvr_core::number_range::check_numbers;
use dvr_core::synth::{CorpusObject, SplitRatios, SynthConfig, render_corpus};
use dvr_train::{Observer, check_host_memory};

use super::print_notes;
use crate::args::SynthArgs;
use crate::progress::Progress;

/// File extensions of meshes.
const MESH_ENDINGS: [&str; 5] = ["obj", "ply", "off", "glb", "gltf"];

/// Renders and writes.
pub fn run(args: &SynthArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let config = configuration(args)?;
    if args.print_config {
        println!("{}", serde_json::to_string_pretty(&config)?);
        return Ok(ExitCode::SUCCESS);
    }
    let Some(out) = &args.out else { bail!("no folder for the dataset was given: add --out DIR") };
    check_host_memory(config.memory_estimate(), None)?;
    let objects = collect(&args.meshes, args.category.as_deref())?;
    let _writing = OutputFolder::claim(out, FolderKind::Dataset, Claim::NewOrContinue, &["metadata.yaml"])?;
    let mut progress = Progress::new();
    progress.phase("rendering objects", objects.len());
    let show = &mut |done: usize, _: usize| progress.progress(done, "");
    let report = render_corpus(&objects, out, &config, SplitRatios::default(), cancellation, show)?;
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
            let text = dvr_core::files::read_text(path)?;
            let read = || -> Result<SynthConfig> {
                let value = serde_json::from_str(&text)?;
                check_numbers(&value, SynthConfig::RANGES)?;
                Ok(serde_json::from_value(value)?)
            };
            read().with_context(|| path.display().to_string())?
        }
    };
    config.views = args.views as usize;
    (config.width, config.height) = args.size;
    config.seed = args.seed;
    config.check()?;
    Ok(config)
}

/// The objects of files and folders, in a fixed order.
fn collect(paths: &[PathBuf], category: Option<&str>) -> Result<Vec<CorpusObject>> {
    let mut objects = Vec::new();
    for path in paths {
        if path.is_dir() {
            let before = objects.len();
            walk(path, &mut objects, &mut HashSet::new())?;
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

/// Meshes below a folder; the folder that a mesh lies in is its category. A folder that is there by several links, or
/// holds a link to itself, is walked once.
fn walk(folder: &Path, objects: &mut Vec<CorpusObject>, walked: &mut HashSet<PathBuf>) -> Result<()> {
    let place = std::fs::canonicalize(folder).with_context(|| folder.display().to_string())?;
    if !walked.insert(place) {
        return Ok(());
    }
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    paths.sort();
    for path in paths {
        if path.is_dir() {
            walk(&path, objects, walked)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn links_in_circles_are_walked_once() {
        use std::os::unix::fs::symlink;
        let root = tempfile::tempdir().unwrap();
        let chairs = root.path().join("chairs");
        std::fs::create_dir(&chairs).unwrap();
        std::fs::write(chairs.join("a.obj"), "").unwrap();
        symlink(root.path(), chairs.join("up")).unwrap();
        symlink(&chairs, root.path().join("zz")).unwrap();
        let objects = collect(&[root.path().to_owned()], None).unwrap();
        assert_eq!(objects.len(), 1, "{objects:?}");
        assert_eq!((objects[0].name.as_str(), objects[0].category.as_str()), ("a", "chairs"));
    }
}
