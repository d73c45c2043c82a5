//! What mask refinement did, view by view.

use std::fmt;

/// What [`refine_masks`](crate::refine_masks) did. Its `Display` is [`MaskReport::notes`], one per line.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MaskReport {
    /// How many masks were looked at: those from files, of views for training and validation.
    pub looked_at: usize,
    /// The views whose masks were refined, in the order of the scene.
    pub refined: Vec<RefinedView>,
}

/// What was changed in one mask.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RefinedView {
    /// Name of the view.
    pub name: String,
    /// How many pixels were given back to the object.
    pub given_back: usize,
    /// How many pixels of a rim of background were taken away.
    pub taken_away: usize,
}

impl MaskReport {
    /// What was done, in at most two sentences without full stops; none where nothing was.
    pub fn notes(&self) -> Vec<String> {
        let note = |count: fn(&RefinedView) -> usize, what: &str| {
            let pixels: Vec<usize> = self.refined.iter().map(count).filter(|&pixels| pixels > 0).collect();
            let sum = pixels.iter().sum::<usize>();
            (sum > 0).then(|| format!("{} of {} masks {what} ({sum} pixels)", pixels.len(), self.looked_at))
        };
        let given_back = "leave out what photographs show to be the object; it was given back";
        let taken_away = "have a rim that photographs show to be background; it was taken away";
        [note(|view| view.given_back, given_back), note(|view| view.taken_away, taken_away)]
            .into_iter()
            .flatten()
            .collect()
    }
}

impl fmt::Display for MaskReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.notes().join("\n"))
    }
}
