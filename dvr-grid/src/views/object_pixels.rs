//! The pixels of a view as inner loops read them: many at once, without a branch for each.

use glam::Vec3;

use super::TrainingView;

/// A number that is not negative and less than 2^22, rounded down, and the same as an integer. A cast, which is right for
/// all numbers, would not be compiled to vectors.
#[inline(always)]
pub(super) fn rounded_down(value: f32) -> (f32, u32) {
    /// Numbers from here on to twice this are whole, and count in their lowest bits.
    const WHOLE: f32 = (1u32 << 23) as f32;
    let nearest = (value + WHOLE) - WHOLE;
    let down = nearest - if nearest > value { 1.0 } else { 0.0 };
    (down, (down + WHOLE).to_bits() & ((1 << 23) - 1))
}

/// The pixels of a view for inner loops.
pub(super) struct ObjectPixels<'a> {
    pub width: usize,
    colors: &'a [[u8; 3]],
    pub coverage: &'a [u8],
    /// Brightness by the levels of the channels, and at levels of zero.
    factors: Vec3,
    offset: f32,
}

impl<'a> ObjectPixels<'a> {
    /// None where the view has no mask.
    #[inline(always)]
    pub fn of(view: &'a TrainingView) -> Option<Self> {
        Some(Self {
            width: view.width as usize,
            colors: &view.colors,
            coverage: view.mask.as_ref()?.coverage.as_raw(),
            factors: view.exposure.scale() / (3.0 * 255.0),
            offset: view.exposure.offset().element_sum() / 3.0,
        })
    }

    /// Of a pixel, by its index.
    #[inline(always)]
    pub fn brightness(&self, index: usize) -> f32 {
        self.brightness_of(self.colors[index].map(f32::from))
    }

    /// Of the levels of the channels.
    #[inline(always)]
    pub fn brightness_of(&self, [red, green, blue]: [f32; 3]) -> f32 {
        self.factors.x * red + self.factors.y * green + self.factors.z * blue + self.offset
    }

    /// The colours of a pixel and the next one, red in the lowest byte.
    #[inline(always)]
    pub fn side_by_side(&self, index: usize) -> [u32; 2] {
        let bytes = self.colors.as_flattened();
        // Both at once, with two bytes more: before them where the photograph ends.
        let from = (3 * index).min(bytes.len().saturating_sub(8));
        match bytes[from..].first_chunk() {
            Some(word) => {
                let word = u64::from_le_bytes(*word) >> (8 * (3 * index - from));
                [word as u32 & 0xff_ffff, (word >> 24) as u32 & 0xff_ffff]
            }
            // Fewer than three pixels.
            None => [index, index + 1].map(|index| {
                let [red, green, blue] = self.colors[index];
                u32::from_le_bytes([red, green, blue, 0])
            }),
        }
    }

    /// The bits that the coverages of four pixels have in common: one, the next, and those below.
    #[inline(always)]
    pub fn common_coverage(&self, index: usize) -> u8 {
        let row = |at: usize| {
            let pair = &self.coverage[at..at + 2];
            pair[0] & pair[1]
        };
        row(index) & row(index + self.width)
    }

    /// Whether pixels show the object whose coverages have these bits in common: half of each at least.
    #[inline(always)]
    pub fn are_object(common: u8) -> bool {
        common & 0x80 != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_down_as_a_cast_does() {
        for value in [0.0, 0.4, 0.5, 0.999_999_9, 1.0, 1.5, 2.5, 3.499_999_8, 1_023.999_94, 65_535.5, 4_194_303.5] {
            assert_eq!(rounded_down(value), ((value as u32) as f32, value as u32), "{value}");
        }
    }

    #[test]
    fn pixels_side_by_side_are_read_up_to_the_end_of_the_photograph() {
        // One row, and the least that has four pixels around a place.
        for count in [2, 3, 4, 9] {
            let colors: Vec<[u8; 3]> = (0..count).map(|i| [10 * i, 10 * i + 1, 255 - i]).collect();
            let pixels =
                ObjectPixels { width: count.into(), colors: &colors, coverage: &[], factors: Vec3::ONE, offset: 0.0 };
            for index in 0..usize::from(count) - 1 {
                let expected = [index, index + 1].map(|index| {
                    let [red, green, blue] = colors[index];
                    u32::from_le_bytes([red, green, blue, 0])
                });
                assert_eq!(pixels.side_by_side(index), expected, "{index} of {count}");
            }
        }
    }
}
