//! OpenEXR: depth maps of the DVR datasets, and renders in floating point.

use std::io::Cursor;
use std::path::Path;

use exr::block::chunk::CompressedBlock;
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{
    AnyChannel, AnyChannels, FlatSamples, Image, ReadChannels, ReadLayers, WritableImage, read as read_exr,
};
use image::Rgb32FImage;

use super::limits::{EXR_BYTES, check_limit};
use super::{read_bytes, write_bytes_atomically};
use crate::error::{Error, Result};
use crate::raster::DepthMap;

/// Depths from here on mean "nothing there"; Blender writes 1e10 for the background.
const FAR: f32 = 1e9;

/// Reads a depth map: the channel named `Z`, `depth` or `V` (Blender), else the first one, in half or single precision.
///
/// Whatever the file writes for the background (infinity, NaN, 0, a negative number, or 1e9 and more) becomes `+inf`.
/// Units are the file's.
///
/// # Errors
/// [`Error::Io`] where the file cannot be opened, [`Error::Format`] where it is damaged or holds no usable channel,
/// [`Error::TooLarge`] where its channels have more than [`EXR_BYTES`].
pub fn read_depth_exr(path: &Path) -> Result<DepthMap> {
    let bytes = read_bytes(path)?;
    let damaged = |what: String| {
        Error::format(
            path,
            format!("the depth map cannot be read ({what})"),
            "The file may be truncated: copy it again, or write it as a single-layer OpenEXR file.",
        )
    };
    let meta = MetaData::read_from_buffered(Cursor::new(&bytes), false).map_err(|e| damaged(e.to_string()))?;
    for header in &meta.headers {
        let (width, height) = (header.layer_size.width() as u64, header.layer_size.height() as u64);
        let bytes_per_pixel = header.channels.bytes_per_pixel.max(1) as u64;
        let size = width.saturating_mul(height).saturating_mul(bytes_per_pixel);
        check_limit(path, "the size of all channels in bytes", size, EXR_BYTES)?;
    }
    check_tiles(&bytes, &meta).map_err(damaged)?;
    let image = read_exr()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(&bytes))
        .map_err(|error| damaged(error.to_string()))?;
    let (width, height) = (image.layer_data.size.width(), image.layer_data.size.height());
    let mut channels = image.layer_data.channel_data.list;
    if channels.is_empty() {
        return Err(damaged("it has no channel".to_owned()));
    }
    let named = |name: &str| channels.iter().position(|c| c.name.to_string().to_lowercase() == name);
    let chosen = ["z", "depth", "v"].iter().find_map(|name| named(name)).unwrap_or(0);
    let channel = channels.swap_remove(chosen);
    drop(channels);
    let z_depth: Vec<f32> =
        channel.sample_data.values_as_f32().map(|z| if z > 0.0 && z < FAR { z } else { f32::INFINITY }).collect();
    if width == 0 || height == 0 || z_depth.len() != width * height {
        return Err(damaged(format!("{} samples for {width}x{height} pixels", z_depth.len())));
    }
    // EXR_BYTES bounds both numbers.
    Ok(DepthMap { width: width as u32, height: height as u32, z_depth })
}

/// Refuses tiles of smaller versions of the image where the table of contents has those of the image itself: the `exr`
/// crate takes the table's word.
fn check_tiles(bytes: &[u8], meta: &MetaData) -> std::result::Result<(), String> {
    if meta.headers.iter().all(|header| header.blocks == BlockDescription::ScanLines) {
        return Ok(());
    }
    let chunks = exr::block::read(Cursor::new(bytes), false)
        .and_then(|reader| reader.filter_chunks(false, |_, tile, _| tile.is_largest_resolution_level()));
    for chunk in chunks.map_err(|error| error.to_string())? {
        let chunk = chunk.map_err(|error| error.to_string())?;
        if let CompressedBlock::Tile(tile) = chunk.compressed_block
            && !tile.coordinates.is_largest_resolution_level()
        {
            return Err("a tile is of another size than its table says".to_owned());
        }
    }
    Ok(())
}

/// Writes a depth map as the DVR datasets have it: the depth in each of `B`, `G`, `R`, single precision, background
/// `+inf`. The original reads the first of the three.
///
/// # Errors
/// [`Error::Io`] where the file cannot be written.
pub fn write_depth_exr(path: &Path, depth: &DepthMap) -> Result<()> {
    let channel = |name: &str| AnyChannel::new(name, FlatSamples::F32(depth.z_depth.clone()));
    write_channels(path, (depth.width, depth.height), ["B", "G", "R"].map(channel).into())
}

/// Writes linear RGB in single precision.
///
/// # Errors
/// [`Error::Io`] where the file cannot be written.
pub fn write_rgb_exr(path: &Path, image: &Rgb32FImage) -> Result<()> {
    let channel = |(name, index): (&str, usize)| {
        AnyChannel::new(name, FlatSamples::F32(image.pixels().map(|p| p.0[index]).collect()))
    };
    write_channels(path, image.dimensions(), [("B", 2), ("G", 1), ("R", 0)].map(channel).into())
}

fn write_channels(path: &Path, (width, height): (u32, u32), channels: Vec<AnyChannel<FlatSamples>>) -> Result<()> {
    let attributes = exr::image::Encoding::SMALL_LOSSLESS;
    let layer = exr::image::Layer::new(
        (width as usize, height as usize),
        exr::meta::header::LayerAttributes::default(),
        attributes,
        AnyChannels::sort(channels.into()),
    );
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|error| Error::io(path, std::io::Error::other(error)))?;
    write_bytes_atomically(path, bytes.get_ref())
}

#[cfg(test)]
mod tests {
    use exr::prelude::f16;

    use super::*;

    fn depth() -> DepthMap {
        let z_depth = (0..35).map(|i| if i % 3 == 0 { f32::INFINITY } else { 1.0 + i as f32 / 7.0 }).collect();
        DepthMap { width: 7, height: 5, z_depth }
    }

    #[test]
    fn a_depth_map_comes_back_exactly() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_depth_exr(&path, &depth()).unwrap();
        assert_eq!(read_depth_exr(&path).unwrap(), depth());
    }

    #[test]
    fn a_truncated_depth_map_is_refused_wherever_it_ends() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_depth_exr(&path, &depth()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for length in 0..bytes.len() {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(matches!(read_depth_exr(&path), Err(Error::Format { .. })), "{length} bytes");
        }
    }

    #[test]
    fn a_damaged_byte_gives_an_error_or_an_image_but_no_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_depth_exr(&path, &depth()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let mut refused = 0;
        for index in 0..bytes.len() {
            for flip in [0x80, 0xff] {
                let mut damaged = bytes.clone();
                damaged[index] ^= flip;
                std::fs::write(&path, &damaged).unwrap();
                refused += usize::from(read_depth_exr(&path).is_err());
            }
        }
        assert!(refused > 20, "only {refused} damaged files were noticed");
    }

    #[test]
    fn every_kind_of_background_is_infinitely_far() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let values = [0.0, -1.0, f32::NAN, f32::INFINITY, 1e10, 2.5];
        let half = values.iter().map(|&z| f16::from_f32(z)).collect();
        for samples in [FlatSamples::F32(values.to_vec()), FlatSamples::F16(half)] {
            write_channels(&path, (3, 2), vec![AnyChannel::new("view.Depth", samples)]).unwrap();
            let depth = read_depth_exr(&path).unwrap().z_depth;
            assert!(depth[..5].iter().all(|z| *z == f32::INFINITY) && depth[5] == 2.5, "{depth:?}");
        }
    }

    #[test]
    fn the_depth_channel_is_found_among_colours() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let channels = ["B", "G", "R", "Z"].map(|name| {
            let value = if name == "Z" { 4.0 } else { 1.0 };
            AnyChannel::new(name, FlatSamples::F32(vec![value; 4]))
        });
        write_channels(&path, (2, 2), channels.into()).unwrap();
        assert_eq!(read_depth_exr(&path).unwrap().z_depth, [4.0; 4]);
    }

    #[test]
    fn a_float_render_keeps_its_colours() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let image = Rgb32FImage::from_fn(3, 2, |u, v| image::Rgb([u as f32, v as f32 + 0.25, -1.5]));
        write_rgb_exr(&path, &image).unwrap();
        let back = exr::prelude::read_first_flat_layer_from_file(&path).unwrap();
        let of = |name: &str| {
            let channel = back.layer_data.channel_data.list.iter().find(|c| c.name.to_string() == name).unwrap();
            channel.sample_data.values_as_f32().collect::<Vec<_>>()
        };
        assert_eq!(of("R"), [0.0, 1.0, 2.0, 0.0, 1.0, 2.0]);
        assert_eq!(of("G"), [0.25, 0.25, 0.25, 1.25, 1.25, 1.25]);
        assert_eq!(of("B"), [-1.5; 6]);
    }
}
