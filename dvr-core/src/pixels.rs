//! Where the pixels of photographs and masks lie: in memory, or in a scratch file that the system pages in.

use std::fmt;
use std::ops::{Deref, DerefMut};

use image::{ImageBuffer, Luma, Pixel, Rgb};

use crate::files::ScratchBytes;

/// 8-bit RGB, wherever its pixels lie.
pub type Picture = ImageBuffer<Rgb<u8>, PixelStore>;

/// 8-bit grey, wherever its pixels lie.
pub type GrayPicture = ImageBuffer<Luma<u8>, PixelStore>;

/// The bytes of an image. They read the same wherever they lie; writing to bytes in a scratch file brings them into
/// memory first.
#[derive(Clone)]
pub enum PixelStore {
    /// In memory.
    Memory(Vec<u8>),
    /// In a scratch file, for scenes larger than memory: see [`ReadOptions::max_memory`](crate::dataset::ReadOptions).
    Scratch(ScratchBytes),
}

/// The image with its pixels in a [`PixelStore`]; nothing is copied.
pub fn stored<P: Pixel<Subpixel = u8>>(image: ImageBuffer<P, Vec<u8>>) -> ImageBuffer<P, PixelStore> {
    let (width, height) = image.dimensions();
    with_pixels(width, height, PixelStore::Memory(image.into_raw()))
}

/// The image of this size whose pixels `store` holds.
pub(crate) fn with_pixels<P: Pixel<Subpixel = u8>>(
    width: u32,
    height: u32,
    store: PixelStore,
) -> ImageBuffer<P, PixelStore> {
    debug_assert!(store.len() >= width as usize * height as usize * usize::from(P::CHANNEL_COUNT));
    ImageBuffer::from_raw(width, height, store).unwrap_or_default()
}

impl PixelStore {
    /// Whether the bytes lie in a scratch file.
    pub fn is_paged(&self) -> bool {
        matches!(self, Self::Scratch(_))
    }
}

impl Default for PixelStore {
    fn default() -> Self {
        Self::Memory(Vec::new())
    }
}

impl From<Vec<u8>> for PixelStore {
    fn from(bytes: Vec<u8>) -> Self {
        Self::Memory(bytes)
    }
}

impl Deref for PixelStore {
    type Target = [u8];

    #[inline]
    fn deref(&self) -> &[u8] {
        match self {
            Self::Memory(bytes) => bytes,
            Self::Scratch(bytes) => bytes,
        }
    }
}

impl DerefMut for PixelStore {
    fn deref_mut(&mut self) -> &mut [u8] {
        if let Self::Scratch(bytes) = self {
            *self = Self::Memory(bytes.to_vec());
        }
        match self {
            Self::Memory(bytes) => bytes,
            Self::Scratch(_) => unreachable!("brought into memory above"),
        }
    }
}

impl PartialEq for PixelStore {
    fn eq(&self, other: &Self) -> bool {
        self[..] == other[..]
    }
}

impl fmt::Debug for PixelStore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = match self {
            Self::Memory(_) => "memory",
            Self::Scratch(_) => "a scratch file",
        };
        write!(f, "{} bytes in {place}", self.len())
    }
}
