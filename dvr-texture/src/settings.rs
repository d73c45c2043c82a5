//! How a texture is made.

use crate::error::TextureError;

/// Texels along the edge of a texture, at least and at most.
pub const SIZES: std::ops::RangeInclusive<u32> = 128..=16_384;

/// How many texels a texture has along its edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TextureSize {
    /// The power of two from 256 to 8192 at which texels are about as large as the pixels of the photographs that show
    /// their places best, or as the cells of pixels that give colours where there are many: the larger one up to 2048, the
    /// nearer one beyond.
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
    /// The largest size that [`TextureSize::Auto`] chooses, within [`SIZES`].
    pub largest_auto: u32,
    /// Steps of the least squares that make it agree with the photographs.
    pub steps: usize,
    /// Bytes that it may take while it is made, beside the photographs and the mesh. Where that is little, a texture of
    /// automatic size is made from fewer pixels and gets smaller; another that does not fit is refused. What the machine
    /// has is a bound in any case.
    pub max_bytes: u64,
}

impl TextureSettings {
    /// Checks both sizes.
    pub(crate) fn check(&self) -> Result<(), TextureError> {
        self.size.check()?;
        TextureSize::Texels(self.largest_auto).check()
    }

    /// The texels along the edge where so many fit the photographs.
    pub(crate) fn size_where(&self, fitting: u32) -> u32 {
        match self.size {
            TextureSize::Texels(size) => size,
            TextureSize::Auto => fitting.min(self.largest_auto),
        }
    }
}

impl Default for TextureSettings {
    fn default() -> Self {
        Self { size: TextureSize::Auto, largest_auto: *SIZES.end(), steps: 4, max_bytes: u64::MAX }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_holds_for_the_size_that_is_chosen_and_not_for_one_that_was_asked_for() {
        let auto = TextureSettings { largest_auto: 2048, ..TextureSettings::default() };
        assert_eq!([512, 2048, 8192].map(|fitting| auto.size_where(fitting)), [512, 2048, 2048]);
        assert_eq!(TextureSettings { size: TextureSize::Texels(4096), ..auto }.size_where(512), 4096);
        assert_eq!(TextureSettings::default().size_where(8192), 8192);
        assert!(auto.check().is_ok() && TextureSettings { largest_auto: 64, ..auto }.check().is_err());
    }
}
