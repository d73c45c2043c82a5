//! True shapes, in object space. All are closed, and the parts of a shape do not overlap, so that samples of the mesh are
//! samples of the surface.

mod concave;
#[cfg(test)]
mod measures;
mod parts;
mod pebble;
mod perforated;
mod placement;
mod steps;
mod thin;

pub(crate) use concave::{bowl, tunnel};
pub(crate) use parts::{far_apart, tiny_beside_large};
pub(crate) use pebble::pebble;
pub(crate) use perforated::perforated;
pub(crate) use steps::{into_step, step};
pub(crate) use thin::{plate, ring, wedge};
