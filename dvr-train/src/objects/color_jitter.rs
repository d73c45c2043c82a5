//! Objects in other colours, as further objects to learn from.

use image::RgbImage;
use rand::Rng;
use rand::seq::SliceRandom;

/// Colours in another order of channels, each channel brighter or darker: what tells shapes apart is then not which colours an
/// object has. White, which the encoder sees around objects, stays white.
#[derive(Clone, Debug)]
pub(crate) struct ColorJitter {
    /// The channel that each takes its values of.
    channels: [usize; 3],
    /// Their exponents.
    gamma: [f32; 3],
}

impl ColorJitter {
    /// Draws one: exponents are from `exp(-strength)` to `exp(strength)`. None where the strength is 0, and no random number is drawn.
    pub fn draw(strength: f64, rng: &mut impl Rng) -> Option<Self> {
        (strength > 0.0).then(|| {
            let mut channels = [0, 1, 2];
            channels.shuffle(rng);
            let gamma = [0; 3].map(|_| rng.random_range(-strength..=strength).exp() as f32);
            Self { channels, gamma }
        })
    }

    /// A colour, channels in `[0, 1]`.
    fn color(&self, color: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|channel| color[self.channels[channel]].powf(self.gamma[channel]))
    }

    /// Colours, three numbers each.
    pub fn colors(&self, colors: &mut [f32]) {
        for color in colors.as_chunks_mut().0 {
            *color = self.color(*color);
        }
    }

    /// A picture.
    pub fn picture(&self, picture: &mut RgbImage) {
        let table = self.gamma.map(|gamma| {
            std::array::from_fn::<u8, 256, _>(|value| ((value as f32 / 255.0).powf(gamma) * 255.0).round() as u8)
        });
        for pixel in picture.pixels_mut() {
            let before = pixel.0;
            pixel.0 = [0, 1, 2].map(|channel| table[channel][usize::from(before[self.channels[channel]])]);
        }
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn pictures_and_pixels_change_alike_and_white_and_black_stay() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut orders = std::collections::BTreeSet::new();
        for _ in 0..50 {
            let jitter = ColorJitter::draw(0.5, &mut rng).unwrap();
            orders.insert(jitter.channels);
            assert!(jitter.gamma.iter().all(|gamma| (0.6..=1.65).contains(gamma)));
            let colors = [[0u8; 3], [255; 3], [10, 120, 240], [77, 31, 5]];
            let mut picture = RgbImage::from_fn(4, 1, |x, _| Rgb(colors[x as usize]));
            let mut pixels: Vec<f32> = colors.iter().flatten().map(|value| f32::from(*value) / 255.0).collect();
            jitter.picture(&mut picture);
            jitter.colors(&mut pixels);
            for (of_picture, of_pixels) in picture.as_raw().iter().zip(&pixels) {
                assert!((f32::from(*of_picture) / 255.0 - of_pixels).abs() <= 0.5 / 255.0 + 1e-6);
            }
            assert_eq!(picture.as_raw()[..6], [0, 0, 0, 255, 255, 255]);
        }
        assert_eq!(orders.len(), 6);
    }

    #[test]
    fn without_strength_nothing_is_drawn() {
        let (mut rng, mut untouched) = (ChaCha8Rng::seed_from_u64(3), ChaCha8Rng::seed_from_u64(3));
        assert!(ColorJitter::draw(0.0, &mut rng).is_none());
        assert_eq!(rng.random::<u64>(), untouched.random::<u64>());
    }
}
