//! Rendered pictures against photographs, rendered silhouettes against masks.

use image::RgbImage;

use super::overlap::intersection_over_union;
use crate::error::{ComparisonError, Result};
use crate::raster::Mask;

/// Side of the SSIM's window in pixels, and the standard deviation of its Gaussian (Wang et al. 2004).
const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;

/// The constants `C1 = (K1 L)^2` and `C2 = (K2 L)^2` with `K1 = 0.01`, `K2 = 0.03` and values in `[0, 1]`, so `L = 1`.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// What a perfect picture gets, in dB: a finite figure, because averages and JSON have no use for infinity. Pictures of
/// 8 bits that differ in a single channel of one pixel stay below it up to 5 million pixels.
pub const MAX_PSNR: f64 = 120.0;

/// Peak signal-to-noise ratio in dB of a mean squared difference of values in `[0, 1]`: `-10 log10` of it, at most
/// [`MAX_PSNR`].
pub fn psnr_of_error(mean_squared: f64) -> f64 {
    -10.0 * mean_squared.max(1e-12).log10()
}

/// Peak signal-to-noise ratio in dB: `-10 log10` of the mean squared difference of values in `[0, 1]`, over all three
/// channels of all pixels, or of those that the mask shows as object.
///
/// [`MAX_PSNR`] where nothing differs, also where the mask shows no object.
///
/// # Errors
/// When the sizes differ.
pub fn psnr(predicted: &RgbImage, truth: &RgbImage, mask: Option<&Mask>) -> Result<f64> {
    same_size(predicted.dimensions(), truth.dimensions())?;
    if let Some(mask) = mask {
        same_size(mask.size(), truth.dimensions())?;
    }
    let (mut sum, mut count) = (0.0, 0usize);
    for ((x, y, a), b) in predicted.enumerate_pixels().zip(truth.pixels()) {
        if mask.is_none_or(|mask| mask.is_object(x, y)) {
            sum += a.0.iter().zip(b.0).map(|(&a, b)| ((f64::from(a) - f64::from(b)) / 255.0).powi(2)).sum::<f64>();
            count += 3;
        }
    }
    Ok(psnr_of_error(sum / count.max(1) as f64))
}

/// Structural similarity (Wang, Bovik, Sheikh and Simoncelli 2004), 1 for equal pictures.
///
/// As in the paper: a Gaussian window of 11x11 pixels with standard deviation 1.5, `K1 = 0.01`, `K2 = 0.03`, weighted
/// moments without Bessel's correction, and the mean over the windows that lie wholly in the picture. The paper is
/// about grey values; here it is the mean over the three channels, as the field computes it. A picture smaller than the
/// window is compared through a window of its own size.
///
/// # Errors
/// When the sizes differ or there are no pixels.
pub fn ssim(predicted: &RgbImage, truth: &RgbImage) -> Result<f64> {
    same_size(predicted.dimensions(), truth.dimensions())?;
    let (width, height) = (truth.width() as usize, truth.height() as usize);
    if width == 0 || height == 0 {
        return Err(ComparisonError::NoPixels.into());
    }
    let channel = |picture: &RgbImage, c: usize| -> Vec<f64> {
        picture.pixels().map(|pixel| f64::from(pixel.0[c]) / 255.0).collect()
    };
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let of_channel = |c: usize| {
        let (a, b) = (channel(predicted, c), channel(truth, c));
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<_>>();
        let blur = |values: &[f64]| blur(values, width, height);
        let (mean_a, mean_b) = (blur(&a), blur(&b));
        let (aa, bb, ab) = (blur(&product(&a, &a)), blur(&product(&b, &b)), blur(&product(&a, &b)));
        mean(
            (0..mean_a.len())
                .map(|i| {
                    let (ma, mb) = (mean_a[i], mean_b[i]);
                    let (variances, covariance) = (aa[i] - ma * ma + bb[i] - mb * mb, ab[i] - ma * mb);
                    (2.0 * ma * mb + C1) * (2.0 * covariance + C2) / ((ma * ma + mb * mb + C1) * (variances + C2))
                })
                .collect(),
        )
    };
    Ok((0..3).map(of_channel).sum::<f64>() / 3.0)
}

/// Intersection over union of two masks' object pixels; 1 where neither shows an object.
///
/// # Errors
/// When the sizes differ.
pub fn mask_iou(predicted: &Mask, truth: &Mask) -> Result<f64> {
    same_size(predicted.size(), truth.size())?;
    let object = |mask: &Mask| -> Vec<bool> {
        let (width, height) = mask.size();
        (0..height).flat_map(|v| (0..width).map(move |u| mask.is_object(u, v))).collect()
    };
    intersection_over_union(&object(predicted), &object(truth))
}

/// Gaussian means over the windows that lie in the picture, row by row.
fn blur(values: &[f64], width: usize, height: usize) -> Vec<f64> {
    let (across, down) = (gaussian(width.min(WINDOW)), gaussian(height.min(WINDOW)));
    let columns = width + 1 - across.len();
    let rows: Vec<f64> = (0..height * columns)
        .map(|i| {
            let start = i / columns * width + i % columns;
            across.iter().zip(&values[start..]).map(|(weight, value)| weight * value).sum()
        })
        .collect();
    (0..(height + 1 - down.len()) * columns)
        .map(|i| down.iter().enumerate().map(|(k, weight)| weight * rows[i + k * columns]).sum())
        .collect()
}

/// Weights of a window of `length`, adding up to 1.
fn gaussian(length: usize) -> Vec<f64> {
    let middle = 0.5 * (length as f64 - 1.0);
    let weights: Vec<f64> = (0..length).map(|i| (-0.5 * ((i as f64 - middle) / SIGMA).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / total).collect()
}

fn same_size(predicted: (u32, u32), truth: (u32, u32)) -> Result<()> {
    if predicted == truth { Ok(()) } else { Err(ComparisonError::Sizes { predicted, truth }.into()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, Luma, Rgb};

    fn grey(width: u32, height: u32, value: impl Fn(u32, u32) -> u8) -> RgbImage {
        RgbImage::from_fn(width, height, |u, v| Rgb([value(u, v); 3]))
    }

    #[test]
    fn psnr_is_minus_ten_log_of_the_squared_error() {
        let (black, grey) = (grey(4, 3, |_, _| 0), grey(4, 3, |_, _| 51));
        assert!((psnr(&black, &grey, None).unwrap() - -10.0 * 0.04f64.log10()).abs() < 1e-9);
        assert_eq!(psnr(&black, &black, None).unwrap(), MAX_PSNR);
    }

    #[test]
    fn a_masked_psnr_looks_at_the_object_only() {
        let (truth, predicted) = (grey(4, 4, |_, _| 100), grey(4, 4, |u, _| if u < 2 { 100 } else { 255 }));
        let left = Mask::from(GrayImage::from_fn(4, 4, |u, _| Luma([255 * u8::from(u < 2)])));
        assert_eq!(psnr(&predicted, &truth, Some(&left)).unwrap(), MAX_PSNR);
        let right = Mask::from(GrayImage::from_fn(4, 4, |u, _| Luma([255 * u8::from(u >= 2)])));
        let expected = -20.0 * (155.0f64 / 255.0).log10();
        assert!((psnr(&predicted, &truth, Some(&right)).unwrap() - expected).abs() < 1e-9);
    }

    #[test]
    fn ssim_of_flat_pictures_is_the_luminance_term() {
        let (a, b) = (grey(16, 14, |_, _| 51), grey(16, 14, |_, _| 102));
        let expected = (2.0 * 0.2 * 0.4 + C1) / (0.04 + 0.16 + C1);
        assert!((ssim(&a, &b).unwrap() - expected).abs() < 1e-9);
        assert!((ssim(&a, &a).unwrap() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn ssim_agrees_with_the_definition_window_by_window() {
        let (width, height) = (15u32, 13u32);
        let a = grey(width, height, |u, v| ((u * 37 + v * 91) % 256) as u8);
        let b = grey(width, height, |u, v| ((u * 41 + v * v * 7 + 30) % 256) as u8);
        let weight = |i: u32, j: u32| {
            let (x, y) = (f64::from(i) - 5.0, f64::from(j) - 5.0);
            (-(x * x + y * y) / (2.0 * SIGMA * SIGMA)).exp()
        };
        let total: f64 = (0..11).flat_map(|i| (0..11).map(move |j| (i, j))).map(|(i, j)| weight(i, j)).sum();
        let (mut sum, mut windows) = (0.0, 0.0);
        for v in 0..=height - 11 {
            for u in 0..=width - 11 {
                let moment = |f: &dyn Fn(f64, f64) -> f64| {
                    let mut sum = 0.0;
                    for j in 0..11 {
                        for i in 0..11 {
                            let value = |p: &RgbImage| f64::from(p.get_pixel(u + i, v + j).0[0]) / 255.0;
                            sum += weight(i, j) / total * f(value(&a), value(&b));
                        }
                    }
                    sum
                };
                let (ma, mb) = (moment(&|a, _| a), moment(&|_, b| b));
                let va = moment(&|a, _| (a - ma).powi(2));
                let vb = moment(&|_, b| (b - mb).powi(2));
                let cov = moment(&|a, b| (a - ma) * (b - mb));
                sum += (2.0 * ma * mb + C1) * (2.0 * cov + C2) / ((ma * ma + mb * mb + C1) * (va + vb + C2));
                windows += 1.0;
            }
        }
        assert!((ssim(&a, &b).unwrap() - sum / windows).abs() < 1e-9);
        assert!(ssim(&a, &b).unwrap() < 0.5);
    }

    #[test]
    fn ssim_of_a_picture_smaller_than_the_window_is_defined() {
        let (a, b) = (grey(5, 1, |u, _| 40 * u as u8), grey(5, 1, |u, _| 200 - 40 * u as u8));
        assert!((ssim(&a, &a).unwrap() - 1.0).abs() < 1e-12);
        assert!(ssim(&a, &b).unwrap() < 0.0, "the structure is opposite");
        assert!(ssim(&RgbImage::new(0, 0), &RgbImage::new(0, 0)).is_err());
    }

    #[test]
    fn masks_are_compared_by_their_object_pixels() {
        let mask = |from: u32, to: u32| {
            Mask::from(GrayImage::from_fn(10, 2, |u, _| Luma([255 * u8::from((from..to).contains(&u))])))
        };
        assert_eq!(mask_iou(&mask(0, 6), &mask(3, 9)).unwrap(), 3.0 / 9.0);
        assert_eq!(mask_iou(&mask(0, 0), &mask(0, 0)).unwrap(), 1.0);
        assert_eq!(mask_iou(&mask(0, 0), &mask(0, 1)).unwrap(), 0.0);
    }

    #[test]
    fn pictures_of_different_sizes_are_refused() {
        let (a, b) = (RgbImage::new(3, 4), RgbImage::new(4, 3));
        assert!(psnr(&a, &b, None).unwrap_err().to_string().contains("3x4"));
        assert!(ssim(&a, &b).is_err());
        let mask = Mask::from(GrayImage::new(3, 4));
        assert!(psnr(&b, &b, Some(&mask)).is_err());
        assert!(mask_iou(&mask, &Mask::from(GrayImage::new(4, 3))).is_err());
    }
}
