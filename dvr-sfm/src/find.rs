//! From photographs to a folder with cameras.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use dvr_core::Cancellation;
use dvr_core::dataset::{ColmapModel, list_pictures, read_colmap_model, write_transforms};
use dvr_core::files::{check_beside_data, read_bytes, write_bytes_atomically};
use dvr_core::mesh::{Mesh, write_mesh};
use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::clip::take_frames;
use crate::engine::Engine;
use crate::error::{Result, SfmError, some};
use crate::masks::undistort_masks;
use crate::options::{Event, Mapper, SfmOptions};
use crate::pictures::{Preparation, digest, make_folder_of};
use crate::result::FoundCameras;
use crate::source::Source;
use crate::steps::{MASKS, PICTURES, REFINED, Steps, TEXT_MODEL, UNDISTORTED, models};
use crate::workspace::{Workspace, refused};

/// Fewer pictures have no structure that their motion could show.
const LEAST: usize = 3;

/// Frames of a clip, in the folder of what is half-finished.
const FRAMES: &str = "frames";

/// Version of what is made: another one begins anew.
const VERSION: u32 = 1;

/// Finds the cameras of photographs and writes them, with undistorted pictures, to the folder `out`; what is finished
/// there for the same photographs and options is taken as it is.
///
/// `tell` is told what happens.
///
/// # Errors
/// [`SfmError`]: too few pictures, COLMAP missing or failing, nothing that fits together, a folder that is not ours.
/// [`SfmError::Cancelled`] where the options' token wants the work to end; what is finished by then is kept.
pub fn find_cameras(
    source: &Source,
    out: &Path,
    options: &SfmOptions,
    tell: &mut dyn FnMut(Event),
) -> Result<FoundCameras> {
    let digest = match source {
        Source::Pictures { root, folder, pictures } => {
            check_beside_data(out, root)?;
            if pictures.len() < LEAST {
                return Err(SfmError::TooFewPictures { path: root.clone(), found: pictures.len(), least: LEAST });
            }
            digest(root, folder, pictures, &options.cancellation)?
        }
        Source::Clip(clip) => digest_of_clip(clip, &options.cancellation)?,
    };
    let key = key_of(&digest, options);
    if let Some(found) = FoundCameras::read(out).filter(|found| found.key == key) {
        return Ok(found);
    }
    let engine = Engine::find(options.program.as_deref(), "finds the cameras of photographs", &options.cancellation)?;
    if options.mapper == Mapper::Global {
        // What is missing is told before anything is begun.
        engine.global_mapper()?;
    }
    let mut workspace = Workspace::open(out, &key, options.may_replace)?;
    if let Err(error) = prepare(source, &mut workspace, options, tell) {
        if workspace.is_new() {
            workspace.discard()?;
        }
        return Err(error);
    }
    let mut steps =
        Steps { engine: &engine, options, is_clip: matches!(source, Source::Clip(_)), feature_masks: None, tell };
    workspace.step("features", |workspace| steps.features(workspace))?;
    workspace.step("matching", |workspace| steps.matches(workspace))?;
    workspace.step("static background", |workspace| steps.leave_out_static_background(workspace))?;
    workspace.step("mapping", |workspace| steps.mapping(workspace))?;
    let models = models(&workspace)?;
    let Some((largest, _)) = models.first() else {
        return Err(SfmError::NoModel { pictures: workspace.pictures().len(), log: workspace.log.path.clone() });
    };
    workspace.step("refinement", |workspace| steps.refinement(workspace, largest))?;
    let model = workspace.work(REFINED);
    let distorted = read_colmap_model(&model)?;
    workspace.step("undistortion", |workspace| steps.undistortion(workspace, &model))?;
    let model_sizes: Vec<usize> = models.iter().map(|(_, model)| model.pictures.len()).collect();
    publish(workspace, &engine, &distorted, model_sizes, &key, options, tell)
}

/// Pictures as COLMAP gets them, after the frames that they are made of.
fn prepare(
    source: &Source,
    workspace: &mut Workspace,
    options: &SfmOptions,
    tell: &mut dyn FnMut(Event),
) -> Result<()> {
    if let Source::Clip(clip) = source {
        workspace.step("frames", |workspace| take(clip, workspace, options, tell))?;
    }
    workspace.step("pictures", |workspace| {
        tell(Event::Step { name: "looking at the pictures", parts: 1 });
        let (root, folder, originals) = match source {
            Source::Pictures { root, folder, pictures } => (root.clone(), folder.clone(), pictures.clone()),
            Source::Clip(_) => {
                let folder = workspace.work(FRAMES);
                let frames = list_pictures(&folder)?;
                (
                    folder.clone(),
                    folder,
                    frames.iter().filter_map(|frame| frame.file_name()).map(PathBuf::from).collect(),
                )
            }
        };
        let preparation = Preparation {
            folder: &folder,
            root: &root,
            originals: &originals,
            pictures: workspace.empty(PICTURES)?,
            masks: workspace.empty(MASKS)?,
            sharing: options.sharing,
        };
        let (prepared, notes) = preparation.run(&options.cancellation)?;
        workspace.set_pictures(prepared);
        for note in notes {
            tell(Event::Note(note.clone()));
            workspace.note(note);
        }
        let found = workspace.pictures().len();
        if found < LEAST {
            return Err(SfmError::TooFewPictures { path: source.path().to_owned(), found, least: LEAST });
        }
        tell(Event::Progress(1));
        Ok(())
    })?;
    Ok(())
}

/// Frames of a clip.
fn take(clip: &Path, workspace: &mut Workspace, options: &SfmOptions, tell: &mut dyn FnMut(Event)) -> Result<()> {
    let folder = workspace.empty(FRAMES)?;
    tell(Event::Step { name: "frames", parts: options.frames });
    let mut shown = 0;
    let mut progress = |done: usize| {
        if std::mem::replace(&mut shown, done) != done {
            tell(Event::Progress(done));
        }
    };
    let note = take_frames(clip, options.frames, &folder, &mut workspace.log, &options.cancellation, &mut progress)?;
    if let Some(note) = note {
        tell(Event::Note(note.clone()));
        workspace.note(note);
    }
    Ok(())
}

/// The SHA-256 of a clip, in hexadecimal.
fn digest_of_clip(clip: &Path, cancellation: &Cancellation) -> Result<String> {
    let refused = |source| refused(clip, source);
    let mut file = File::open(clip).map_err(refused)?;
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        cancellation.check()?;
        match file.read(&mut buffer).map_err(refused)? {
            0 => break,
            count => hash.update(&buffer[..count]),
        }
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Moves what was found to its place, the description of it last.
fn publish(
    mut workspace: Workspace,
    engine: &Engine,
    distorted: &ColmapModel,
    model_sizes: Vec<usize>,
    key: &str,
    options: &SfmOptions,
    tell: &mut dyn FnMut(Event),
) -> Result<FoundCameras> {
    let undistorted = read_colmap_model(&workspace.work(TEXT_MODEL))?;
    let names: Vec<&str> = undistorted.pictures.iter().map(|picture| picture.name.as_str()).collect();
    let masks = workspace.pictures().iter().filter_map(|picture| picture.mask.as_ref());
    let masks = masks.map(|mask| format!("masks/{mask}"));
    let files: Vec<String> = names.iter().map(|name| format!("images/{name}")).chain(masks).collect();
    workspace.announce(&files)?;
    for name in &names {
        workspace.move_out(&format!("{UNDISTORTED}/images/{name}"), &format!("images/{name}"))?;
    }
    let (from, to) = (workspace.work(MASKS), workspace.at("masks"));
    let masks = undistort_masks(workspace.pictures(), distorted, &undistorted, &from, &to, &options.cancellation)?;
    for file in ["cameras.txt", "images.txt", "points3D.txt"] {
        let target = workspace.at("sparse/0").join(file);
        make_folder_of(&target)?;
        write_bytes_atomically(&target, &read_bytes(&workspace.work(TEXT_MODEL).join(file))?)?;
    }
    let points = &undistorted.points;
    let cloud = Mesh { vertices: points.points.clone(), colors: points.colors.clone(), ..Mesh::default() };
    write_mesh(workspace.at("points.ply"), &cloud)?;
    let paths: Vec<String> = names.iter().map(|name| format!("images/{name}")).collect();
    let cameras = paths.iter().map(String::as_str).zip(undistorted.pictures.iter().map(|picture| &picture.camera));
    write_transforms(&workspace.at("transforms.json"), cameras, Some("points.ply"))?;

    let not_placed: Vec<String> = workspace.pictures().iter().map(|picture| picture.name.clone()).collect();
    let not_placed: Vec<String> = not_placed.into_iter().filter(|name| !names.contains(&name.as_str())).collect();
    for note in notes_on(names.len(), &not_placed, &model_sizes) {
        tell(Event::Note(note.clone()));
        workspace.note(note);
    }
    let errors = undistorted.errors_px.iter().filter(|error| **error >= 0.0);
    let found = FoundCameras {
        key: key.to_owned(),
        engine: engine.version.clone(),
        placed: names.len(),
        not_placed,
        model_sizes,
        points: points.points.len(),
        mean_error_px: errors.clone().sum::<f64>() / errors.count().max(1) as f64,
        masks: masks.len(),
        sets: Vec::new(),
        seconds: workspace.seconds().to_vec(),
        notes: workspace.notes().to_vec(),
    };
    workspace.finish(&found)?;
    Ok(found)
}

/// What the user should know of a model.
fn notes_on(placed: usize, not_placed: &[String], model_sizes: &[usize]) -> Vec<String> {
    let mut notes = Vec::new();
    if !not_placed.is_empty() {
        let all = placed + not_placed.len();
        let names = some(not_placed);
        notes.push(format!("{} of {all} pictures could not be placed and are left out: {names}", not_placed.len()));
    }
    if let [largest, others @ ..] = model_sizes
        && !others.is_empty()
    {
        let sizes = others.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        notes.push(format!(
            "COLMAP made {} models that are not connected; the largest, of {largest} pictures, is taken (the others have \
             {sizes})",
            model_sizes.len()
        ));
    }
    notes
}

/// What cameras are found from, as a digest.
fn key_of(photographs: &str, options: &SfmOptions) -> String {
    #[derive(Serialize)]
    struct Key<'a> {
        version: u32,
        photographs: &'a str,
        options: &'a SfmOptions,
    }
    let json = serde_json::to_vec(&Key { version: VERSION, photographs, options }).unwrap_or_default();
    Sha256::digest(json).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_changes_the_cameras_changes_the_key() {
        let options = SfmOptions::default();
        let key = key_of("a", &options);
        assert_eq!(key, key_of("a", &SfmOptions { threads: Some(2), may_replace: true, ..options.clone() }));
        assert_ne!(key, key_of("b", &options));
        assert_ne!(key, key_of("a", &SfmOptions { camera_model: "OPENCV".to_owned(), ..options }));
    }

    #[test]
    fn what_was_not_placed_is_named() {
        let notes = notes_on(40, &["x.jpg".to_owned(), "y.jpg".to_owned()], &[40, 5, 3]);
        assert!(notes[0].contains("2 of 42 pictures") && notes[0].ends_with("x.jpg, y.jpg"), "{notes:?}");
        assert!(notes[1].contains("3 models") && notes[1].contains("5, 3"), "{notes:?}");
        assert!(notes_on(3, &[], &[3]).is_empty());
    }
}
