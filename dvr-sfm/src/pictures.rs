//! Pictures as COLMAP gets them: upright, in 8 bits, without transparency, and grouped by camera.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use dvr_core::Cancellation;
use dvr_core::dataset::find_masks;
use dvr_core::files::{UprightPhoto, read_bytes, read_mask, upright_photo, write_gray_png, write_jpeg, write_rgb_png};
use dvr_core::{Mask, stored};
use image::DynamicImage;
use image::metadata::Orientation;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::error::{Result, SfmError};
use crate::exif::camera_tags;
use crate::options::CameraSharing;

/// Quality of a JPEG that was turned: its losses lie below those of the camera's own.
const QUALITY: u8 = 98;

/// A picture that COLMAP gets.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Prepared {
    /// Its path below the folder of pictures, with `/`.
    pub name: String,
    /// Its mask's path below the folder of masks.
    pub mask: Option<String>,
    /// Width and height.
    pub size: (u32, u32),
    /// What pictures of the same camera have in common.
    pub camera: String,
    /// Focal lengths and principal point of the camera, `fx fy cx cy`, where they are known and nothing distorts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pinhole: Option<[f64; 4]>,
}

/// What pictures are prepared from, and where to.
pub(crate) struct Preparation<'a> {
    /// The folder of the originals.
    pub folder: &'a Path,
    /// Where masks lie in a folder of their own.
    pub root: &'a Path,
    /// Paths of the originals below `folder`.
    pub originals: &'a [PathBuf],
    /// Where pictures go.
    pub pictures: PathBuf,
    /// Where masks go.
    pub masks: PathBuf,
    pub sharing: CameraSharing,
}

/// The SHA-256 of all pictures and their masks with their names, in hexadecimal.
pub(crate) fn digest(root: &Path, folder: &Path, originals: &[PathBuf], cancellation: &Cancellation) -> Result<String> {
    let masks = find_masks(root, originals)?;
    let one = |(original, mask): (&PathBuf, &Option<PathBuf>)| -> Result<Vec<u8>> {
        cancellation.check()?;
        let mut hash = Sha256::new();
        hash.update(original.to_string_lossy().as_bytes());
        hash.update(Sha256::digest(read_bytes(&folder.join(original))?));
        if let Some(mask) = mask {
            hash.update(Sha256::digest(read_bytes(mask)?));
        }
        Ok(hash.finalize().to_vec())
    };
    let digests: Vec<Vec<u8>> = originals.par_iter().zip(&masks).map(one).collect::<Result<_>>()?;
    let all = Sha256::digest(digests.concat());
    Ok(all.iter().map(|byte| format!("{byte:02x}")).collect())
}

impl Preparation<'_> {
    /// Prepares all pictures, and gives a note on each that cannot be read, which is left out.
    ///
    /// # Errors
    /// [`SfmError::SameName`]; [`SfmError::Core`] where a file cannot be written.
    pub fn run(&self, cancellation: &Cancellation) -> Result<(Vec<Prepared>, Vec<String>)> {
        self.check_names()?;
        let masks = find_masks(self.root, self.originals)?;
        let one = |(original, mask): (&PathBuf, &Option<PathBuf>)| {
            cancellation.check()?;
            self.prepare(original, mask.as_deref())
        };
        let results: Vec<Result<(Prepared, Option<String>)>> = self.originals.par_iter().zip(&masks).map(one).collect();
        let (mut prepared, mut notes) = (Vec::new(), Vec::new());
        for result in results {
            match result {
                Ok((picture, note)) => {
                    prepared.push(picture);
                    notes.extend(note);
                }
                Err(SfmError::Core(error @ (dvr_core::Error::Format { .. } | dvr_core::Error::TooLarge { .. }))) => {
                    notes.push(format!("a picture is left out: {error}"));
                }
                Err(error) => return Err(error),
            }
        }
        Ok((prepared, notes))
    }

    /// Views are named by their pictures without the ending.
    fn check_names(&self) -> Result<()> {
        let mut known: BTreeMap<PathBuf, &PathBuf> = BTreeMap::new();
        for original in self.originals {
            if let Some(first) = known.insert(original.with_extension(""), original) {
                let (first, second) = (first.display().to_string(), original.display().to_string());
                return Err(SfmError::SameName { path: self.folder.to_owned(), first, second });
            }
        }
        Ok(())
    }

    fn prepare(&self, original: &Path, mask: Option<&Path>) -> Result<(Prepared, Option<String>)> {
        let source = self.folder.join(original);
        let bytes = read_bytes(&source)?;
        let upright = upright_photo(&source, &bytes)?;
        let is_turned = upright.orientation != Orientation::NoTransforms;
        let image = &upright.photo.image;
        let name = match (upright.is_plain, is_turned) {
            (true, false) => original.to_owned(),
            (true, true) => original.with_extension("jpg"),
            (false, _) => original.with_extension("png"),
        };
        let target = self.pictures.join(&name);
        make_folder_of(&target)?;
        match (upright.is_plain, is_turned) {
            (true, false) => link(&source, &target)?,
            (true, true) => write_jpeg(&target, image, QUALITY, upright.exif.as_deref())?,
            (false, _) => write_rgb_png(&target, image)?,
        }
        let (mask, note) = self.mask(original, &upright, mask)?;
        let camera = self.camera(original, &upright);
        Ok((Prepared { name: portable(&name), mask, size: image.dimensions(), camera, pinhole: None }, note))
    }

    /// Writes the mask of a picture, from its file or else its transparent pixels, as upright as the picture.
    fn mask(
        &self,
        original: &Path,
        upright: &UprightPhoto,
        file: Option<&Path>,
    ) -> Result<(Option<String>, Option<String>)> {
        let size = upright.photo.image.dimensions();
        let mask = match file {
            None => upright.photo.alpha.clone(),
            Some(file) => Some(turned_to(read_mask(file)?, size, upright.orientation)),
        };
        let Some(mask) = mask else { return Ok((None, None)) };
        if mask.size() != size {
            let ((width, height), path) = (mask.size(), file.unwrap_or(original).display());
            let note =
                format!("a mask is left out: {path} has {width}x{height} pixels, its picture {}x{}", size.0, size.1);
            return Ok((None, Some(note)));
        }
        let name = original.with_extension("png");
        let target = self.masks.join(&name);
        make_folder_of(&target)?;
        write_gray_png(&target, &mask.coverage)?;
        Ok((Some(portable(&name)), None))
    }

    /// What pictures of the same camera have in common: never more than their size, which one camera has.
    fn camera(&self, original: &Path, upright: &UprightPhoto) -> String {
        let (width, height) = upright.photo.image.dimensions();
        let size = format!("{width}x{height}");
        match self.sharing {
            CameraSharing::Similar => {
                let tags = upright.exif.as_deref().map(camera_tags).unwrap_or_default();
                let focal = tags.focal_length.map_or_else(String::new, |mm| format!("{mm:.2} mm"));
                format!("{size} {} {focal}", tags.model)
            }
            CameraSharing::Folder => format!("{size} {}", original.parent().unwrap_or(Path::new("")).display()),
            CameraSharing::Picture => "one per picture".to_owned(),
        }
    }
}

/// A mask that was made of the pixels as they are stored, turned like the picture.
fn turned_to(mask: Mask, size: (u32, u32), orientation: Orientation) -> Mask {
    if mask.size() == size {
        return mask;
    }
    let (width, height) = mask.size();
    let gray = image::GrayImage::from_raw(width, height, mask.coverage.to_vec()).unwrap_or_default();
    let mut turned = DynamicImage::ImageLuma8(gray);
    turned.apply_orientation(orientation);
    Mask { coverage: stored(turned.into_luma8()) }
}

/// A path with `/`, as COLMAP writes it.
fn portable(path: &Path) -> String {
    path.components().map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
}

pub(crate) fn make_folder_of(file: &Path) -> Result<()> {
    let folder = file.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|source| dvr_core::Error::Io { path: folder.to_owned(), source }.into())
}

/// The original in another place: a link where the system has them, else a copy.
fn link(source: &Path, target: &Path) -> Result<()> {
    let refused = |source| dvr_core::Error::Io { path: target.to_owned(), source };
    if std::fs::symlink_metadata(target).is_ok() {
        std::fs::remove_file(target).map_err(refused)?;
    }
    let absolute = std::path::absolute(source).map_err(refused)?;
    #[cfg(unix)]
    if std::os::unix::fs::symlink(&absolute, target).is_ok() {
        return Ok(());
    }
    std::fs::copy(&absolute, target).map(drop).map_err(|source| refused(source).into())
}

#[cfg(test)]
mod tests {
    use dvr_core::files::{read_rgb, write_rgba_png};
    use image::{GrayImage, ImageBuffer, Luma, Rgb, RgbImage, Rgba, RgbaImage};

    use super::*;

    struct Folders(tempfile::TempDir);

    impl Folders {
        fn at(&self, name: &str) -> PathBuf {
            self.0.path().join(name)
        }

        fn prepare(&self, originals: &[&str], sharing: CameraSharing) -> Result<(Vec<Prepared>, Vec<String>)> {
            let originals: Vec<PathBuf> = originals.iter().map(PathBuf::from).collect();
            let (folder, root) = (self.at("photos"), self.at("photos"));
            let (pictures, masks) = (self.at("pictures"), self.at("prepared_masks"));
            let preparation =
                Preparation { folder: &folder, root: &root, originals: &originals, pictures, masks, sharing };
            preparation.run(&Cancellation::default())
        }
    }

    fn folders() -> Folders {
        let folders = Folders(tempfile::tempdir().unwrap());
        std::fs::create_dir_all(folders.at("photos/masks")).unwrap();
        folders
    }

    /// Orientation 6: to be turned by 90 degrees to the right.
    const SIDEWAYS: &[u8] = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";

    #[test]
    fn pictures_are_upright_in_eight_bits_and_without_transparency() {
        let folders = folders();
        let wide = RgbImage::from_fn(24, 16, |u, _| Rgb([u as u8 * 10; 3]));
        write_jpeg(&folders.at("photos/plain.jpg"), &wide, 95, None).unwrap();
        write_jpeg(&folders.at("photos/side.JPG"), &wide, 95, Some(SIDEWAYS)).unwrap();
        ImageBuffer::<Rgb<u16>, Vec<u16>>::from_pixel(24, 16, Rgb([65535, 257, 0]))
            .save(folders.at("photos/deep.png"))
            .unwrap();
        let cut = RgbaImage::from_fn(24, 16, |u, _| Rgba([9, 8, 7, if u < 12 { 255 } else { 0 }]));
        write_rgba_png(&folders.at("photos/cut.png"), &cut).unwrap();
        let stored_mask = GrayImage::from_fn(24, 16, |u, _| Luma([if u < 6 { 255 } else { 0 }]));
        write_gray_png(&folders.at("photos/masks/side.png"), &stored_mask).unwrap();
        let names = ["plain.jpg", "side.JPG", "deep.png", "cut.png"];
        let (prepared, notes) = folders.prepare(&names, CameraSharing::Similar).unwrap();
        assert_eq!(notes, Vec::<String>::new());
        let got: Vec<&str> = prepared.iter().map(|picture| picture.name.as_str()).collect();
        assert_eq!(got, ["plain.jpg", "side.jpg", "deep.png", "cut.png"]);
        assert_eq!(prepared[1].size, (16, 24));
        let sizes: Vec<_> = got.iter().map(|name| read_rgb(&folders.at("pictures").join(name)).unwrap()).collect();
        assert_eq!(
            sizes.iter().map(RgbImage::dimensions).collect::<Vec<_>>(),
            [(24, 16), (16, 24), (24, 16), (24, 16)]
        );
        assert_eq!(sizes[2].get_pixel(3, 3), &Rgb([255, 1, 0]));
        let mask = |name: &str| read_mask(&folders.at("prepared_masks").join(name)).unwrap();
        assert_eq!(prepared[3].mask.as_deref(), Some("cut.png"));
        assert_eq!(mask("cut.png").object_pixels(), 12 * 16);
        assert_eq!((mask("side.png").size(), mask("side.png").is_object(8, 2)), ((16, 24), true));
        // Portrait and landscape are two cameras.
        assert!(prepared[0].camera == prepared[2].camera && prepared[0].camera != prepared[1].camera);
    }

    #[test]
    fn a_damaged_picture_is_named_and_left_out_and_a_name_that_is_there_twice_refused() {
        let folders = folders();
        write_jpeg(&folders.at("photos/a.jpg"), &RgbImage::new(24, 16), 95, None).unwrap();
        let bytes = std::fs::read(folders.at("photos/a.jpg")).unwrap();
        std::fs::write(folders.at("photos/b.jpg"), &bytes[..bytes.len() / 2]).unwrap();
        let (prepared, notes) = folders.prepare(&["a.jpg", "b.jpg"], CameraSharing::Picture).unwrap();
        assert_eq!((prepared.len(), notes.len()), (1, 1));
        assert!(notes[0].contains("b.jpg") && notes[0].contains("left out"), "{notes:?}");
        std::fs::copy(folders.at("photos/a.jpg"), folders.at("photos/a.png")).unwrap();
        let error = folders.prepare(&["a.jpg", "a.png"], CameraSharing::Similar).unwrap_err().to_string();
        assert!(error.contains("`a.jpg` and `a.png`"), "{error}");
    }
}
