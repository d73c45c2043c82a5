//! `dvr predict`: meshes from single pictures.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, anyhow, bail};
use dvr_core::dataset::{Background, InputPicture, input_picture, list_pictures, mask_from_background, square_around};
use dvr_core::files::{Claim, FolderKind, OutputFolder, Photo, read_mask, read_photo, write_rgb_png};
use dvr_core::mesh::write_mesh;
use dvr_core::record::{Digest, RecordKey};
use dvr_core::{Cancellation, Mask};
use dvr_train::{Checkpoint, MeshOptions, ObjectModel, Observer, predict};
use image::RgbImage;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::kept_row::{Kept, keep, kept};
use super::provenance::record_key;
use super::{OBJECT_RESOLUTION, load_run, surface_options};
use crate::args::{PredictArgs, SymmetryArg};
use crate::memory;
use crate::progress::Progress;

/// Margin around the object with --crop, as a share of its larger side.
const MARGIN: f64 = 0.1;

/// One picture and its results.
struct Task {
    picture: PathBuf,
    /// Files without their endings, unique.
    target: PathBuf,
}

/// What is written down beside the results of a picture, with their key.
#[derive(Serialize, Deserialize)]
struct Prediction {
    picture: PathBuf,
    warnings: Vec<String>,
}

impl Task {
    /// Mesh, mesh, preview, and what they were made of.
    fn files(&self) -> [PathBuf; 4] {
        ["glb", "ply", "png", "json"].map(|ending| PathBuf::from(format!("{}.{ending}", self.target.display())))
    }

    /// Whether an earlier call has done it, of the same key.
    fn is_done(&self, key: &RecordKey) -> Result<bool> {
        let [.., record] = self.files();
        let is_same = matches!(kept::<Prediction>(&record, key)?, Kept::Row(_));
        Ok(is_same && self.files().iter().all(|file| file.is_file()))
    }
}

/// A model and how it is asked.
struct Job<'a> {
    args: &'a PredictArgs,
    model: ObjectModel,
    /// Side of the encoder's pictures, pixels.
    size: usize,
    masks: Option<HashMap<String, PathBuf>>,
    options: MeshOptions,
    /// Everything that the results depend on but the picture.
    settings: Value,
}

/// Predicts every picture; pictures that cannot be used are named and left out.
pub fn run(args: &PredictArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    OutputFolder::check::<&str>(&args.out, FolderKind::Predictions, Claim::NewOrContinue, &[])?;
    let checkpoint = load_run(&args.run)?;
    let device = args.backend.backend.device()?;
    memory::limit(&device, args.memory.memory);
    let options = surface_options(&args.surface, OBJECT_RESOLUTION, cancellation);
    memory::check_extraction(&options.extraction, &device, args.memory.memory)?;
    let mut model = ObjectModel::load(&checkpoint, &device)?;
    if let Some(threshold) = args.threshold {
        model = model.with_threshold(threshold)?;
    }
    if let Some(symmetry) = args.symmetry {
        model = model.with_symmetry(symmetry.is_on())?;
    }
    let tasks = tasks(args)?;
    let job = Job {
        args,
        size: model.picture_size()?,
        model,
        masks: args.masks.as_deref().map(masks_by_stem).transpose()?,
        options: surface_options(&args.surface, OBJECT_RESOLUTION, cancellation),
        settings: settings(args, &checkpoint),
    };
    let names = tasks.iter().flat_map(Task::files);
    let names = names.filter_map(|file| Some(file.strip_prefix(&args.out).ok()?.to_str()?.to_owned()));
    let names: Vec<String> = names.collect();
    let _writing = OutputFolder::claim(&args.out, FolderKind::Predictions, Claim::NewOrContinue, &names)?;

    let mut progress = Progress::new();
    progress.phase("predicting", tasks.len());
    let (mut made, mut kept, mut failed) = (0, 0, 0);
    for (i, task) in tasks.iter().enumerate() {
        cancellation.check()?;
        match job.carry_out(task, &mut progress) {
            Ok(true) => made += 1,
            Ok(false) => kept += 1,
            Err(error) => {
                cancellation.check()?;
                failed += 1;
                let error = format!("{error:#}");
                let path = task.picture.display().to_string();
                // Errors of files name them already.
                let about = if error.contains(&path) { error } else { format!("{path}: {error}") };
                progress.note(&format!("left out: {about}"));
            }
        }
        progress.progress(i + 1, &task.picture.display().to_string());
    }
    let kept_note =
        if kept > 0 { format!(", {kept} were there (--overwrite makes them again)") } else { String::new() };
    println!(
        "{made} of {} pictures became meshes in {}{kept_note}, {failed} left out",
        tasks.len(),
        args.out.display()
    );
    if made + kept == 0 {
        bail!("no picture could be used");
    }
    Ok(ExitCode::SUCCESS)
}

/// Everything that results depend on but the picture.
fn settings(args: &PredictArgs, checkpoint: &Checkpoint) -> Value {
    let surface = surface_options(&args.surface, OBJECT_RESOLUTION, &Cancellation::default());
    json!({
        "model": Digest::of_bytes(&checkpoint.state.model),
        "method": checkpoint.header.method,
        "background": args.background.map(|color| format!("{color:?}")),
        "background_threshold": args.background_threshold,
        "crop": args.crop,
        "threshold": args.threshold,
        "symmetry": args.symmetry.map(SymmetryArg::name),
        "surface": format!("{surface:?}"),
    })
}

impl Job<'_> {
    /// Makes the files of a picture, unless they are there; returns whether it did.
    fn carry_out(&self, task: &Task, observer: &mut dyn Observer) -> Result<bool> {
        let key = self.key(task)?;
        if !self.args.overwrite && task.is_done(&key)? {
            return Ok(false);
        }
        let input = input(&task.picture, self.args, self.size, self.masks.as_ref())?;
        let input = InputPicture { image: input, camera: None, mask: None };
        let prediction = predict(&self.model, &input, &self.options)?;
        for warning in &prediction.warnings {
            observer.note(&format!("{}: {warning}", task.picture.display()));
        }
        let [glb, ply, png, record] = task.files();
        // Last, since it says that all of them are there: until then, no record says so.
        if record.exists() {
            std::fs::remove_file(&record).with_context(|| record.display().to_string())?;
        }
        write_mesh(glb, &prediction.shape.drawn())?;
        prediction.shape.write(&ply)?;
        write_rgb_png(&png, &prediction.preview)?;
        keep(&record, &key, Prediction { picture: task.picture.clone(), warnings: prediction.warnings })?;
        Ok(true)
    }

    /// What the files of a picture are made of: its bytes, those of its mask, and the settings.
    fn key(&self, task: &Task) -> Result<RecordKey> {
        let mut digests = vec![Digest::of_file(&task.picture)?];
        if let Some(mask) = self.masks.as_ref().and_then(|masks| masks.get(&stem(&task.picture))) {
            digests.push(Digest::of_file(mask)?);
        }
        record_key(Digest::of_all(&digests), &self.settings, &self.args.backend.backend.described())
    }
}

/// The encoder's input for a file.
fn input(path: &Path, args: &PredictArgs, size: usize, masks: Option<&HashMap<String, PathBuf>>) -> Result<RgbImage> {
    let photo = read_photo(path)?;
    let mask: Option<Mask> = match (masks, args.background) {
        (Some(masks), _) => {
            let file =
                masks.get(&stem(path)).ok_or_else(|| anyhow!("there is no mask of the name {:?}", stem(path)))?;
            let mask = read_mask(file)?;
            if mask.size() != photo.image.dimensions() {
                bail!("its mask is of another size, {}x{}", mask.size().0, mask.size().1);
            }
            Some(mask)
        }
        (None, Some(color)) => {
            let background = Background { color, threshold: args.background_threshold };
            Some(mask_from_background(&photo.image, background))
        }
        (None, None) => photo.alpha.clone(),
    };
    // A mask that was asked for goes before an alpha channel.
    let photo = Photo { alpha: mask, ..photo };
    if !args.crop {
        return Ok(input_picture(&photo, None, size as u32));
    }
    let Some(mask) = &photo.alpha else {
        bail!("--crop needs to know where the object is: give an alpha channel, --masks or --background");
    };
    let square = square_around(&photo, mask, MARGIN).ok_or_else(|| anyhow!("nothing in it belongs to the object"))?;
    Ok(input_picture(&square, None, size as u32))
}

/// The pictures that were named, and those in the folders that were named, each with a name of its own for the results.
fn tasks(args: &PredictArgs) -> Result<Vec<Task>> {
    let mut pictures = Vec::new();
    for path in &args.images {
        if path.is_dir() {
            let found = list_pictures(path)?;
            if found.is_empty() {
                bail!("{}: there are no pictures in this folder (png, jpg, webp, tiff, bmp, gif)", path.display());
            }
            pictures.extend(found);
        } else {
            pictures.push(path.clone());
        }
    }
    let mut names = HashSet::new();
    let task = |picture: PathBuf| {
        let stem = stem(&picture);
        let name = (1..).map(|i| if i == 1 { stem.clone() } else { format!("{stem}_{i}") });
        let name = name.into_iter().find(|name| names.insert(name.clone())).unwrap_or(stem);
        Task { target: args.out.join(name), picture }
    };
    Ok(pictures.into_iter().map(task).collect())
}

/// Mask files by their names without endings.
fn masks_by_stem(folder: &Path) -> Result<HashMap<String, PathBuf>> {
    Ok(list_pictures(folder)?.into_iter().map(|path| (stem(&path), path)).collect())
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}
