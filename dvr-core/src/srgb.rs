//! The sRGB transfer function (IEC 61966-2-1), for values in `[0, 1]`.
//!
//! Everything in this crate holds sRGB colours as files do. Light adds up in linear space only, so shading, averaging
//! and glTF's vertex colours go through here.

/// Linear light of an sRGB value.
pub fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// The sRGB value of linear light.
pub fn linear_to_srgb(value: f32) -> f32 {
    if value <= 0.003_130_8 { value * 12.92 } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_linear_space() {
        for byte in 0..=255u8 {
            let value = f32::from(byte) / 255.0;
            let back = linear_to_srgb(srgb_to_linear(value));
            assert_eq!((back * 255.0).round() as u8, byte);
        }
    }

    #[test]
    fn middle_grey_is_a_fifth_of_the_light() {
        assert!((srgb_to_linear(0.5) - 0.2140).abs() < 1e-4);
    }
}
