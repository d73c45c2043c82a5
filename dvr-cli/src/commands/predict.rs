//! `dvr predict`: meshes from single pictures.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, anyhow, bail};
use dvr_core::Mask;
use dvr_core::dataset::{Background, input_picture, list_pictures, mask_from_background, square_around};
use dvr_core::files::{Photo, read_mask, read_photo, write_rgb_png};
use dvr_core::mesh::write_mesh;
use dvr_train::{MeshOptions, ObjectModel, Observer, predict};
use image::RgbImage;

use super::{OBJECT_RESOLUTION, load_run, surface_options};
use crate::args::PredictArgs;
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

impl Task {
    fn files(&self) -> [PathBuf; 3] {
        ["glb", "ply", "png"].map(|ending| PathBuf::from(format!("{}.{ending}", self.target.display())))
    }

    /// Whether an earlier call has done it.
    fn is_done(&self) -> bool {
        self.files().iter().all(|file| file.is_file())
    }
}

/// Predicts every picture; pictures that cannot be used are named and left out.
pub fn run(args: &PredictArgs) -> Result<ExitCode> {
    let checkpoint = load_run(&args.run)?;
    let device = args.backend.backend.device()?;
    memory::limit(&device, args.memory.memory);
    let model = ObjectModel::load(&checkpoint, &device)?;
    let size = model.picture_size()?;
    let tasks = tasks(args)?;
    let masks = args.masks.as_deref().map(masks_by_stem).transpose()?;
    std::fs::create_dir_all(&args.out).with_context(|| args.out.display().to_string())?;
    let options = surface_options(&args.surface, OBJECT_RESOLUTION);

    let mut progress = Progress::new();
    progress.phase("predicting", tasks.len());
    let (mut made, mut kept, mut failed) = (0, 0, 0);
    for (i, task) in tasks.iter().enumerate() {
        if task.is_done() && !args.overwrite {
            kept += 1;
        } else {
            match make(task, args, size, masks.as_ref(), &model, &options, &mut progress) {
                Ok(()) => made += 1,
                Err(error) => {
                    failed += 1;
                    let error = format!("{error:#}");
                    let path = task.picture.display().to_string();
                    // Errors of files name them already.
                    let about = if error.contains(&path) { error } else { format!("{path}: {error}") };
                    progress.note(&format!("left out: {about}"));
                }
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

/// From a picture to its files.
fn make(
    task: &Task,
    args: &PredictArgs,
    size: usize,
    masks: Option<&HashMap<String, PathBuf>>,
    model: &ObjectModel,
    options: &MeshOptions,
    observer: &mut dyn Observer,
) -> Result<()> {
    let prediction = predict(model, &input(&task.picture, args, size, masks)?, options)?;
    for warning in &prediction.warnings {
        observer.note(&format!("{}: {warning}", task.picture.display()));
    }
    let [glb, ply, png] = task.files();
    write_mesh(glb, &prediction.mesh)?;
    write_mesh(ply, &prediction.mesh)?;
    Ok(write_rgb_png(&png, &prediction.preview)?)
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
