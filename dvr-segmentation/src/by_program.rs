//! Masks by a program of the user's choice, which is run once for each picture.

use std::collections::{BTreeSet, VecDeque};
use std::path::Path;

use dvr_core::files::{read_mask, read_photo, write_rgb_png};
use dvr_core::{Cancellation, Cancelled, Mask, View};
use dvr_program::{Heard, Patience, ProgramError, Stdout};
use image::RgbImage;

use crate::mask_command::MaskCommand;

/// Lines of its standard error that are told where a program fails, and the most characters of each.
const LINES: usize = 4;
const LINE_LENGTH: usize = 200;

/// A mask has fewer colours than this, beside greys: those of a palette. Photographs have thousands.
const MASK_COLORS: usize = 64;

/// A channel that differs from another by more than this makes a colour of a grey.
const COLORED: u8 = 8;

/// Why a program gave no mask of a picture.
#[derive(Debug, thiserror::Error)]
pub enum ProgramMaskError {
    /// Somebody wanted the work to end.
    #[error("{0}")]
    Cancelled(#[from] Cancelled),
    /// A file of ours could not be written.
    #[error(transparent)]
    Core(dvr_core::Error),
    /// The program failed, or what it wrote is no mask of the picture.
    #[error("photograph `{view}`: `{command}` {problem}. {said}")]
    Program {
        /// The command line, with its placeholders.
        command: String,
        /// The name of the view.
        view: String,
        /// What went wrong, as a predicate.
        problem: String,
        /// The last lines of its standard error, in a sentence.
        said: String,
    },
}

impl From<dvr_core::Error> for ProgramMaskError {
    fn from(error: dvr_core::Error) -> Self {
        match error {
            dvr_core::Error::Cancelled(cancelled) => Self::Cancelled(cancelled),
            other => Self::Core(other),
        }
    }
}

/// Runs a program for each view, one after the other: it gets the view's picture as PNG, and writes its mask as PNG, of the
/// same size in pixels. The alpha channel is the mask where one is in use, else the brightest channel of each pixel, as in
/// any file of a mask. `progress` is told how many views are done.
///
/// The files lie in a folder of the system's temporary folder, which is removed; a program is ended where the work is to end.
///
/// # Errors
/// [`ProgramMaskError::Program`] where the program fails, or writes nothing, no picture, a picture of another size, one in
/// which nothing is marked, or a photograph in place of a mask; [`ProgramMaskError::Core`] where there is no room for
/// pictures.
pub fn masks_by_program(
    views: &[View],
    command: &MaskCommand,
    cancellation: &Cancellation,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<Mask>, ProgramMaskError> {
    // So that the folder is removed, also between two programs.
    let _shield = cancellation.shield();
    let folder = tempfile::Builder::new().prefix("dvr-masks-").tempdir();
    let folder = folder.map_err(|source| dvr_core::Error::io(std::env::temp_dir(), source))?;
    let mut masks = Vec::with_capacity(views.len());
    for (done, view) in views.iter().enumerate() {
        progress(done);
        masks.push(mask_of(view, command, folder.path(), cancellation)?);
    }
    progress(views.len());
    Ok(masks)
}

/// The mask of a view.
fn mask_of(
    view: &View,
    command: &MaskCommand,
    folder: &Path,
    cancellation: &Cancellation,
) -> Result<Mask, ProgramMaskError> {
    cancellation.check()?;
    // Names of pictures may tell a program something; those of the folders keep the two apart.
    let [picture, written] = ["in", "out"].map(|side| folder.join(side).join(format!("{}.png", view.name)));
    for path in [&picture, &written] {
        let parent = path.parent().unwrap_or(folder);
        std::fs::create_dir_all(parent).map_err(|source| dvr_core::Error::io(parent, source))?;
    }
    let (width, height) = view.image.dimensions();
    let pixels = RgbImage::from_fn(width, height, |u, v| *view.image.get_pixel(u, v));
    write_rgb_png(&picture, &pixels)?;
    let mut last = LastLines::default();
    let ended = dvr_program::run(
        &mut command.of_picture(&picture, &written),
        Stdout::Lines,
        Patience::Endless,
        cancellation,
        &mut |heard| {
            if let Heard::Err(line) = heard {
                last.hear(line);
            }
        },
    );
    let mask = match ended {
        Ok(()) => read(&written, (width, height)),
        Err(ProgramError::Cancelled(cancelled)) => return Err(cancelled.into()),
        Err(ProgramError::Failed(status)) => Err(format!("failed ({status})")),
        Err(ProgramError::Deadlocked) => Err("hung".to_owned()),
        Err(ProgramError::NotStarted(error)) => Err(format!("could not be started ({error})")),
        Err(ProgramError::NotHeard(error)) => Err(format!("came to an end that was not heard ({error})")),
    };
    // What is not needed any more takes no room.
    for path in [&picture, &written] {
        let _ = std::fs::remove_file(path);
    }
    mask.map_err(|problem| ProgramMaskError::Program {
        command: command.to_string(),
        view: view.name.clone(),
        problem,
        said: last.said(),
    })
}

/// The mask in the file that a program wrote, or what is wrong with it.
fn read(path: &Path, (width, height): (u32, u32)) -> Result<Mask, String> {
    if !path.exists() {
        return Err("ended with success, and wrote no file at {out}".into());
    }
    // Its place is a temporary one, which says nothing.
    let damaged = |error: dvr_core::Error| {
        let error = error.to_string();
        format!("wrote what is no picture ({})", error.trim_start_matches(&format!("{}: ", path.display())))
    };
    let photo = read_photo(path).map_err(damaged)?;
    let size = photo.image.dimensions();
    if size != (width, height) {
        return Err(format!("wrote {}x{} pixels, and the photograph has {width}x{height}", size.0, size.1));
    }
    let mask = match photo.alpha {
        Some(alpha) => alpha,
        None if colors(&photo.image) >= MASK_COLORS => {
            return Err("wrote a photograph in colours without a transparent pixel, and no mask".into());
        }
        None => read_mask(path).map_err(damaged)?,
    };
    if mask.object_pixels() == 0 {
        return Err("wrote a mask that marks no pixel as the object".into());
    }
    Ok(mask)
}

/// How many colours a picture has that are no greys, up to those that tell a photograph.
fn colors(picture: &RgbImage) -> usize {
    let mut colors = BTreeSet::new();
    for pixel in picture.pixels().map(|pixel| pixel.0) {
        let [r, g, b] = pixel;
        if r.max(g).max(b) - r.min(g).min(b) > COLORED && colors.insert(pixel) && colors.len() >= MASK_COLORS {
            break;
        }
    }
    colors.len()
}

/// What a program said last.
#[derive(Default)]
struct LastLines(VecDeque<String>);

impl LastLines {
    fn hear(&mut self, line: &str) {
        let line = line.trim();
        if line.is_empty() {
            return;
        }
        if self.0.len() == LINES {
            self.0.pop_front();
        }
        self.0.push_back(line.chars().take(LINE_LENGTH).collect());
    }

    /// In a sentence, on one line.
    fn said(&self) -> String {
        if self.0.is_empty() {
            return "It said nothing on standard error.".into();
        }
        let said = self.0.iter().map(String::as_str).collect::<Vec<_>>().join(" / ");
        format!("Standard error ends with: {}.", said.trim_end_matches('.'))
    }
}

#[cfg(all(test, unix))]
mod tests {
    use dvr_core::files::{write_gray_png, write_rgba_png};
    use dvr_core::{Camera, stored};
    use glam::DVec3;
    use image::{GrayImage, Luma, Rgb, Rgba, RgbaImage};

    use super::*;

    fn views() -> Vec<View> {
        let camera = Camera::look_at(9, 6, 9.0, DVec3::Z, DVec3::ZERO, DVec3::Y);
        let picture = |n: u8| stored(RgbImage::from_fn(9, 6, |u, v| Rgb([u as u8 * 20, v as u8 * 30, 50 * n])));
        (0..3).map(|n| View::new(format!("view {n}"), camera.clone(), picture(n), None)).collect()
    }

    /// Runs a script of `sh`; what is said of its error is on one line.
    fn by(script: &str) -> Result<Vec<Mask>, String> {
        let command: MaskCommand = format!("sh -c '{script}' sh {{in}} {{out}}").parse().unwrap();
        let mut told = Vec::new();
        let masks = masks_by_program(&views(), &command, &Cancellation::default(), &mut |done| told.push(done));
        if masks.is_ok() {
            assert_eq!(told, [0, 1, 2, 3]);
        }
        masks.map_err(|error| error.to_string())
    }

    #[test]
    fn the_alpha_channel_is_the_mask_or_else_what_is_bright() {
        let folder = tempfile::tempdir().unwrap();
        let inside = |u: u32, v: u32| u > 3 && v < 4;
        let alpha = |u, v| Rgba([u as u8 * 9, v as u8 * 9, 200, if inside(u, v) { 255 } else { 0 }]);
        let (cutout, gray) = (folder.path().join("cutout.png"), folder.path().join("gray.png"));
        write_rgba_png(&cutout, &RgbaImage::from_fn(9, 6, alpha)).unwrap();
        write_gray_png(&gray, &GrayImage::from_fn(9, 6, |u, v| Luma([if inside(u, v) { 255 } else { 3 }]))).unwrap();
        for path in [cutout, gray] {
            let masks = by(&format!("cp {} \"$2\"", path.display())).unwrap();
            assert_eq!(masks.len(), 3);
            for (u, v) in (0..9).flat_map(|u| (0..6).map(move |v| (u, v))) {
                assert_eq!(masks[2].is_object(u, v), inside(u, v), "{u}, {v} of {}", path.display());
            }
        }
    }

    #[test]
    fn the_program_gets_the_picture_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let (seen, mask) = (folder.path().join("seen.png"), folder.path().join("mask.png"));
        write_gray_png(&mask, &GrayImage::from_pixel(9, 6, Luma([255]))).unwrap();
        by(&format!("cp \"$1\" {}; cp {} \"$2\"", seen.display(), mask.display())).unwrap();
        let last = &views()[2].image;
        assert!(dvr_core::files::read_rgb(&seen).unwrap().as_raw()[..] == last.as_raw()[..]);
    }

    #[test]
    fn what_is_no_mask_is_told_with_command_photograph_and_last_words() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write_gray_png(&at("large"), &GrayImage::from_pixel(9, 7, Luma([255]))).unwrap();
        write_gray_png(&at("black"), &GrayImage::new(9, 6)).unwrap();
        std::fs::write(at("text"), "no picture").unwrap();
        let copy = |name: &str| format!("cp {} \"$2\"", at(name).display());
        let cases = [
            ("for i in 1 2 3 4 5 6; do echo line $i >&2; done; exit 3".to_owned(), "failed (exit status: 3)"),
            ("true".to_owned(), "wrote no file"),
            (copy("large"), "wrote 9x7 pixels, and the photograph has 9x6"),
            (copy("black"), "marks no pixel"),
            (copy("text"), "no picture"),
        ];
        for (script, problem) in &cases {
            let error = by(script).unwrap_err();
            assert!(error.contains(problem) && error.contains("photograph `view 0`: `sh -c "), "{error}");
            assert!(!error.contains('\n') && !error.contains("dvr-masks-"), "{error}");
        }
        assert!(by(&cases[0].0).unwrap_err().contains("Standard error ends with: line 3 / line 4 / line 5 / line 6."));
        assert!(by(&cases[1].0).unwrap_err().contains("It said nothing on standard error."));
        let missing = "/no/such/program {in} {out}".parse().unwrap();
        let error = masks_by_program(&views(), &missing, &Cancellation::default(), &mut |_| ()).unwrap_err();
        assert!(error.to_string().contains("could not be started"), "{error}");
    }

    #[test]
    fn a_photograph_is_no_mask_and_one_of_a_palette_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("1.png");
        write_rgb_png(&path, &RgbImage::from_fn(40, 40, |u, v| Rgb([u as u8 * 6, v as u8 * 6, 9]))).unwrap();
        assert!(read(&path, (40, 40)).unwrap_err().contains("a photograph"));
        let red = |u, _| if u < 10 { Rgb([128, 0, 0]) } else { Rgb([0; 3]) };
        write_rgb_png(&path, &RgbImage::from_fn(40, 40, red)).unwrap();
        assert_eq!(read(&path, (40, 40)).unwrap().object_pixels(), 400);
    }

    #[test]
    fn a_program_is_ended_with_the_work() {
        let cancellation = Cancellation::default();
        let token = cancellation.clone();
        let canceller = std::thread::spawn(move || {
            std::thread::sleep(std::time::Duration::from_millis(300));
            token.cancel()
        });
        let command = "sh -c 'sleep 60' {in} {out}".parse().unwrap();
        let begun = std::time::Instant::now();
        let ended = masks_by_program(&views(), &command, &cancellation, &mut |_| ());
        assert!(matches!(ended, Err(ProgramMaskError::Cancelled(_))), "{ended:?}");
        assert!(begun.elapsed().as_secs() < 30 && canceller.join().unwrap() && !cancellation.is_shielded());
    }
}
