//! Photographs and masks in 8 bits per channel.

use std::io::Cursor;
use std::ops::Deref;
use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::metadata::Orientation;
use image::{
    DynamicImage, ExtendedColorType, GrayImage, ImageBuffer, ImageDecoder, ImageEncoder, ImageError, ImageFormat,
    ImageReader, ImageResult, Limits, Luma, Rgb, RgbImage, RgbaImage,
};

use super::limits::{JPEG_PIXELS_PER_BYTE, PICTURE_BYTES, PICTURE_PIXELS, check_limit};
use super::{read_bytes, write_bytes_atomically};
use crate::error::{Error, Result};
use crate::raster::Mask;

/// Rows that are converted at a time.
const BAND: u32 = 64;

/// A photograph as its file holds it.
#[derive(Clone, Debug)]
pub struct Photo {
    /// sRGB colours, not multiplied by alpha; 16-bit files are rounded to 8.
    pub image: RgbImage,
    /// The alpha channel, where there is one and it is not opaque everywhere.
    pub alpha: Option<Mask>,
}

/// Reads a PNG, JPEG, WebP, BMP, TIFF or GIF; the content decides which, not the name.
///
/// An orientation tag (EXIF) is not applied: calibrations refer to the pixels as they are stored.
///
/// # Errors
/// [`Error::Io`] where the file cannot be opened, [`Error::Format`] where it is damaged or of another kind,
/// [`Error::TooLarge`] above [`PICTURE_PIXELS`] or [`PICTURE_BYTES`].
pub fn read_photo(path: &Path) -> Result<Photo> {
    let decoded = decode(path)?;
    let alpha = alpha_of(&decoded);
    Ok(Photo { image: into_rgb(decoded), alpha: alpha.map(Mask::from) })
}

/// A photograph as a person looks at it, for programs that find its camera.
#[derive(Clone, Debug)]
pub struct UprightPhoto {
    /// The picture, turned as its orientation tag says.
    pub photo: Photo,
    /// How it was turned or mirrored for that; a mask of the pixels as they are stored is turned likewise.
    pub orientation: Orientation,
    /// Its EXIF block (a TIFF header and its directories), without the orientation.
    pub exif: Option<Vec<u8>>,
    /// Whether the file is a JPEG or an 8-bit PNG without transparent pixels: what any program reads as we do.
    pub is_plain: bool,
}

/// Reads a photograph and turns it as its EXIF orientation says; otherwise as [`read_photo`], which see for files and
/// errors. `bytes` are those of the file at `path`.
///
/// # Errors
/// As [`read_photo`], but for [`Error::Io`].
pub fn upright_photo(path: &Path, bytes: &[u8]) -> Result<UprightPhoto> {
    let format = image::guess_format(bytes).ok();
    let whole = format != Some(ImageFormat::Jpeg) || jpeg_is_whole(bytes);
    if !whole {
        return Err(damaged(path, "the file ends before the image does"));
    }
    let mut exif = exif_of(bytes);
    let orientation = exif.as_mut().and_then(|chunk| Orientation::remove_from_exif_chunk(chunk));
    let orientation = orientation.unwrap_or(Orientation::NoTransforms);
    let mut decoded = decoded_picture(path, bytes)?;
    decoded.apply_orientation(orientation);
    let color = decoded.color();
    let is_deep = color.bytes_per_pixel() > color.channel_count();
    let alpha = alpha_of(&decoded);
    Ok(UprightPhoto {
        is_plain: matches!(format, Some(ImageFormat::Jpeg | ImageFormat::Png)) && !is_deep && alpha.is_none(),
        photo: Photo { image: into_rgb(decoded), alpha: alpha.map(Mask::from) },
        orientation,
        exif,
    })
}

/// The EXIF block of a picture that has one.
fn exif_of(bytes: &[u8]) -> Option<Vec<u8>> {
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().ok()?;
    reader.into_decoder().ok()?.exif_metadata().ok()?
}

/// [`read_photo`] without its alpha channel.
///
/// # Errors
/// As [`read_photo`].
pub fn read_rgb(path: &Path) -> Result<RgbImage> {
    Ok(read_photo(path)?.image)
}

/// Reads a mask: an alpha channel where one is in use, else the brightest colour channel of each pixel.
///
/// Files that mark the object with 1 instead of the largest value (0/1 masks, as label tools write them) are read as
/// full coverage, as are 16-bit files that use only 8 of their bits.
///
/// # Errors
/// As [`read_photo`].
pub fn read_mask(path: &Path) -> Result<Mask> {
    let decoded = decode(path)?;
    if let Some(alpha) = alpha_of(&decoded) {
        return Ok(Mask::from(alpha));
    }
    let color = decoded.color();
    let (width, height) = (decoded.width(), decoded.height());
    let full_range = if color.bytes_per_pixel() / color.channel_count() > 1 { 65535 } else { 255 };
    let brightest = brightest_channel(decoded);
    let full = match brightest.iter().max() {
        Some(1) => 1,
        Some(2..=255) => 255,
        _ => full_range,
    };
    // Rounded to the nearest of 0..=255; `full` bounds every value, so the narrowing is exact.
    let coverage = brightest.into_iter().map(|v| ((u32::from(v) * 255 + full / 2) / full) as u8).collect();
    let coverage = GrayImage::from_vec(width, height, coverage)
        .ok_or_else(|| damaged(path, "the decoder gave fewer pixels than the image has"))?;
    Ok(Mask::from(coverage))
}

/// Writes an 8-bit RGB PNG.
///
/// # Errors
/// [`Error::Io`] where the file cannot be written.
pub fn write_rgb_png(path: &Path, image: &ImageBuffer<Rgb<u8>, impl Deref<Target = [u8]>>) -> Result<()> {
    write_png(path, image, image.dimensions(), ExtendedColorType::Rgb8)
}

/// Writes a JPEG of the given quality (1 to 100) without chroma subsampling, with an EXIF block where one is given.
///
/// # Errors
/// [`Error::Io`] where the file cannot be written.
pub fn write_jpeg(path: &Path, image: &RgbImage, quality: u8, exif: Option<&[u8]>) -> Result<()> {
    let bytes = encoded_jpeg(image, quality, exif).map_err(|error| Error::io(path, std::io::Error::other(error)))?;
    write_bytes_atomically(path, &bytes)
}

/// The bytes that [`write_jpeg`] writes.
///
/// # Errors
/// When the picture has no pixels, or an edge is longer than 65 535 of them.
pub fn encoded_jpeg(image: &RgbImage, quality: u8, exif: Option<&[u8]>) -> ImageResult<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
    // A block that does not fit into its segment is left out: the picture is what matters.
    if let Some(exif) = exif.filter(|exif| exif.len() < 60_000) {
        encoder.set_exif_metadata(exif.to_vec()).map_err(ImageError::Unsupported)?;
    }
    encoder.write_image(image, image.width(), image.height(), ExtendedColorType::Rgb8)?;
    Ok(bytes)
}

/// Writes an 8-bit RGBA PNG.
///
/// # Errors
/// [`Error::Io`] where the file cannot be written.
pub fn write_rgba_png(path: &Path, image: &RgbaImage) -> Result<()> {
    write_png(path, image, image.dimensions(), ExtendedColorType::Rgba8)
}

/// Writes an 8-bit grey PNG, the form of a [`Mask`]'s coverage.
///
/// # Errors
/// [`Error::Io`] where the file cannot be written.
pub fn write_gray_png(path: &Path, image: &ImageBuffer<Luma<u8>, impl Deref<Target = [u8]>>) -> Result<()> {
    write_png(path, image, image.dimensions(), ExtendedColorType::L8)
}

/// `write_to` would do, but compiles the encoder of every other format as well, once for each type of pixel.
fn write_png(path: &Path, samples: &[u8], size: (u32, u32), color: ExtendedColorType) -> Result<()> {
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(samples, size.0, size.1, color)
        .map_err(|error| Error::io(path, std::io::Error::other(error)))?;
    write_bytes_atomically(path, &bytes)
}

fn decode(path: &Path) -> Result<DynamicImage> {
    let bytes = read_bytes(path)?;
    if image::guess_format(&bytes).is_ok_and(|format| format == ImageFormat::Jpeg) && !jpeg_is_whole(&bytes) {
        return Err(damaged(path, "the file ends before the image does"));
    }
    decoded_picture(path, &bytes)
}

/// The picture in bytes that `path` names in errors, its size checked before it is decoded.
///
/// # Errors
/// [`Error::Format`] where the bytes are damaged or no picture, [`Error::TooLarge`] above [`PICTURE_PIXELS`] or
/// [`PICTURE_BYTES`].
pub fn decoded_picture(path: &Path, bytes: &[u8]) -> Result<DynamicImage> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| damaged(path, e))?;
    let is_jpeg = reader.format() == Some(ImageFormat::Jpeg);
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(PICTURE_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| damaged(path, error))?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    check_limit(path, "the number of pixels", pixels, PICTURE_PIXELS)?;
    check_limit(path, "the size of the decoded picture in bytes", decoder.total_bytes(), PICTURE_BYTES)?;
    if is_jpeg && pixels > JPEG_PIXELS_PER_BYTE * bytes.len() as u64 {
        return Err(damaged(path, format!("{width}x{height} pixels cannot be in a JPEG of {} bytes", bytes.len())));
    }
    if pixels == 0 {
        return Err(damaged(path, "it has no pixels"));
    }
    DynamicImage::from_decoder(decoder).map_err(|error| damaged(path, error))
}

/// Size of the image in pixels, `(width, height)`, without decoding it.
///
/// # Errors
/// As [`read_photo`].
pub(crate) fn image_size(path: &Path) -> Result<(u32, u32)> {
    let reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format);
    let reader = reader.map_err(|source| Error::io(path, source))?;
    reader.into_dimensions().map_err(|error| damaged(path, error))
}

/// Whether a JPEG has its end marker. The decoder fills what is missing with grey and says nothing.
fn jpeg_is_whole(bytes: &[u8]) -> bool {
    let mut rest = bytes;
    loop {
        // To the next marker: 0xff, but within the entropy-coded data neither a stuffed zero nor a restart.
        let is_marker = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0x00 | 0xd0..=0xd7 | 0xff);
        let Some(at) = rest.windows(2).position(is_marker) else { return false };
        let (marker, after) = (rest[at + 1], &rest[at + 2..]);
        let has_no_length = matches!(marker, 0x01 | 0xd8);
        rest = match (marker, after) {
            (0xd9, _) => return true,
            (_, _) if has_no_length => after,
            (_, &[high, low, ..]) => after.get(usize::from(u16::from_be_bytes([high, low]))..).unwrap_or_default(),
            _ => return false,
        };
    }
}

fn damaged(path: &Path, what: impl std::fmt::Display) -> Error {
    Error::format(
        path,
        format!("the image cannot be read ({what})"),
        "The file may be truncated or not an image: copy it again, or save it as PNG or JPEG.",
    )
}

/// The alpha channel, where there is one and it is not opaque everywhere. 16 bits are rounded to 8 as the decoder does.
fn alpha_of(image: &DynamicImage) -> Option<GrayImage> {
    let alpha: Vec<u8> = match image {
        DynamicImage::ImageLumaA8(image) => image.pixels().map(|p| p.0[1]).collect(),
        DynamicImage::ImageRgba8(image) => image.pixels().map(|p| p.0[3]).collect(),
        image if image.color().has_alpha() => {
            // A band at a time: a copy of all of it would be as large as the picture.
            let bands = (0..image.height()).step_by(BAND as usize);
            let band = |top| image.crop_imm(0, top, image.width(), BAND).into_rgba8();
            bands.flat_map(|top| band(top).pixels().map(|p| p.0[3]).collect::<Vec<u8>>()).collect()
        }
        _ => return None,
    };
    if alpha.iter().all(|&a| a == 255) { None } else { GrayImage::from_vec(image.width(), image.height(), alpha) }
}

/// The colours in 8 bits; those of the most common kind in their own memory.
fn into_rgb(image: DynamicImage) -> RgbImage {
    let (width, height) = (image.width(), image.height());
    let DynamicImage::ImageRgba8(rgba) = image else { return image.into_rgb8() };
    let mut bytes = rgba.into_raw();
    let pixels = width as usize * height as usize;
    for pixel in 0..pixels {
        bytes.copy_within(4 * pixel..4 * pixel + 3, 3 * pixel);
    }
    bytes.truncate(3 * pixels);
    bytes.shrink_to_fit();
    // Three bytes per pixel are what was kept.
    RgbImage::from_vec(width, height, bytes).unwrap_or_default()
}

/// The brightest colour channel of each pixel, in as many bits as the picture has.
fn brightest_channel(image: DynamicImage) -> Vec<u16> {
    fn brightest<const N: usize, T: Copy + Ord + Into<u16>>(channels: [T; N]) -> u16 {
        channels.into_iter().max().map_or(0, Into::into)
    }
    match image {
        DynamicImage::ImageLuma8(image) => image.pixels().map(|p| u16::from(p.0[0])).collect(),
        DynamicImage::ImageLumaA8(image) => image.pixels().map(|p| u16::from(p.0[0])).collect(),
        DynamicImage::ImageLuma16(image) => image.pixels().map(|p| p.0[0]).collect(),
        DynamicImage::ImageLumaA16(image) => image.pixels().map(|p| p.0[0]).collect(),
        DynamicImage::ImageRgb8(image) => image.pixels().map(|p| brightest(p.0)).collect(),
        DynamicImage::ImageRgba8(image) => image.pixels().map(|p| brightest([p.0[0], p.0[1], p.0[2]])).collect(),
        DynamicImage::ImageRgba16(image) => image.pixels().map(|p| brightest([p.0[0], p.0[1], p.0[2]])).collect(),
        image => image.into_rgb16().pixels().map(|p| brightest(p.0)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use image::Rgba;

    use super::*;

    #[test]
    fn a_png_comes_back_and_a_truncated_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let image = RgbImage::from_fn(7, 5, |u, v| Rgb([u as u8 * 30, v as u8 * 50, 200]));
        write_rgb_png(&path, &image).unwrap();
        let photo = read_photo(&path).unwrap();
        assert_eq!(photo.image, image);
        assert!(photo.alpha.is_none());
        let bytes = std::fs::read(&path).unwrap();
        for length in 0..bytes.len() - 12 {
            // The last twelve bytes are the end marker, without which every pixel is still there.
            std::fs::write(&path, &bytes[..length]).unwrap();
            let error = read_photo(&path).unwrap_err();
            assert!(matches!(error, Error::Format { .. }), "{length} of {} bytes: {error}", bytes.len());
        }
    }

    #[test]
    fn alpha_is_a_mask_only_where_something_is_transparent() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write_rgba_png(&path, &RgbaImage::from_pixel(3, 2, Rgba([9, 8, 7, 255]))).unwrap();
        assert!(read_photo(&path).unwrap().alpha.is_none());
        write_rgba_png(&path, &RgbaImage::from_fn(3, 2, |u, _| Rgba([9, 8, 7, if u == 1 { 255 } else { 100 }])))
            .unwrap();
        let photo = read_photo(&path).unwrap();
        assert_eq!(photo.image.get_pixel(0, 0), &Rgb([9, 8, 7]), "colours are not multiplied by alpha");
        let alpha = photo.alpha.unwrap();
        assert_eq!((alpha.object_pixels(), alpha.coverage.get_pixel(0, 1).0[0]), (2, 100));
        assert_eq!(read_mask(&path).unwrap(), alpha);
    }

    #[test]
    fn masks_of_every_kind_say_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let inside = |u: u32, v: u32| u > v;
        let expected = Mask::from(GrayImage::from_fn(6, 4, |u, v| Luma([if inside(u, v) { 255 } else { 0 }])));
        let gray = |full: u8| GrayImage::from_fn(6, 4, |u, v| Luma([if inside(u, v) { full } else { 0 }]));
        let deep = |full: u16| {
            ImageBuffer::<Luma<u16>, Vec<u16>>::from_fn(6, 4, |u, v| Luma([if inside(u, v) { full } else { 0 }]))
        };
        let kinds: [DynamicImage; 7] = [
            gray(255).into(),
            gray(1).into(),
            deep(65535).into(),
            deep(1).into(),
            deep(255).into(),
            RgbImage::from_fn(6, 4, |u, v| Rgb(if inside(u, v) { [0, 255, 9] } else { [0; 3] })).into(),
            RgbaImage::from_fn(6, 4, |u, v| Rgba(if inside(u, v) { [255, 255, 255, 255] } else { [0, 0, 0, 255] }))
                .into(),
        ];
        for (i, kind) in kinds.into_iter().enumerate() {
            let path = folder.path().join(format!("{i}.png"));
            kind.save(&path).unwrap();
            assert_eq!(read_mask(&path).unwrap(), expected, "kind {i}");
        }
        let black = folder.path().join("black.png");
        write_gray_png(&black, &GrayImage::new(3, 3)).unwrap();
        assert_eq!(read_mask(&black).unwrap().object_pixels(), 0);
    }

    #[test]
    fn sixteen_bits_are_rounded_to_eight() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep.png");
        ImageBuffer::<Rgb<u16>, Vec<u16>>::from_pixel(2, 2, Rgb([65535, 257 * 100, 0])).save(&path).unwrap();
        assert_eq!(read_rgb(&path).unwrap().get_pixel(1, 1), &Rgb([255, 100, 0]));
    }

    #[test]
    fn a_truncated_jpeg_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        RgbImage::from_fn(70, 50, |u, v| Rgb([u as u8 * 3, v as u8 * 5, (u * v) as u8])).save(&path).unwrap();
        assert_eq!(read_rgb(&path).unwrap().dimensions(), (70, 50));
        let bytes = std::fs::read(&path).unwrap();
        for length in 0..bytes.len() {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(matches!(read_rgb(&path), Err(Error::Format { .. })), "{length} of {} bytes", bytes.len());
        }
    }

    /// An EXIF block in little endian with one tag, the orientation.
    fn oriented(orientation: u8) -> Vec<u8> {
        let mut block = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
        block.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
        block
    }

    #[test]
    fn a_photograph_that_was_taken_sideways_is_turned_where_that_is_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        let image = RgbImage::from_fn(32, 16, |u, _| Rgb(if u < 16 { [250; 3] } else { [5; 3] }));
        write_jpeg(&path, &image, 98, Some(&oriented(6))).unwrap();
        assert_eq!(read_rgb(&path).unwrap().dimensions(), (32, 16), "calibrations mean the pixels as they are");
        let upright = upright_photo(&path, &std::fs::read(&path).unwrap()).unwrap();
        assert!(upright.orientation == Orientation::Rotate90 && upright.is_plain);
        assert_eq!(upright.photo.image.dimensions(), (16, 32));
        assert!(upright.photo.image.get_pixel(8, 2).0[0] > 200 && upright.photo.image.get_pixel(8, 29).0[0] < 50);
        // Written again with the block that is left, it stays as it is.
        write_jpeg(&path, &upright.photo.image, 98, upright.exif.as_deref()).unwrap();
        let again = upright_photo(&path, &std::fs::read(&path).unwrap()).unwrap();
        assert_eq!((again.orientation, again.photo.image.dimensions()), (Orientation::NoTransforms, (16, 32)));
    }

    #[test]
    fn pictures_that_other_programs_read_otherwise_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let is_plain = || upright_photo(&path, &std::fs::read(&path).unwrap()).unwrap().is_plain;
        write_rgb_png(&path, &RgbImage::new(3, 2)).unwrap();
        assert!(is_plain());
        write_rgba_png(&path, &RgbaImage::from_fn(3, 2, |u, _| Rgba([9, 8, 7, if u == 1 { 255 } else { 0 }]))).unwrap();
        assert!(!is_plain());
        ImageBuffer::<Rgb<u16>, Vec<u16>>::from_pixel(2, 2, Rgb([65535, 100, 0])).save(&path).unwrap();
        assert!(!is_plain());
    }

    #[test]
    fn text_is_not_an_image() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::fs::write(&path, "hello").unwrap();
        assert!(read_rgb(&path).unwrap_err().to_string().contains("a.png: the image cannot be read"));
    }
}
