//! Reading a run back: its checkpoint, its model, its scene.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use burn::tensor::Device;
use dvr_core::dataset::Normalise;
use dvr_core::files::{OutputFolder, check_file};
use dvr_core::{Cancellation, Exposure, Scene};
use dvr_train::{Checkpoint, RefinedCameras, RunFolder, RunPictures, TrainedModel, load_object};

use super::print_notes;
use super::scene_reading::SceneReading;

/// The checkpoint at a path: a run's folder or a checkpoint's file.
pub fn load_run(path: &Path) -> Result<Checkpoint> {
    let checkpoint = if path.is_dir() { RunFolder::new(path).load() } else { Checkpoint::load(path) };
    let mut checkpoint = checkpoint?;
    find_masks_again(&mut checkpoint, if path.is_dir() { Some(path) } else { path.parent() });
    Ok(checkpoint)
}

/// Whether a path is that of a mesh, where it may be a run, a checkpoint or a stored field as well.
pub fn is_mesh(path: &Path) -> bool {
    path.is_file() && path.extension().is_none_or(|extension| extension != "ckpt" && extension != "dvr")
}

/// Masks that were found for a run lie in its folder, also where that was moved.
pub fn find_masks_again(checkpoint: &mut Checkpoint, folder: Option<&Path>) {
    let Some(masks) = folder.map(|folder| RunFolder::new(folder).masks()).filter(|masks| masks.is_dir()) else {
        return;
    };
    // Where the scene had its own masks, or others were named, these stand.
    if let Some(stored) = checkpoint.header.reading.get_mut("masks").filter(|stored| !stored.is_null())
        && !stored.as_str().is_some_and(|path| Path::new(path).is_dir())
    {
        *stored = masks.to_string_lossy().into_owned().into();
    }
}

/// Where results of a run go: to `out`, or to the run's own `files`, and then the folder is ours as long as it is held.
/// What would be refused in the end is refused before the work begins.
pub fn place_for(
    run: &RunFolder,
    out: Option<&PathBuf>,
    files: Vec<PathBuf>,
    overwrite: bool,
) -> Result<(Vec<PathBuf>, Option<OutputFolder>)> {
    if out.is_none() && run.is_run() {
        return Ok((files, Some(run.resume()?)));
    }
    let files = out.map_or(files, |out| vec![out.clone()]);
    files.iter().try_for_each(|file| check_file(file, overwrite))?;
    Ok((files, None))
}

/// The field of a run: of its scene, or of one of the objects that it has learned codes for.
pub fn load_model(checkpoint: &Checkpoint, object: Option<usize>, device: &Device) -> Result<Box<dyn TrainedModel>> {
    Ok(match object {
        Some(object) => load_object(checkpoint, object, device)?,
        None => dvr_train::load_model(checkpoint, device)?,
    })
}

/// What pictures of a run show where that is not its field alone. It belongs to the results that stand for the run: a
/// checkpoint that is named by itself may hold another field.
pub fn pictures_of(run: &Path) -> Result<Option<RunPictures>> {
    if !run.is_dir() {
        return Ok(None);
    }
    let mut warnings = Vec::new();
    let found = RunPictures::load(&RunFolder::new(run), &mut warnings)?;
    print_notes(&warnings);
    Ok(found)
}

/// The scene of a run, read as for training, in the same object space, and with the same views for the same purpose. The
/// scene's warnings say which views are gone or new since the run began. From `moved` if it was moved, and within
/// `memory` where that is given.
pub fn scene_of_run(
    checkpoint: &Checkpoint,
    moved: Option<&PathBuf>,
    memory: Option<u64>,
    cancellation: &Cancellation,
) -> Result<Scene> {
    let header = &checkpoint.header;
    let mut reading: SceneReading =
        serde_json::from_value(header.reading.clone()).context("the checkpoint does not say how its scene was read")?;
    let options = &mut reading.options;
    options.max_memory = memory.or(options.max_memory);
    let is_unknown = header.scene.as_os_str().is_empty();
    // An imported network has the object space of the files, as in DVR's reference code.
    options.normalise = if is_unknown { Normalise::Files } else { Normalise::Given(header.object_to_world) };
    options.known_views = header.views.clone();
    options.hold_out_every = header.common.hold_out_every;
    let path = match moved {
        Some(path) => path,
        None if is_unknown => bail!("the run was imported without its scene: give its folder with --data"),
        None => &header.scene,
    };
    let divide = |scene: &mut Scene| match &header.views {
        Some(views) => views.apply(scene),
        None => {
            scene.hold_out(header.common.hold_out_every);
            Ok(())
        }
    };
    let (mut scene, ..) =
        reading.read(path, divide, cancellation).with_context(|| format!("the run's scene, {}", path.display()))?;
    RefinedCameras::apply(&header.cameras, &mut scene);
    Exposure::apply(&header.exposures, &mut scene);
    Ok(scene)
}
