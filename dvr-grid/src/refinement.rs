//! The grids of each stage: those of the first from the visual hull, those of the next from what was learned.

use std::sync::Arc;

use burn::tensor::Device;
use dvr_core::hull::MaskDistance;
use dvr_core::metrics::depth_maps::StereoDepth;
use dvr_core::voxel::VoxelGrid;
use dvr_core::{Cancellation, UnitCube, View};
use glam::Vec3;

use crate::accelerator::Accelerator;
use crate::active::ActiveNodes;
use crate::bricks::{BrickValues, near_refined_surface};
use crate::color::{self, CHANNELS};
use crate::config::GridConfig;
use crate::error::Result;
use crate::multires::{ColorGrid, Grids, ShapeGrid};
use crate::start::{CARVING_CELLS, MaskDistances, SpaceCarving, hull_detail, hull_start, open_share};
use crate::stereo::{FusedDistance, Stereo};
use crate::views::{TrainingView, mean_object_color};

/// How near to the surface a node learns where not all do, in nodes.
const BAND_NODES: usize = 3;

/// Views below which two that match by chance are too many: nothing but the hull is believed.
const MIN_MATCHED_VIEWS: usize = 6;

/// What is known of the object before training.
pub(crate) struct Refinement {
    masks: MaskDistances,
    carving: Option<SpaceCarving>,
    /// Cells from which on grids have the carving.
    carved_from: usize,
    fused: Option<FusedDistance>,
    /// Whether stereo was forgotten.
    stereo_is_doubted: bool,
    /// What stereo found before training, of each view.
    pub depths: Vec<StereoDepth>,
    /// What people should know of it all.
    pub notes: Vec<String>,
    cancellation: Cancellation,
    /// Where colours start.
    pub mean_color: [f32; 3],
}

impl Refinement {
    /// Carves what photographs show to be empty out of the hull, where the shape learns from them. What can be runs on the device, if it is a
    /// GPU.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] where somebody wants it to end, and when a GPU fails.
    pub fn new(
        masks: Vec<MaskDistance>,
        views: &[&View],
        config: &GridConfig,
        device: Option<&Device>,
        cancellation: &Cancellation,
    ) -> Result<Self> {
        let accelerator = &mut Accelerator::new(device);
        let mean_color = mean_object_color(views).to_array();
        let start = Self {
            masks: MaskDistances::new(masks, accelerator)?,
            carving: None,
            carved_from: 0,
            fused: None,
            stereo_is_doubted: false,
            depths: Vec::new(),
            notes: Vec::new(),
            cancellation: cancellation.clone(),
            mean_color,
        };
        if config.steps == 0 || !config.losses.has_cross_view() || views.len() < MIN_MATCHED_VIEWS {
            return Ok(Self { notes: std::mem::take(&mut accelerator.notes), ..start });
        }
        let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        let views = &TrainingView::pack(views, config.neighbours, 1);
        let (mut carving, mut hull_of_carving) = (None, None);
        if config.plane_sweep_pixels > 0 {
            let grid = padded_cube(CARVING_CELLS);
            let (hull, _) = start.hull(&grid, config)?;
            let pixels = config.plane_sweep_pixels;
            carving = SpaceCarving::by_plane_sweep(views, &grid, &hull, pixels, accelerator, cancellation)?;
            hull_of_carving = Some(hull);
        }
        let mut stereo = Stereo::default();
        if config.stereo_cells > 1 {
            let grid = padded_cube(config.stereo_cells / 2);
            let hull = match hull_of_carving.filter(|_| grid.cells() == CARVING_CELLS) {
                Some(hull) => hull,
                None => start.hull(&grid, config)?.0,
            };
            let cells = config.stereo_cells;
            stereo = Stereo::of_views(&names, views, &grid, &hull, cells, accelerator, cancellation)?;
        }
        Ok(Self {
            carving,
            fused: stereo.fused,
            depths: stereo.depths,
            notes: std::mem::take(&mut accelerator.notes),
            ..start
        })
    }

    /// Distance to the hull at every node, less what is carved, and the nodes at which the shape may change.
    fn hull(&self, grid: &VoxelGrid, config: &GridConfig) -> Result<(Vec<f32>, ActiveNodes)> {
        let carving = self.carving.as_ref().filter(|_| grid.cells() >= self.carved_from);
        self.hull_less(carving, grid, config)
    }

    /// The same, less this carving.
    fn hull_less(
        &self,
        carving: Option<&SpaceCarving>,
        grid: &VoxelGrid,
        config: &GridConfig,
    ) -> Result<(Vec<f32>, ActiveNodes)> {
        let disagreeing = config.disagreeing_views.of(self.masks.all().len());
        hull_start(&self.masks, grid, disagreeing, carving, self.fused.as_ref(), &self.cancellation)
    }

    /// Whether a point of the hull is carved.
    pub fn is_carved(&self, point: Vec3) -> bool {
        self.carving.as_ref().is_some_and(|carving| carving.at(point) < 0.0)
    }

    /// Whether photographs showed a good part of the hull to be empty.
    pub fn is_hollowed(&self) -> bool {
        self.carving.as_ref().is_some_and(SpaceCarving::is_hollow)
    }

    /// Carves only grids of so many cells or more, and takes the mouths of hollows from a trained surface. Whether any hollow
    /// leads to the outside then.
    pub fn carve_from(&mut self, cells: usize, surface: &Grids) -> bool {
        let values = surface.shape.values();
        self.carved_from = cells;
        self.carving = self.carving.take().and_then(|carving| carving.with_mouths_of(|point| values.value(point)));
        self.carving.is_some()
    }

    /// The same with a hollow where points of the hull are carved, for tests.
    #[cfg(test)]
    pub fn hollowed(self, config: &GridConfig, is_carved: impl Fn(Vec3) -> bool) -> Self {
        let grid = padded_cube(CARVING_CELLS);
        let (hull, _) = self.hull(&grid, config).unwrap();
        Self { carving: Some(SpaceCarving::of(grid, hull, is_carved)), ..self }
    }

    /// Whether grids of this many cells are the first that are carved, and coarser ones were not.
    pub fn opens_hollows_at(&self, cells: usize) -> bool {
        cells >= self.carved_from && !self.is_carved_at(cells / 2)
    }

    /// Whether what is to be carved is carved in grids of this many cells.
    pub fn is_carved_at(&self, cells: usize) -> bool {
        self.carving.is_none() || cells >= self.carved_from
    }

    /// The share of hollows that the surface leaves open to the outside.
    pub fn open_hollows(&self, grids: &Grids) -> f64 {
        let Some(carving) = &self.carving else { return 1.0 };
        let grid = grids.shape.grid();
        open_share(grid, &grids.shape.values().to_dense(), |node| carving.stays_empty(grid.position(node)))
    }

    /// The share of the hull that is carved.
    pub fn carved_share(&self) -> f64 {
        self.carving.as_ref().map_or(0.0, SpaceCarving::share)
    }

    /// Forgets what was carved out of the hull.
    pub fn forget_carving(&mut self) {
        self.carving = None;
    }

    /// Whether stereo has a say in where the surface starts.
    pub fn has_stereo(&self) -> bool {
        self.fused.is_some()
    }

    /// Forgets what stereo says of the surface.
    pub fn forget_stereo(&mut self) {
        self.fused = None;
        self.stereo_is_doubted = true;
    }

    /// Whether what stereo says was forgotten.
    pub fn doubts_stereo(&self) -> bool {
        self.stereo_is_doubted
    }

    /// Distances of the masks' outlines, in the order of the training views.
    pub fn masks(&self) -> &[MaskDistance] {
        self.masks.all()
    }

    /// The grids of the first stage.
    pub fn first(&self, config: &GridConfig) -> Result<Grids> {
        let grid = padded_cube(config.first_cells);
        self.first_of(self.hull(&grid, config)?, config)
    }

    /// The same of the whole hull, whatever is carved out of it.
    pub fn first_of_whole_hull(&self, config: &GridConfig) -> Result<Grids> {
        self.first_of(self.hull_less(None, &padded_cube(config.first_cells), config)?, config)
    }

    fn first_of(&self, (base, active): (Vec<f32>, ActiveNodes), config: &GridConfig) -> Result<Grids> {
        let coarser = (active.grid().cells() / config.coarsest_cells).ilog2() as usize;
        let shape = ShapeGrid::new(active, &base, coarser);
        let active = coarsened(shape.active(), config.color_coarseness);
        let base = color::constant(self.mean_color).repeat(active.grid().len());
        // Two levels of colour: the finest and one coarser.
        Ok(Grids { shape, color: ColorGrid::new(active, &base, 1) })
    }

    /// Grids of twice the cells. Beyond `whole_cells`, only what is near the surface goes on learning.
    pub fn refined(&self, grids: &Grids, config: &GridConfig) -> Result<Grids> {
        let cells = 2 * grids.cells();
        if cells > config.whole_cells {
            let (shape, color) = (grids.shape.values().clone(), grids.color.values().clone());
            return self.on_frozen_base(grids, shape, color, config);
        }
        let grid = padded_cube(cells);
        let (base, active) = self.hull(&grid, config)?;
        let mut shape = grids.shape.refined(active, &base);
        if let Some(carving) = self.carving.as_ref().filter(|_| self.opens_hollows_at(cells)) {
            self.open_hollows_of(&mut shape, &base, carving, config)?;
        }
        let base = color::constant(self.mean_color).repeat((cells / config.color_coarseness + 1).pow(3));
        let color = grids.color.refined(coarsened(shape.active(), config.color_coarseness), &base);
        Ok(Grids { shape, color })
    }

    /// Carves a surface that was learned without hollows. The base of `shape` is carved; what was learned was added to one that
    /// was not, and would be taken off twice.
    fn open_hollows_of(
        &self,
        shape: &mut ShapeGrid,
        base: &[f32],
        carving: &SpaceCarving,
        config: &GridConfig,
    ) -> Result<()> {
        let grid = *shape.grid();
        let (whole, _) = self.hull_less(None, &grid, config)?;
        let values = shape.values();
        let lacking = |node: usize| {
            let value = values.at(grid.coordinates(node))[0];
            (whole[node] + value - base[node]).min(carving.at_thicker_walls(grid.position(node))) - value
        };
        let lacking: Vec<f32> = shape.active().iter().map(lacking).collect();
        shape.add_to_finest(&lacking);
        Ok(())
    }

    /// Grids of twice the cells that start from what was learned, `shape` and `color`, and only move what is near the
    /// surface.
    pub fn on_frozen_base(
        &self,
        grids: &Grids,
        shape: BrickValues<1>,
        color: BrickValues<CHANNELS>,
        config: &GridConfig,
    ) -> Result<Grids> {
        let grid = padded_cube(2 * grids.cells());
        let near = near_refined_surface(&grid, &shape, BAND_NODES);
        let disagreeing = config.disagreeing_views.of(self.masks.all().len());
        let detail = hull_detail(&self.masks, &near, disagreeing, &self.cancellation)?;
        let near_color = coarsened(&near, config.color_coarseness);
        let (shape, color) = (Arc::new(shape), Arc::new(color));
        Ok(Grids {
            color: ColorGrid::on_frozen_base(near_color, color, &[], grids.color.coarser() + 1),
            shape: ShapeGrid::on_frozen_base(near, shape, &detail, grids.shape.coarser() + 1),
        })
    }
}

/// The grid of this many cells along the edge of the padded unit cube.
fn padded_cube(cells: usize) -> VoxelGrid {
    VoxelGrid::new(cells + 1, UnitCube::default().half_extent() as f32)
}

/// The nodes of a grid coarser by a power of two.
fn coarsened(active: &ActiveNodes, factor: usize) -> ActiveNodes {
    (0..factor.ilog2()).fold(active.clone(), |active, _| active.coarser())
}
