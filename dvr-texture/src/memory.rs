//! What a texture takes of memory while it is made, and how large one may be.

use dvr_core::{View, available_memory};
use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::auto_size::{COVER, LEAST, power_of_two};
use crate::error::TextureError;
use crate::settings::{TextureSettings, TextureSize};
use crate::solve::Sample;
use crate::view_buffer::{ViewBuffer, stride};

/// Bytes of a texel: its colour, and the levels that fill what is not seen, which take four thirds of the first. Steps of
/// the least squares and a normal map take no more. Ten are to spare.
pub(crate) const TEXEL: u64 = (size_of::<Vec3>() + size_of::<Vec4>() * 4 / 3 + 1 + 10) as u64;

/// Bytes of a cell of a z-buffer: depth and face.
const CELL: u64 = (size_of::<f32>() + size_of::<u32>()) as u64;

/// Bytes of a pixel on the texture. Half as much again is there while some photographs put theirs into the order of bands.
const PIXEL: u64 = (size_of::<Sample>() * 3 / 2) as u64;

/// The surface of an object in parts of what a photograph shows of it: twice the four (Cauchy) that it is of a convex one
/// in the mean over all sides.
const SURFACE: f64 = 8.0;

/// Widest cells that an automatic texture is made from where memory is short, in pixels.
const MAX_STRIDE: u32 = 16;

/// What textures from some photographs take, and what they may.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TextureMemory {
    /// Pixels along the edge of a cell, of which each gives the texture a colour.
    pub stride: u32,
    /// Bytes of what photographs see, whatever the texture's size.
    pixels: u64,
    /// The automatic size, as far as it can be told without the mesh.
    expected: u32,
    /// Bytes that there are.
    allowed: u64,
}

impl TextureMemory {
    /// Of textures from these views, with so many bytes for all. Where the size is automatic, cells are widened until
    /// what photographs see takes no more than half of them.
    pub fn new(views: &[&View], settings: &TextureSettings, allowed: u64) -> Self {
        // What lies off the mask gives no colours; a view without a mask may show the mesh anywhere.
        let shown = |view: &&View| {
            let all = u64::from(view.camera.width) * u64::from(view.camera.height);
            view.training_mask().map_or(all, |mask| mask.object_pixels() as u64)
        };
        let shown: u64 = views.par_iter().map(shown).sum();
        let cells = |stride: u32| -> u64 {
            let of = |view: &&View| ViewBuffer::cells(&view.camera, stride).map(u64::from).iter().product::<u64>();
            views.iter().map(of).sum()
        };
        let pixels = |stride: u32| CELL * cells(stride) + PIXEL * shown.div_ceil(u64::from(stride).pow(2));
        let surface = SURFACE * shown as f64 / views.len().max(1) as f64;
        let edge = (surface / COVER).sqrt();
        let mut stride = match settings.size {
            TextureSize::Auto => stride(views),
            // Cells about as wide as its texels, as far as that can be told without the mesh.
            TextureSize::Texels(size) => ((edge / f64::from(size)) as u32).clamp(1, stride(views)),
        };
        let is_short = |at: u32| match settings.size {
            TextureSize::Auto => at < MAX_STRIDE && pixels(at) > allowed / 2,
            TextureSize::Texels(size) => {
                at < self::stride(views) && TEXEL * u64::from(size).pow(2) + pixels(at) > allowed
            }
        };
        while is_short(stride) {
            stride += 1;
        }
        Self { stride, pixels: pixels(stride), expected: power_of_two(edge / f64::from(stride)), allowed }
    }

    /// The same, with no more bytes than the machine has.
    pub fn on_this_machine(views: &[&View], settings: &TextureSettings) -> Self {
        let allowed = available_memory().map_or(settings.max_bytes, |bytes| bytes.min(settings.max_bytes));
        Self::new(views, settings, allowed)
    }

    /// Bytes that a texture of this size takes.
    fn needed(&self, size: u32) -> u64 {
        TEXEL * u64::from(size).pow(2) + self.pixels
    }

    /// Halves a size until there is memory for it, down to the least that is chosen.
    pub fn fitting(&self, mut size: u32) -> u32 {
        while size > LEAST && self.needed(size) > self.allowed {
            size /= 2;
        }
        size
    }

    /// Whether there is memory for a texture of this size.
    ///
    /// # Errors
    /// [`TextureError::Memory`] where there is not.
    pub fn check(&self, size: u32) -> Result<(), TextureError> {
        let (needed, allowed) = (self.needed(size), self.allowed);
        if needed > allowed { Err(TextureError::Memory { size, needed, allowed }) } else { Ok(()) }
    }
}

impl TextureSettings {
    /// Bytes that a texture from these views takes while it is made, at most, about, beside the photographs and the mesh:
    /// 44 per texel, 8 per pixel of the photographs (of those beyond 64 million, cells of several pixels), and 30 per
    /// pixel that shows the object.
    ///
    /// An automatic size follows from the mesh, which is not known here: it is taken for that of an object with twice the
    /// surface of a convex one, made from wider cells and halved until it is within [`TextureSettings::max_bytes`].
    pub fn memory_estimate(&self, views: &[&View]) -> u64 {
        let memory = TextureMemory::new(views, self, self.max_bytes);
        memory.needed(self.size_where(memory.fitting(memory.expected)))
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::{Camera, Mask, stored};
    use glam::DVec3;
    use image::{GrayImage, Luma, RgbImage};

    use super::*;

    /// A view of 100 x 80 pixels whose left `columns` show the object, or one without a mask.
    fn view(columns: Option<u32>) -> View {
        let camera = Camera::look_at(100, 80, 100.0, 2.0 * DVec3::Z, DVec3::ZERO, DVec3::Y);
        let mask = |columns: u32| GrayImage::from_fn(100, 80, |u, _| Luma([if u < columns { 255 } else { 0 }]));
        View::new("view", camera, stored(RgbImage::new(100, 80)), columns.map(|columns| Mask::from(mask(columns))))
    }

    fn settings(size: TextureSize, max_bytes: u64) -> TextureSettings {
        TextureSettings { size, max_bytes, ..TextureSettings::default() }
    }

    #[test]
    fn the_estimate_grows_with_texels_pixels_and_what_shows_the_object() {
        let of = |size: u32, views: &[&View]| settings(TextureSize::Texels(size), u64::MAX).memory_estimate(views);
        let (quarter, half, all) = (view(Some(25)), view(Some(50)), view(None));
        assert_eq!((TEXEL, CELL, PIXEL), (44, 8, 30));
        assert_eq!(of(256, &[]), 44 * 256 * 256);
        assert_eq!(of(512, &[&quarter]), 44 * 512 * 512 + 8 * 8000 + 30 * 2000);
        assert_eq!(of(512, &[&quarter, &half]), 44 * 512 * 512 + 8 * 16_000 + 30 * 6000);
        assert_eq!(of(512, &[&all]), 44 * 512 * 512 + 38 * 8000, "a view without a mask may show the mesh anywhere");
    }

    #[test]
    fn many_pixels_share_cells() {
        let camera = |side: u32| Camera { width: side, height: side, ..view(None).camera };
        let large = |side: u32| View { camera: camera(side), ..view(None) };
        let (eight, nine) = (large(8000), large(9000));
        assert_eq!((stride(&[&eight]), stride(&[&nine])), (1, 2));
        let memory = TextureMemory::new(&[&nine], &TextureSettings::default(), u64::MAX);
        assert_eq!(memory.pixels, 38 * 4500 * 4500);
        // Twice 80 megapixels, of which a hundredth shows the object.
        let camera = Camera { width: 10_000, height: 8000, ..view(None).camera };
        let mask = Mask::from(GrayImage::from_pixel(1000, 800, Luma([255])));
        let small = View::new("small", camera, stored(RgbImage::new(1, 1)), mask);
        let within = |size, allowed| TextureMemory::new(&[&small, &small], &settings(size, u64::MAX), allowed);
        let of = |size: TextureSize| within(size, u64::MAX);
        let auto = of(TextureSize::Auto);
        assert_eq!((auto.stride, auto.expected), (2, 2048), "4000 texels of a pixel, 2000 of a cell");
        let asked = [1024, 2048, 4096].map(|size| of(TextureSize::Texels(size)).stride);
        assert_eq!(asked, [2, 1, 1], "as fine as what is asked for");
        let needed = of(TextureSize::Texels(4096)).needed(4096);
        let strides = [needed, needed - 1, 0].map(|allowed| within(TextureSize::Texels(4096), allowed).stride);
        assert_eq!(strides, [1, 2, 2], "no finer than there is memory for");
    }

    #[test]
    fn an_automatic_size_is_halved_until_it_fits() {
        // Eight times 8000 pixels on two fifths of the texture: 400 texels along the edge.
        let whole = view(Some(100));
        let of = |max_bytes: u64| settings(TextureSize::Auto, max_bytes).memory_estimate(&[&whole]);
        let pixels = 38 * 8000;
        let texture = |size: u64| 44 * size * size + pixels;
        assert_eq!([u64::MAX, texture(512), texture(512) - 1].map(of), [512, 512, 256].map(texture));
        let memory = TextureMemory::new(&[&whole], &TextureSettings::default(), texture(2048));
        assert_eq!([8192, 4096, 2048, 256].map(|size| memory.fitting(size)), [2048, 2048, 2048, 256]);
    }

    #[test]
    fn cells_are_widened_where_pixels_take_more_than_half_of_the_memory() {
        let whole = view(Some(100));
        let of = |allowed: u64| TextureMemory::new(&[&whole], &TextureSettings::default(), allowed);
        // Cells of 1, 2 and 3 pixels: 38 bytes each, and at the border of three pixels some that are not full.
        let pixels = [38 * 8000, 38 * 2000, 8 * 34 * 27 + 30 * 889];
        for (k, pixels) in pixels.into_iter().enumerate() {
            let memory = of(2 * pixels);
            assert_eq!((memory.stride as usize, memory.pixels), (k + 1, pixels));
            assert_eq!(of(2 * pixels - 1).stride as usize, k + 2);
        }
        assert_eq!(of(0).stride, MAX_STRIDE);
        let asked = TextureMemory::new(&[&whole], &settings(TextureSize::Texels(512), 0), 0);
        assert_eq!(asked.stride, 1, "a size that was asked for is made from all pixels, or not at all");
    }

    #[test]
    fn what_does_not_fit_is_refused_with_both_figures() {
        let whole = view(Some(100));
        let needed = 44 * 512 * 512 + 38 * 8000;
        let asked = settings(TextureSize::Texels(512), u64::MAX);
        assert!(TextureMemory::new(&[&whole], &asked, needed).check(512).is_ok());
        let error = TextureMemory::new(&[&whole], &asked, needed - 1).check(512).unwrap_err();
        let TextureError::Memory { size, needed: found, allowed } = error else { panic!("{error}") };
        assert_eq!((size, found, allowed), (512, needed, needed - 1));
        assert!(error.to_string().contains("11 MB"), "{error}");
    }
}
