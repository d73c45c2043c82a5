//! `dvr masks`: masks of photographs that have none, from all views or by a program of the user's choice; and the same on
//! the way of `dvr train`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use anyhow::{Result, bail};
use dvr_core::files::{Claim, FolderKind, OutputFolder, write_gray_png};
use dvr_core::{Cancellation, HOLD_OUT_EVERY, HalfSpace, Mask, Scene};
use dvr_segmentation::{
    FEW_PHOTOGRAPHS, MaskCommand, Segmentation, Shown, SupportPlane, Wanted, masks_by_program, segment,
};
use dvr_train::{Observer, Support};

use super::{SceneReading, print_notes};
use crate::args::{MasksArgs, MasksFrom};
use crate::memory::make_room_for_masks;
use crate::progress::Progress;

/// Finds and writes.
pub fn run(args: &MasksArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let by = args.segment.segment.as_ref();
    check_program(by, args.reading.masks.as_ref())?;
    let claim = if args.overwrite { Claim::Replace } else { Claim::New };
    OutputFolder::check::<&str>(&args.out, FolderKind::Masks, claim, &[])?;
    let reading = SceneReading::of_arguments(&args.reading);
    let divide = |scene: &mut Scene| Ok(scene.hold_out(HOLD_OUT_EVERY));
    let (mut scene, ..) = reading.read(&args.scene, divide, cancellation)?;
    let have = scene.views.iter().filter(|view| view.mask.is_some()).count();
    if have > 0 {
        bail!("{}: {have} of {} views have masks; these are used as they are", args.scene.display(), scene.views.len());
    }
    print_notes(&scene.warnings);
    let found = find(&mut scene, by, wanted(args.reading.masks.as_ref()), args.reading.memory, cancellation)?;
    let mut folder = OutputFolder::claim::<&str>(&args.out, FolderKind::Masks, claim, &[])?;
    write(&found.masks, &scene, &mut folder, &args.out, Path::new(""))?;
    println!("{}", found.summary);
    println!(
        "wrote {0}: a mask for each view. Look at them; `--masks {0}` uses them, edited or not",
        args.out.display()
    );
    Ok(ExitCode::SUCCESS)
}

/// Whether masks are to be found: no view has one, and nobody said where they are.
pub fn are_missing(scene: &Scene, from: Option<&MasksFrom>) -> bool {
    matches!(from, None | Some(MasksFrom::Auto | MasksFrom::Cube | MasksFrom::Off))
        && scene.views.iter().all(|view| view.mask.is_none())
}

/// What masks that are found are to show.
pub fn wanted(from: Option<&MasksFrom>) -> Wanted {
    match from {
        Some(MasksFrom::Cube) => Wanted::Cube,
        Some(MasksFrom::Off) => Wanted::Learned,
        _ => Wanted::Auto,
    }
}

/// Refuses a program for masks beside masks that are there.
///
/// # Errors
/// Where masks are said to be given.
pub fn check_program(by: Option<&MaskCommand>, from: Option<&MasksFrom>) -> Result<()> {
    let given = match (by, from) {
        (None, _) | (_, None | Some(MasksFrom::Auto)) => return Ok(()),
        (_, Some(MasksFrom::Cube)) => "cube".to_owned(),
        (_, Some(MasksFrom::Off)) => "off".to_owned(),
        (_, Some(MasksFrom::Given)) => "given".to_owned(),
        (_, Some(MasksFrom::Folder(folder))) => folder.display().to_string(),
    };
    bail!("--segment makes masks, and --masks {given} takes others: leave out one of the two")
}

/// Masks of all views, and what is to be said of them.
pub struct FoundMasks {
    /// One mask for each view, as large as its picture.
    pub masks: Vec<Mask>,
    /// How they were found, in a sentence without its full stop.
    pub summary: String,
    /// The object's side of what it stands on, in the coordinates of the scene's files, where that was found.
    pub support: Option<HalfSpace>,
}

/// Finds the masks of all views, by a program where one is given, else what is `wanted` from all views together, within
/// `memory` where that is given; with progress.
pub fn find(
    scene: &mut Scene,
    by: Option<&MaskCommand>,
    wanted: Wanted,
    memory: Option<u64>,
    cancellation: &Cancellation,
) -> Result<FoundMasks> {
    if let Some(command) = by {
        let mut progress = Progress::new();
        progress.phase(&format!("masks by {}", command.program()), scene.views.len());
        let masks = masks_by_program(&scene.views, command, cancellation, &mut |done| progress.progress(done, ""))?;
        let summary = format!("masks were made by `{command}`: the object fills {} in the mean", share(&masks));
        return Ok(FoundMasks { masks, summary, support: None });
    }
    make_room_for_masks(scene, memory)?;
    let found = find_from_all_views(scene, wanted, cancellation)?;
    let half = |plane: SupportPlane| HalfSpace { normal: plane.normal.as_dvec3(), offset: f64::from(plane.offset) };
    let support = found.support.map(|plane| half(plane).transformed(&scene.object_to_world));
    Ok(FoundMasks { summary: summary(&found, wanted, support), masks: found.masks, support })
}

fn find_from_all_views(scene: &Scene, wanted: Wanted, cancellation: &Cancellation) -> Result<Segmentation> {
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
    Ok(segment(&scene.views, wanted, cancellation, &tell)?)
}

/// Writes masks into a part of a folder that is ours; gives that part.
pub fn write(masks: &[Mask], scene: &Scene, folder: &mut OutputFolder, root: &Path, part: &Path) -> Result<PathBuf> {
    let file = |name: &str| part.join(format!("{name}.png"));
    let files: Vec<String> =
        scene.views.iter().map(|view| file(&view.name).to_string_lossy().replace('\\', "/")).collect();
    folder.add(&files)?;
    let place = root.join(part);
    std::fs::create_dir_all(&place).map_err(|source| dvr_core::Error::io(&place, source))?;
    for (view, mask) in scene.views.iter().zip(masks) {
        write_gray_png(&root.join(file(&view.name)), &mask.coverage)?;
    }
    Ok(place)
}

/// The mean share of a picture that masks mark.
fn share(masks: &[Mask]) -> String {
    let shares = masks.iter().map(|mask| mask.object_pixels() as f64 / mask.coverage.len().max(1) as f64);
    format!("{:.0} % of a picture", 100.0 * shares.sum::<f64>() / masks.len().max(1) as f64)
}

/// What was found from all views; of an object in few photographs, that its masks deserve little trust.
fn summary(found: &Segmentation, wanted: Wanted, support: Option<HalfSpace>) -> String {
    let found_in = found.masks.len();
    let doubt = if found.shown == Shown::Object && found_in < FEW_PHOTOGRAPHS {
        format!(". From fewer than {FEW_PHOTOGRAPHS} photographs, as here from {found_in}, masks are often wrong")
    } else {
        String::new()
    };
    format!("{}{doubt}", what_was_found(found, wanted, support))
}

/// What was found from all views, in a sentence.
fn what_was_found(found: &Segmentation, wanted: Wanted, support: Option<HalfSpace>) -> String {
    let support = match support.map(|plane| Support { plane, is_dropped: false }) {
        Some(support) => format!("it stands on a plane, which is not part of it ({support})"),
        None => "no plane that it stands on was found".to_owned(),
    };
    if found.shown == Shown::Cube {
        return format!(
            "masks show all that lies in a cube around what is in the middles of the pictures{}, {} in the mean",
            if wanted == Wanted::Cube { "" } else { ", since no object stands out there" },
            share(&found.masks)
        );
    }
    let how = match (wanted, found.is_learned) {
        (Wanted::Learned, _) => "object and background were learned together",
        (_, true) => {
            "masks were found from all views, and corrected where object and background, learned together, differ"
        }
        (_, false) => "masks were found from all views",
    };
    format!("{how}: the object fills {} in the mean; {support}", share(&found.masks))
}

#[cfg(test)]
mod tests {
    use image::GrayImage;

    use super::*;

    fn found(views: usize, shown: Shown) -> String {
        let mask = || Mask::from(GrayImage::from_raw(2, 2, vec![255, 0, 0, 0]).unwrap());
        let masks = (0..views).map(|_| mask()).collect();
        summary(&Segmentation { masks, shown, support: None, is_learned: false }, Wanted::Auto, None)
    }

    #[test]
    fn masks_from_few_photographs_are_doubted() {
        let [many, few] = [FEW_PHOTOGRAPHS, 12].map(|views| found(views, Shown::Object));
        assert!(many.contains("fills 25 % of a picture") && !many.contains("wrong"), "{many}");
        assert!(few.ends_with("as here from 12, masks are often wrong"), "{few}");
        let cube = found(12, Shown::Cube);
        assert!(!cube.contains("wrong"), "measured of objects alone: {cube}");
    }
}
