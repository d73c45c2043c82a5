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
    /// Forgets stereo where views hardly agree on the colours of the surface that training would start from, and says so: a highlight
    /// lies at another place in each view, and matches at a depth where there is no surface.
    ///
    /// Asked are photographs of the size that the second stage sees. Smaller ones blur highlights.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] where somebody wants it to end.
    pub(super) fn judge_stereo(
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
        let mut photographs = pyramid.level(pyramid.factor(2 * config.first_cells), refinement.masks());
        if photographs.order.is_empty() {
            return Ok(None);
        }
        if config.exposure == ExposureCorrection::Auto
            && let Some(solved) = exposure::solve(shape, &photographs.views, &photographs.order, config, 0)
        {
            photographs.expose(&solved.exposures);
        }
        let agreement = agreement(shape, &photographs.views, &photographs.order, config, 0);
        if agreement.shine() == 0.0 {
            return Ok(None);
        }
        refinement.forget_stereo();
        Ok(Some(format!(
            "views agree on {:.0} % of the colours, as on what shines: training starts from the visual hull, without stereo",
            100.0 * agreement.0
        )))
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::{Cancellation, stored};
    use image::RgbImage;

    use super::super::mask_distances;
    use super::*;
    use crate::Capacity;
    use crate::error::Error;
    use crate::report::TrainerState;
    use crate::state;
    use crate::step::suite::speckled_arc;

    /// Photographs of a ball whose pixels are changed, given their level, view and place.
    fn photographs(changed: impl Fn(f64, usize, u32) -> f64) -> Vec<View> {
        let of_view = |(i, view): (usize, View)| {
            let mut image = RgbImage::new(view.image.width(), view.image.height());
            for (u, v, pixel) in image.enumerate_pixels_mut() {
                let shown = view.image.get_pixel(u, v).0;
                *pixel = shown.map(|level| changed(level.into(), i, u).clamp(0.0, 255.0) as u8).into();
            }
            View { image: stored(image), ..view }
        };
        speckled_arc(10).into_iter().enumerate().map(of_view).collect()
    }

    /// Stripes of light that stand where the camera is, not on the ball.
    fn shine(level: f64, view: usize, u: u32) -> f64 {
        level + 60.0 * (0.4 * f64::from(u) + 2.0 * view as f64).sin()
    }

    #[test]
    fn stereo_is_doubted_where_colours_change_with_the_view_and_not_where_the_light_does() {
        let believes = |changed: fn(f64, usize, u32) -> f64, config: GridConfig| {
            let (plain, changed) = (photographs(|level, _, _| level), photographs(changed));
            let plain: Vec<&View> = plain.iter().collect();
            let masks = mask_distances(&plain, &Cancellation::default()).unwrap();
            let mut refinement = Refinement::new(masks, &plain, &config, None, &Cancellation::default()).unwrap();
            assert!(refinement.has_stereo());
            let changed: Vec<&View> = changed.iter().collect();
            let note = GridTrainer::judge_stereo(&changed, &config, &mut refinement).unwrap();
            assert_eq!([note.is_some(), refinement.doubts_stereo()], [!refinement.has_stereo(); 2]);
            refinement.has_stereo()
        };
        let exposure = |level: f64, view: usize, _: u32| if view.is_multiple_of(2) { level } else { 0.7 * level };
        let config = GridConfig::default;
        assert!(believes(|level, _, _| level, config()), "nothing changes");
        assert!(!believes(shine, config()), "shine");
        assert!(believes(shine, GridConfig { trusts_colors: ColorTrust::Full, ..config() }), "colours count in full");
        assert!(believes(exposure, config()), "corrected exposure");
        assert!(!believes(exposure, GridConfig { exposure: ExposureCorrection::Off, ..config() }), "exposure");
    }

    #[test]
    fn a_run_without_stereo_goes_on_and_one_that_started_with_it_does_not() {
        let views = photographs(shine);
        let config = GridConfig { steps: 3, capacity: Capacity::Cells(32), ..GridConfig::default() };
        let start = || GridTrainer::new(views.iter().collect(), Vec::new(), config.clone()).unwrap();
        let mut unbroken = start();
        assert!(unbroken.notes().iter().any(|note| note.contains("without stereo")));
        unbroken.step().unwrap();
        let state = unbroken.state().unwrap();
        let mut resumed = start();
        resumed.resume(&state, 1).unwrap();
        let [first, second] = [&mut unbroken, &mut resumed].map(|trainer| {
            (1..3).for_each(|_| drop(trainer.step().unwrap()));
            trainer.state().unwrap()
        });
        assert!(first.model == second.model && first.training == second.training);

        let progress = state::Progress { doubts_stereo: false, ..state::progress(&state.training).unwrap() };
        let training = state::to_bytes(&progress, &unbroken.backend.grids().unwrap(), None).unwrap();
        let refused = start().resume(&TrainerState { training, ..state }, 1);
        assert!(matches!(&refused, Err(Error::State(why)) if why.contains("train anew")), "{refused:?}");
    }
}
