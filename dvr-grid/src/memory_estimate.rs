//! What a run of the grid takes of main memory, estimated before it starts.
//!
//! The estimate is meant to lie above the truth. Measured peaks of whole processes (photographs of 48 to 150 views, two
//! threads, dense grids) were 196 to 431 MB with 128 cells, of which up to 240 MB are photographs and the program itself;
//! with 256 cells the demo scene took 445 MB in bricks. What more cells take is scaled from that.

use dvr_core::View;

use crate::config::GridConfig;
use crate::growth::Growth;
use crate::start::{CARVING_CELLS, CARVING_NODE};

/// Bytes of a node of a grid of up to `whole_cells` cells, all of whose nodes are stored: base, values, gradient, slopes
/// and rows of the shape, with the coarser levels.
const SHAPE_NODE: u64 = 52;

/// Bytes of a node of its colour grid: three channels of base, values and gradient, parameters and moments, with the
/// coarser levels.
const COLOR_NODE: u64 = 80;

/// Bytes per node of a face of a finer grid: what is stored around a surface, shape and colour, with the coarser levels and
/// the stage before.
const SURFACE_NODE: u64 = 6000;

/// Bytes per node of a finer grid: sets of nodes, while a stage begins and while a field is written.
const FAR_NODE: u64 = 4;

/// Bytes of a parameter with its moments, its sum, and its copy in a checkpoint.
const PARAMETER: u64 = 40;

/// Bytes of a training view at most: the distance to the outline, on up to 512 x 512 cells, and what orders the pixels.
const VIEW: u64 = 1_200_000;

/// The same per pixel of small views, whose masks are resampled to four times as many cells along an edge.
const SMALL_VIEW_PIXEL: u64 = 80;

/// Bytes while the distances of a view are computed.
const TRANSFORMED_VIEW: u64 = 5_000_000;

/// Bytes of a ray of a step: its gradients by shape and colour.
const RAY: u64 = 512;

impl GridConfig {
    /// Bytes that a run on these views takes at most, about, besides the photographs: with as many cells as it may grow
    /// to.
    pub fn memory_estimate(&self, train: &[&View]) -> u64 {
        let cells = Growth::plan(self, train).max_cells() as u64;
        let nodes = |cells: u64| (cells + 1).saturating_pow(3);
        // Up to `whole_cells`, everything in the hull learns: half of the cube, at most.
        let whole = nodes(cells.min(self.whole_cells as u64)) / 2;
        let stored = cells.min(self.whole_cells as u64);
        let color = nodes(stored / self.color_coarseness.max(1) as u64);
        let of_finer =
            if cells > stored { (cells + 1).saturating_pow(2) * SURFACE_NODE + nodes(cells) * FAR_NODE } else { 0 };
        let of_grids: u64 =
            [nodes(stored) * SHAPE_NODE, color * COLOR_NODE, whole * PARAMETER, of_finer].into_iter().sum();
        // Before there are grids, the hull is carved.
        let of_carving = if self.plane_sweep_pixels > 0 { nodes(CARVING_CELLS as u64) * CARVING_NODE } else { 0 };
        let pixels = |view: &&View| u64::from(view.image.width()) * u64::from(view.image.height());
        let threads = rayon::current_num_threads() as u64;
        let of_view = |view: &&View| VIEW.min(pixels(view) * SMALL_VIEW_PIXEL);
        let of_views = [train.iter().map(of_view).sum(), threads * TRANSFORMED_VIEW];
        of_grids.max(of_carving) + of_views.into_iter().sum::<u64>() + self.rays.max(self.max_rays) as u64 * RAY
    }
}
