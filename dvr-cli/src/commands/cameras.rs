//! `dvr cameras`: cameras of photographs that have none; and the same on the way of `dvr train`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, bail};
use dvr_core::dataset::detect_format;
use dvr_core::{Cancellation, Error};
use dvr_sfm::{Event, FoundCameras, SfmOptions, Source, find_cameras};
use dvr_train::Observer;

use crate::args::{CamerasArgs, FindingArgs};
use crate::progress::Progress;

/// Finds and writes.
pub fn run(args: &CamerasArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let Some(source) = Source::at(&args.photographs)? else {
        bail!("{}: there are no pictures. Give a folder of PNG or JPEG files, or a clip", args.photographs.display());
    };
    let out = args.out.clone().unwrap_or_else(|| folder_beside(&args.photographs));
    let found = find(&source, &out, &args.finding, args.overwrite, cancellation)?;
    println!("{} of {} pictures have a camera", found.placed, found.placed + found.not_placed.len());
    println!("{} points, mean reprojection error {:.2} pixels", found.points, found.mean_error_px);
    if found.masks > 0 {
        println!("{} pictures have a mask", found.masks);
    }
    let seconds: f64 = found.seconds.iter().map(|(_, seconds)| seconds).sum();
    let parts: Vec<String> = found.seconds.iter().map(|(step, seconds)| format!("{step} {seconds:.0} s")).collect();
    println!("{}, {seconds:.0} s: {}", found.engine, parts.join(", "));
    println!("wrote {0}: images/, sparse/0/ (COLMAP), transforms.json (nerfstudio), sfm.json, sfm.log", out.display());
    Ok(ExitCode::SUCCESS)
}

/// The photographs without cameras at a path; `None` where there is a scene, or nothing.
pub fn photographs_without_cameras(path: &Path) -> Result<Option<Source>> {
    if Source::is_clip(path) {
        return Ok(Source::at(path)?);
    }
    match detect_format(path) {
        Err(Error::NoScene { .. }) => Ok(Source::at(path)?),
        // What is damaged or missing is named by those who read it.
        _ => Ok(None),
    }
}

/// Finds the cameras of photographs that are to be trained on; gives the scene that was made of them.
pub fn scene_of_photographs(
    source: &Source,
    path: &Path,
    folder: Option<&PathBuf>,
    finding: &FindingArgs,
    may_replace: bool,
    cancellation: &Cancellation,
) -> Result<PathBuf> {
    let out = folder.cloned().unwrap_or_else(|| folder_beside(path));
    eprintln!(
        "{}: {}; COLMAP finds its cameras, which are kept in {}",
        path.display(),
        source.describe(),
        out.display()
    );
    let found = find(source, &out, finding, may_replace, cancellation)?;
    let all = found.placed + found.not_placed.len();
    eprintln!("cameras: {} of {all} pictures, mean reprojection error {:.2} pixels", found.placed, found.mean_error_px);
    Ok(found.scene(&out))
}

/// Finds cameras, shows how far it is, and prints the notes of what was found earlier.
fn find(
    source: &Source,
    out: &Path,
    finding: &FindingArgs,
    may_replace: bool,
    cancellation: &Cancellation,
) -> Result<FoundCameras> {
    if let Some(tree) = &finding.vocab_tree {
        // A file that cannot be read is named before anything is begun.
        std::fs::metadata(tree).map_err(|source| Error::Io { path: tree.clone(), source })?;
    }
    let options = SfmOptions { cancellation: cancellation.clone(), may_replace, ..finding.options() };
    let mut progress = Progress::new();
    let mut began = false;
    let mut tell = |event| {
        began = true;
        show(&mut progress, event);
    };
    let found = find_cameras(source, out, &options, &mut tell)?;
    if !began {
        eprintln!("cameras of these photographs are in {}", out.display());
        super::print_notes(&found.notes);
    }
    Ok(found)
}

/// Shows what is told while cameras are found.
pub fn show(progress: &mut Progress, event: Event) {
    match event {
        Event::Step { name, parts } => progress.phase(name, parts),
        Event::Progress(done) => progress.progress(done, ""),
        Event::Note(note) => progress.note(&note),
    }
}

/// `photos-cameras` beside `photos`; of the current folder, beside that.
pub fn folder_beside(photographs: &Path) -> PathBuf {
    let mut name = OsString::from(name_of(photographs));
    name.push("-cameras");
    with_its_name(photographs).with_file_name(name)
}

/// The name of a folder, or of a clip without its ending.
pub fn name_of(photographs: &Path) -> String {
    let place = with_its_name(photographs);
    let name = if place.is_dir() { place.file_name() } else { place.file_stem() };
    name.unwrap_or(place.as_os_str()).to_string_lossy().into_owned()
}

/// The path as it is written, or as it is where that has no name: `.` and `..`.
pub fn with_its_name(photographs: &Path) -> PathBuf {
    match photographs.file_name() {
        Some(_) => photographs.to_owned(),
        None => photographs.canonicalize().unwrap_or_else(|_| photographs.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_lie_beside_their_photographs() {
        let folder = tempfile::tempdir().unwrap();
        let photos = folder.path().join("mug.v2");
        std::fs::create_dir(&photos).unwrap();
        assert_eq!(folder_beside(&photos), folder.path().join("mug.v2-cameras"));
        assert_eq!(folder_beside(&photos.join("")), folder.path().join("mug.v2-cameras"));
        assert_eq!(folder_beside(&folder.path().join("clip.mp4")), folder.path().join("clip-cameras"));
        let here = std::env::current_dir().unwrap();
        let expected = format!("{}-cameras", here.file_name().unwrap().to_string_lossy());
        assert_eq!(folder_beside(Path::new(".")).file_name().unwrap().to_string_lossy(), expected);
    }
}
