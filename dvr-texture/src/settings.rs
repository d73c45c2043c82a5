//! How a texture is made.

use crate::error::TextureError;

/// Texels along the edge of a texture, at least and at most.
pub const SIZES: std::ops::RangeInclusive<u32> = 128..=16_384;

/// How many texels a texture has along its edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TextureSize {
    /// The power of two from 256 to 8192 at which texels are about as large as the pixels of the photographs that show
    /// their places best, and no larger in textures of up to 2048.
    #[default]
    Auto,
    /// So many, within [`SIZES`].
    Texels(u32),
}

impl TextureSize {
    /// Checks the number of texels.
    ///
    /// # Errors
    /// [`TextureError::Size`] where it is not within [`SIZES`].
    pub fn check(self) -> Result<(), TextureError> {
        match self {
            Self::Texels(size) if !SIZES.contains(&size) => {
                Err(TextureError::Size { size, least: *SIZES.start(), most: *SIZES.end() })
            }
            _ => Ok(()),
        }
    }
}

/// How a texture is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextureSettings {
    /// Its size.
    pub size: TextureSize,
    /// Steps of the least squares that make it agree with the photographs.
    pub steps: usize,
}

impl Default for TextureSettings {
    fn default() -> Self {
        Self { size: TextureSize::Auto, steps: 8 }
    }
}
