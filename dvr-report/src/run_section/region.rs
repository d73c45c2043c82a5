//! Where the surface was looked for: its box over photographs.

use std::fmt::Write;

use crate::html::escape;
use crate::region_pictures::RegionPicture;
use crate::summary::RunSummary;

/// Training views with the box of the region; empty where the scene was not found.
pub(super) fn region(summary: &RunSummary) -> String {
    if summary.region.is_empty() {
        return String::new();
    }
    let mut html = String::from(
        "<p>The box within which the surface was looked for, over photographs that were trained on. The object should lie \
         within it and fill most of it.</p><div class=\"regions\">",
    );
    summary.region.iter().for_each(|picture| html += &one_picture(picture));
    html + "</div>"
}

/// A photograph with the box's edges drawn over it.
fn one_picture(picture: &RegionPicture) -> String {
    let ((width, height), name) = (picture.size, escape(&picture.name));
    let mut lines = String::new();
    for [from, to] in &picture.edges {
        let _ =
            write!(lines, "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\"/>", from.x, from.y, to.x, to.y);
    }
    format!(
        "<figure><svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"region of interest in view {name}\">\
         <image href=\"{}\" width=\"{width}\" height=\"{height}\"/><g>{lines}</g></svg>\
         <figcaption>view {name}</figcaption></figure>",
        picture.photo
    )
}
