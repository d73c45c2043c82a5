//! A piece of advice: the pictures, the figure, the threshold, and what to do.

use std::fmt;

/// Pictures that a text names; the others are counted.
const NAMED: usize = 5;

/// What is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Topic {
    /// Pictures are out of focus, or the camera shook. Figure: sharpness, of that of the scene's median picture.
    Blur,
    /// Parts of the object are white in all channels. Figure: share of the object's pixels.
    Burnt,
    /// Parts of the object are black. Figure: share of the object's pixels.
    Black,
    /// Nothing shows a side of the object. Figure: degrees.
    Gap,
    /// Pictures share too little with others. Figure: share of what a picture shows.
    Overlap,
    /// Zoom or focus changed. Figure: focal length, of that of the median picture.
    FocalLength,
}

/// A picture, and what was measured of it.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ViewFigure {
    /// Name of the view.
    pub view: String,
    /// What was measured, as the topic says.
    pub figure: f64,
}

/// What to photograph again, and why. `Display` is its text.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Advice {
    /// What is wrong.
    pub topic: Topic,
    /// The pictures, worst first; those beside a gap, where it is one.
    pub views: Vec<ViewFigure>,
    /// Where the figure begins to be wrong, in its unit.
    pub threshold: f64,
    /// All of it for people: a sentence or two without a full stop.
    pub text: String,
}

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// A list for a text: at most five items, and how many more there are.
pub(super) fn listed(items: impl ExactSizeIterator<Item = String>) -> String {
    let more = items.len().saturating_sub(NAMED);
    let mut text = items.take(NAMED).collect::<Vec<_>>().join(", ");
    if more > 0 {
        text += &format!(" and {more} more");
    }
    text
}
