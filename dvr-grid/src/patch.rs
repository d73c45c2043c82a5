//! The normalised cross-correlation of two patches.

/// Samples of a patch less their mean, and their variance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CenteredPatch<const N: usize> {
    pub values: [f32; N],
    pub variance: f32,
}

impl<const N: usize> CenteredPatch<N> {
    /// Subtracts the mean of all samples.
    pub fn new(mut values: [f32; N]) -> Self {
        let mean = values.iter().sum::<f32>() / N as f32;
        values.iter_mut().for_each(|value| *value -= mean);
        Self::of_centered(values)
    }

    /// Takes samples whose mean is zero already, as that of each channel is where channels are centred one by one.
    pub fn of_centered(values: [f32; N]) -> Self {
        let variance = values.iter().map(|value| value * value).sum::<f32>() / N as f32;
        Self { values, variance }
    }

    /// Mean product with other numbers.
    pub fn mean_product(&self, other: &[f32; N]) -> f32 {
        self.values.iter().zip(other).map(|(a, b)| a * b).sum::<f32>() / N as f32
    }

    /// What covariances are divided by; `noise` is the variance that noise alone may have.
    pub fn scale(&self, other: &Self, noise: f32) -> f32 {
        ((self.variance + noise) * (other.variance + noise)).sqrt().max(1e-9)
    }

    /// Normalised cross-correlation, in `[-1, 1]`.
    pub fn correlation(&self, other: &Self, noise: f32) -> f32 {
        self.mean_product(&other.values) / self.scale(other, noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_patch_correlates_with_itself_whatever_its_exposure_and_with_its_negative_inversely() {
        let samples: [f32; 9] = std::array::from_fn(|i| ((i * 7) % 5) as f32 / 5.0);
        let patch = CenteredPatch::new(samples);
        let brighter = CenteredPatch::new(samples.map(|sample| 2.0 * sample + 0.3));
        let negative = CenteredPatch::new(samples.map(|sample| 1.0 - sample));
        assert!((patch.correlation(&brighter, 0.0) - 1.0).abs() < 1e-6);
        assert!((patch.correlation(&negative, 0.0) + 1.0).abs() < 1e-6);
        assert_eq!(patch.correlation(&CenteredPatch::new([0.5; 9]), 0.0), 0.0, "flat patches show nothing");
    }
}
