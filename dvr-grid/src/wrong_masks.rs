//! Masks that are wrong as a whole: their views are left out.

use dvr_core::hull::wrong_masks;
use dvr_core::{Camera, Mask, UnitCube, View};

use crate::config::{DisagreeingViews, GridConfig};
use crate::error::Result;

/// Takes views out whose masks show something else than most of the others; says which. Every view has a mask.
///
/// # Errors
/// When a mask has another size than its view's picture.
pub(crate) fn leave_out_wrong_masks(train: &mut Vec<&View>, config: &GridConfig) -> Result<Vec<String>> {
    if config.disagreeing_views != DisagreeingViews::Auto {
        return Ok(Vec::new());
    }
    let pairs: Vec<(&Camera, &Mask)> = train.iter().filter_map(|view| view.training_pair()).collect();
    let wrong = wrong_masks(&pairs, UnitCube::default().into())?;
    let mut notes = Vec::with_capacity(wrong.len());
    // From the last on, so that the places of the others hold.
    for &view in wrong.iter().rev() {
        let name = &train.remove(view).name;
        notes.push(format!("the mask of view `{name}` shows something else than the others; the view is left out"));
    }
    notes.reverse();
    Ok(notes)
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::{TexturedMesh, shapes};
    use dvr_core::stored;
    use dvr_core::synth::{MeshRenderer, SynthConfig, place_cameras};

    use super::*;

    /// Sixteen views of a ball.
    fn views() -> Vec<View> {
        let ball = TexturedMesh { mesh: shapes::icosphere(3, 0.3), ..TexturedMesh::default() };
        let config = SynthConfig { views: 16, samples_per_axis: 2, ..SynthConfig::default() };
        let renderer = MeshRenderer::new(&ball, &config);
        let view = |(i, camera): (usize, Camera)| {
            let picture = renderer.render(&camera, i as u64);
            let image = stored(picture.image);
            View::new(i.to_string(), camera, image, picture.mask)
        };
        place_cameras(&config).into_iter().enumerate().map(view).collect()
    }

    #[test]
    fn a_view_whose_mask_shows_something_else_is_left_out_unless_all_are_to_be_believed() {
        let mut views = views();
        let left = |views: &[View], config: &GridConfig| {
            let mut train: Vec<&View> = views.iter().collect();
            let notes = leave_out_wrong_masks(&mut train, config).unwrap();
            (train.len(), notes)
        };
        assert_eq!(left(&views, &GridConfig::default()), (16, vec![]));
        views[6].mask.as_mut().unwrap().coverage.pixels_mut().for_each(|pixel| pixel.0[0] = 255 - pixel.0[0]);
        views[9].mask.as_mut().unwrap().coverage.fill(0);
        let (count, notes) = left(&views, &GridConfig::default());
        assert!(count == 14 && notes[0].contains("view `6`") && notes[1].contains("view `9`"), "{notes:?}");
        let trusting = GridConfig { disagreeing_views: DisagreeingViews::Exactly(0), ..GridConfig::default() };
        assert_eq!(left(&views, &trusting), (16, vec![]));
    }
}
