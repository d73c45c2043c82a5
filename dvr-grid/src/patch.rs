//! The normalised cross-correlation of two patches.

/// Samples of a patch less their mean, and their variance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CenteredPatch<const N: usize> {
    values: [f32; N],
    pub variance: f32,
}

impl<const N: usize> CenteredPatch<N> {
    /// Takes samples whose mean is zero already, as that of each channel is where channels are centred one by one.
    pub fn of_centered(values: [f32; N]) -> Self {
        Self { variance: mean_product(&values, &values), values }
    }

    /// Normalised cross-correlation, in `[-1, 1]`; zero with a flat patch.
    pub fn correlation(&self, other: &Self) -> f32 {
        mean_product(&self.values, &other.values) / (self.variance * other.variance).sqrt().max(1e-9)
    }
}

fn mean_product<const N: usize>(a: &[f32; N], b: &[f32; N]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>() / N as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn centered(samples: [f32; 9]) -> CenteredPatch<9> {
        let mean = samples.iter().sum::<f32>() / 9.0;
        CenteredPatch::of_centered(samples.map(|sample| sample - mean))
    }

    #[test]
    fn a_patch_correlates_with_itself_whatever_its_exposure_and_with_its_negative_inversely() {
        let samples: [f32; 9] = std::array::from_fn(|i| ((i * 7) % 5) as f32 / 5.0);
        let patch = centered(samples);
        let (brighter, negative) = (centered(samples.map(|s| 2.0 * s + 0.3)), centered(samples.map(|s| 1.0 - s)));
        assert!((patch.correlation(&brighter) - 1.0).abs() < 1e-6);
        assert!((patch.correlation(&negative) + 1.0).abs() < 1e-6);
        assert_eq!(patch.correlation(&centered([0.5; 9])), 0.0, "flat patches show nothing");
    }
}
