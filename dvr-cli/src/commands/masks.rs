//! `dvr masks`: masks of photographs that have none; and the same on the way of `dvr train`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use anyhow::{Result, bail};
use dvr_core::files::{Claim, FolderKind, OutputFolder, write_gray_png};
use dvr_core::{Cancellation, HOLD_OUT_EVERY, Scene};
use dvr_segmentation::{Segmentation, segment};
use dvr_train::Observer;

use super::{SceneReading, print_notes};
use crate::args::{MasksArgs, MasksFrom};
use crate::memory::make_room_for_masks;
use crate::progress::Progress;

/// Finds and writes.
pub fn run(args: &MasksArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let claim = if args.overwrite { Claim::Replace } else { Claim::New };
    OutputFolder::check::<&str>(&args.out, FolderKind::Masks, claim, &[])?;
    let reading = SceneReading::of_arguments(&args.reading);
    let divide = |scene: &mut Scene| Ok(scene.hold_out(HOLD_OUT_EVERY));
    let (mut scene, ..) = reading.read(&args.scene, divide, cancellation)?;
    let without = scene.views.iter().filter(|view| view.mask.is_none()).count();
    if without < scene.views.len() {
        let have = scene.views.len() - without;
        bail!("{}: {have} of {} views have masks; these are used as they are", args.scene.display(), scene.views.len());
    }
    print_notes(&scene.warnings);
    make_room_for_masks(&mut scene, args.reading.memory)?;
    let found = find(&scene, cancellation)?;
    let mut folder = OutputFolder::claim::<&str>(&args.out, FolderKind::Masks, claim, &[])?;
    write(&found, &scene, &mut folder, &args.out, Path::new(""))?;
    println!("{}", summary(&found));
    println!(
        "wrote {0}: a mask for each view. Look at them; `--masks {0}` uses them, edited or not",
        args.out.display()
    );
    Ok(ExitCode::SUCCESS)
}

/// Whether masks are to be found: no view has one, and nobody said where they are.
pub fn are_missing(scene: &Scene, from: Option<&MasksFrom>) -> bool {
    matches!(from, None | Some(MasksFrom::Auto)) && scene.views.iter().all(|view| view.mask.is_none())
}

/// Finds the masks of all views, with progress.
pub fn find(scene: &Scene, cancellation: &Cancellation) -> Result<Segmentation> {
    let progress: Mutex<Option<Progress>> = Mutex::new(None);
    let tell = |done: usize, parts: usize| {
        let mut progress = progress.lock().unwrap_or_else(PoisonError::into_inner);
        let progress = progress.get_or_insert_with(|| {
            let mut progress = Progress::new();
            progress.phase("masks from all views", parts);
            progress
        });
        progress.progress(done, "");
    };
    Ok(segment(&scene.views, cancellation, &tell)?)
}

/// Writes masks into a part of a folder that is ours; gives that part.
pub fn write(
    found: &Segmentation,
    scene: &Scene,
    folder: &mut OutputFolder,
    root: &Path,
    part: &Path,
) -> Result<PathBuf> {
    let file = |name: &str| part.join(format!("{name}.png"));
    let files: Vec<String> =
        scene.views.iter().map(|view| file(&view.name).to_string_lossy().replace('\\', "/")).collect();
    folder.add(&files)?;
    let place = root.join(part);
    std::fs::create_dir_all(&place).map_err(|source| dvr_core::Error::io(&place, source))?;
    for (view, mask) in scene.views.iter().zip(&found.masks) {
        write_gray_png(&root.join(file(&view.name)), &mask.coverage)?;
    }
    Ok(place)
}

/// What was found, in a sentence.
pub fn summary(found: &Segmentation) -> String {
    let shares: Vec<f64> =
        found.masks.iter().map(|mask| mask.object_pixels() as f64 / mask.coverage.len().max(1) as f64).collect();
    let mean = 100.0 * shares.iter().sum::<f64>() / shares.len().max(1) as f64;
    let support = match found.support {
        Some(_) => "it stands on a plane, which is not part of it",
        None => "no plane that it stands on was found",
    };
    format!("masks were found from all views: the object fills {mean:.0} % of a picture in the mean; {support}")
}
