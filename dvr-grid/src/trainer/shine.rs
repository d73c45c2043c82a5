//! Whether the start believes stereo: not where the object shines.

use dvr_core::View;

use super::GridTrainer;
use crate::color_trust::agreement;
use crate::config::{ColorTrust, ExposureCorrection, GridConfig};
use crate::error::Result;
use crate::exposure;
use crate::picture_pyramid::PicturePyramid;
use crate::refinement::Refinement;

impl GridTrainer<'_> {
    /// Starts from the hull instead of stereo where views hardly agree on the colours of the surface that both make together: a
    /// highlight lies at another place of the surface in each view, and matches at a depth where there is none. Asked are pictures
    /// of the size that the second stage sees; on smaller ones highlights are blurred. Says so.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] where somebody wants it to end.
    pub(super) fn doubt_stereo(
        train: &[&View],
        config: &GridConfig,
        refinement: &mut Refinement,
    ) -> Result<Option<String>> {
        if !refinement.has_stereo() || config.trusts_colors != ColorTrust::Measured {
            return Ok(None);
        }
        let grids = refinement.first(config)?;
        let shape = grids.shape.values();
        let pyramid = PicturePyramid::new(train.to_vec(), config.neighbours, grids.shape.grid().spacing());
        let mut pictures = pyramid.level(pyramid.factor(2 * config.first_cells), refinement.masks());
        if pictures.order.is_empty() {
            return Ok(None);
        }
        if config.exposure == ExposureCorrection::Auto {
            let solved = exposure::solve(shape, &pictures.views, &pictures.order, config, 0);
            if let Some(solved) = solved.filter(|solved| solved.check.is_passed()) {
                pictures.expose(&solved.exposures);
            }
        }
        if agreement(shape, &pictures.views, &pictures.order, config, 0).shine() == 0.0 {
            return Ok(None);
        }
        refinement.forget_stereo();
        Ok(Some("views hardly agree on colours: training starts from the visual hull, without stereo".to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::{Cancellation, stored};
    use image::RgbImage;

    use super::super::mask_distances;
    use super::*;
    use crate::step::suite::speckled_arc;

    /// Photographs of a ball, each with what `light` adds to its pixels, given their view and place.
    fn lit(light: impl Fn(usize, u32, u32) -> f64) -> Vec<View> {
        let lit = |(i, view): (usize, View)| {
            let mut image = RgbImage::new(view.image.width(), view.image.height());
            for (u, v, pixel) in image.enumerate_pixels_mut() {
                let shown = view.image.get_pixel(u, v).0;
                *pixel = shown.map(|level| (f64::from(level) + light(i, u, v)).clamp(0.0, 255.0) as u8).into();
            }
            View { image: stored(image), ..view }
        };
        speckled_arc(10).into_iter().enumerate().map(lit).collect()
    }

    #[test]
    fn stereo_is_doubted_where_colours_change_with_the_view_and_not_where_the_light_does() {
        let believes = |light: &dyn Fn(usize, u32, u32) -> f64, config: GridConfig| {
            let (plain, lit) = (lit(|_, _, _| 0.0), lit(light));
            let plain: Vec<&View> = plain.iter().collect();
            let masks = mask_distances(&plain, &Cancellation::default()).unwrap();
            let mut refinement = Refinement::new(masks, &plain, &config, &Cancellation::default()).unwrap();
            assert!(refinement.has_stereo());
            let lit: Vec<&View> = lit.iter().collect();
            let note = GridTrainer::doubt_stereo(&lit, &config, &mut refinement).unwrap();
            assert_eq!(note.is_some(), !refinement.has_stereo());
            refinement.has_stereo()
        };
        // Stripes of light that stand where the camera is, not on the ball.
        let shine = |view: usize, u: u32, _: u32| 60.0 * (0.4 * f64::from(u) + 2.0 * view as f64).sin();
        let exposure = |view: usize, _: u32, _: u32| if view.is_multiple_of(2) { 0.0 } else { -40.0 };
        let config = GridConfig::default;
        assert!(believes(&|_, _, _| 0.0, config()), "nothing changes");
        assert!(!believes(&shine, config()), "shine");
        assert!(believes(&shine, GridConfig { trusts_colors: ColorTrust::Full, ..config() }), "colours count in full");
        assert!(believes(&exposure, config()), "corrected exposure");
        assert!(!believes(&exposure, GridConfig { exposure: ExposureCorrection::Off, ..config() }), "exposure");
    }
}
