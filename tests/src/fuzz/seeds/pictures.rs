//! Pictures and depth maps.

use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder,
    Vec2, WritableImage, f16,
};
use image::{DynamicImage, ImageFormat, Luma, RgbaImage};

/// A small picture with something on it.
pub(in crate::fuzz) fn picture(width: u32, height: u32) -> RgbaImage {
    RgbaImage::from_fn(width, height, |u, v| {
        let inside = (width / 4..3 * width / 4).contains(&u) && (height / 4..3 * height / 4).contains(&v);
        image::Rgba([(20 * u) as u8, (30 * v) as u8, 128, if inside { 255 } else { 0 }])
    })
}

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap_or_else(|e| panic!("{format:?}: {e}"));
    bytes.into_inner()
}

pub(in crate::fuzz) fn png() -> Vec<Vec<u8>> {
    let rgba = DynamicImage::ImageRgba8(picture(9, 7));
    let truth = image::ImageBuffer::<Luma<u8>, _>::from_fn(9, 7, |u, _| Luma([(u % 2) as u8]));
    let images = [
        DynamicImage::ImageRgb8(rgba.to_rgb8()),
        DynamicImage::ImageLuma8(rgba.to_luma8()),
        DynamicImage::ImageLuma8(truth),
        DynamicImage::ImageRgb16(rgba.to_rgb16()),
        DynamicImage::ImageLuma16(rgba.to_luma16()),
        rgba,
    ];
    images.iter().map(|image| encoded(image, ImageFormat::Png)).collect()
}

pub(in crate::fuzz) fn jpeg() -> Vec<Vec<u8>> {
    let rgb = DynamicImage::ImageRgba8(picture(17, 11)).to_rgb8();
    let gray = DynamicImage::ImageRgb8(rgb.clone()).to_luma8();
    [DynamicImage::ImageRgb8(rgb), DynamicImage::ImageLuma8(gray)]
        .iter()
        .map(|image| encoded(image, ImageFormat::Jpeg))
        .collect()
}

pub(in crate::fuzz) fn others() -> Vec<Vec<u8>> {
    let rgba = DynamicImage::ImageRgba8(picture(9, 7));
    let rgb = DynamicImage::ImageRgb8(rgba.to_rgb8());
    let formats = [ImageFormat::WebP, ImageFormat::Bmp, ImageFormat::Tiff, ImageFormat::Gif];
    formats.iter().flat_map(|&format| [encoded(&rgba, format), encoded(&rgb, format)]).collect()
}

pub(in crate::fuzz) fn exr() -> Vec<Vec<u8>> {
    let depth: Vec<f32> = (0..63).map(|i| if i % 3 == 0 { f32::INFINITY } else { 1.0 + i as f32 / 7.0 }).collect();
    let half: Vec<f16> = depth.iter().map(|&z| f16::from_f32(z)).collect();
    let single = |name: &str| AnyChannel::new(name, FlatSamples::F32(depth.clone()));
    let compressions =
        [Compression::Uncompressed, Compression::RLE, Compression::ZIP16, Compression::PIZ, Compression::PXR24];
    let lines = compressions.map(|compression| exr_file(vec![single("Z")], compression, Blocks::ScanLines));
    let colors = ["B", "G", "R"].map(|name| AnyChannel::new(name, FlatSamples::F16(half.clone())));
    let tiles = exr_file(colors.into(), Compression::ZIP1, Blocks::Tiles(Vec2(4, 4)));
    lines.into_iter().chain([tiles]).collect()
}

/// An OpenEXR file with so many channels, its size changed to 20 000 x 20 000.
pub(in crate::fuzz) fn picture_of_channels(count: usize) -> Vec<u8> {
    let half = || FlatSamples::F16(vec![f16::from_f32(1.0); 63]);
    let channels = (0..count).map(|i| AnyChannel::new(format!("c{i:04}").as_str(), half())).collect();
    let mut bytes = exr_file(channels, Compression::ZIP16, Blocks::ScanLines);
    for window in ["dataWindow\0box2i\0", "displayWindow\0box2i\0"] {
        let at = bytes.windows(window.len()).position(|bytes| bytes == window.as_bytes());
        let end = at.unwrap_or_else(|| panic!("there is no {window}")) + window.len() + 12;
        bytes[end..end + 8].copy_from_slice(&[19_999i32; 2].map(i32::to_le_bytes).concat());
    }
    bytes
}

/// An OpenEXR file of 9 x 7 pixels.
fn exr_file(channels: Vec<AnyChannel<FlatSamples>>, compression: Compression, blocks: Blocks) -> Vec<u8> {
    let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
    let layer = Layer::new((9, 7), LayerAttributes::default(), encoding, AnyChannels::sort(channels.into()));
    let mut bytes = Cursor::new(Vec::new());
    let written = Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes);
    written.unwrap_or_else(|e| panic!("{compression:?}: {e}"));
    bytes.into_inner()
}
