//! A bounding volume hierarchy over triangles: where does a ray first meet a mesh, and how far is a point from it?
//!
//! Built along a space-filling curve (Lauterbach et al. 2009). Triangles are intersected by the watertight test of
//! Woop, Benthin and Wald (2013), in double precision: no ray slips through an edge that two triangles share. Written
//! here because the `bvh` crate's triangle test (Möller and Trumbore) gives no such promise and culls back faces.

mod build;
mod nearest;
mod node;
mod pairs;
mod tree;
mod triangle;

pub use nearest::NearestPoint;
pub use tree::Bvh;
pub use triangle::RayHit;

#[cfg(test)]
mod tests;
