//! Which views are trained on, and which are not.

use crate::error::{Error, Result};
use crate::scene::{Scene, Split, View, require_masks};

/// The views of a scene, divided into those that are trained on and those that are not.
#[derive(Clone, Debug)]
pub struct ViewSplit<'a> {
    /// Trained on.
    pub train: Vec<&'a View>,
    /// Never trained on: validation chooses the best checkpoint by them.
    pub held_out: Vec<&'a View>,
}

impl<'a> ViewSplit<'a> {
    /// Takes the dataset's validation split where it has one; otherwise holds out one training view in
    /// `hold_out_every`, starting with the middle one of the first group.
    ///
    /// # Errors
    /// When fewer than two views remain to train on.
    pub fn new(scene: &'a Scene, hold_out_every: usize) -> Result<Self> {
        let mut train: Vec<&View> = scene.views_of(Split::Train).collect();
        let mut held_out: Vec<&View> = scene.views_of(Split::Val).collect();
        if held_out.is_empty() && hold_out_every > 1 && train.len() > hold_out_every {
            let is_held = |i: &usize| i % hold_out_every == hold_out_every / 2;
            held_out = train.iter().enumerate().filter(|(i, _)| is_held(i)).map(|(_, v)| *v).collect();
            train = train.into_iter().enumerate().filter(|(i, _)| !is_held(i)).map(|(_, v)| v).collect();
        }
        if train.len() < 2 {
            let (scene, all) = (scene.name.clone(), scene.views.len());
            return Err(Error::TooFewViews { scene, left: train.len(), all, purpose: "to train on" });
        }
        Ok(Self { train, held_out })
    }

    /// Checks that every view has a mask: for methods that cannot do without.
    ///
    /// # Errors
    /// [`Error::MasksMissing`] naming the views that have none.
    pub fn require_masks(&self) -> Result<()> {
        require_masks(self.train.iter().chain(&self.held_out).copied())
    }
}
