//! The fast trainer: lattices, exact crossings, gradients by hand.

use dvr_core::hull::MaskDistance;
use dvr_kernels::{ActiveNodes, Lattice, SignMap};
use dvr_model::{LatticeField, LatticeValues};
use rayon::prelude::*;

use super::config::FastConfig;
use super::levels::Levels;
use super::rays::{Lesson, Scene, Tally, mean_object_color};
use super::scatter::{gather_color, gather_shape};
use super::start::hull_start;
use super::views::{FastView, PixelOrder, mix};
use crate::error::{Error, Result};
use crate::trainer::{StepReport, ViewSplit};

/// Half the edge of the cube that lattices cover: that of the padded unit cube.
const HALF_EXTENT: f32 = 0.55;

/// Rays that a task follows.
const CHUNK: usize = 64;

/// A lattice field in training.
pub struct FastTrainer<'a> {
    config: FastConfig,
    views: ViewSplit<'a>,
    packed: Vec<FastView>,
    masks: Vec<MaskDistance>,
    order: PixelOrder,
    shape: Levels<1>,
    shape_active: Vec<bool>,
    map: SignMap,
    color: Levels<3>,
    color_active: Vec<bool>,
    mean_color: [f32; 3],
    stage: usize,
    step: usize,
    rays_drawn: u64,
}

impl<'a> FastTrainer<'a> {
    /// Starts from the visual hull.
    ///
    /// # Errors
    /// When the configuration does not make sense, or the masks show no object.
    pub fn new(views: ViewSplit<'a>, config: FastConfig) -> Result<Self> {
        config.check()?;
        let masks: Vec<MaskDistance> =
            views.train.par_iter().map(|view| MaskDistance::new(&view.camera, &view.mask)).collect();
        let packed = FastView::pack(&views.train, config.neighbours);
        let lattice = Lattice::new(config.cells[0] + 1, HALF_EXTENT);
        let (shape, shape_active) = shape_start(&masks, &lattice, &config);
        let map = SignMap::new(&lattice, shape.baked());
        let mean_color = mean_object_color(&views.train).to_array();
        let (color, color_active) = color_start(&shape, mean_color, &config);
        // Pixels whose rays come as close to the object as the band around the hull.
        let margin = |view: usize| {
            let camera = &views.train[view].camera;
            let depth = camera.center().length().max(f64::from(HALF_EXTENT));
            (4.0 * f64::from(lattice.spacing()) * camera.intrinsics.x_axis.x.abs() / depth) as f32 + 1.0
        };
        let order = PixelOrder::new(&views.train, &masks, margin);
        if order.len() == 0 {
            return Err(Error::Config("no mask shows any object: there is nothing to train on".into()));
        }
        Ok(Self {
            config,
            views,
            packed,
            masks,
            order,
            shape,
            shape_active,
            map,
            color,
            color_active,
            mean_color,
            stage: 0,
            step: 0,
            rays_drawn: 0,
        })
    }

    /// The configuration.
    pub fn config(&self) -> &FastConfig {
        &self.config
    }

    /// The views, divided.
    pub fn views(&self) -> &ViewSplit<'a> {
        &self.views
    }

    /// Steps done so far.
    pub fn steps_done(&self) -> usize {
        self.step
    }

    /// Steps of all stages.
    pub fn total_steps(&self) -> usize {
        self.config.steps.iter().sum()
    }

    /// Parameters of all levels of shape and colour.
    pub fn parameters(&self) -> usize {
        self.shape.parameters() + self.color.parameters()
    }

    /// The field as it is now.
    pub fn field(&self) -> LatticeField {
        LatticeField::new(
            LatticeValues { lattice: *self.shape.lattice(), values: self.shape.baked().to_vec() },
            LatticeValues { lattice: *self.color.lattice(), values: self.color.baked().to_vec() },
        )
    }

    /// One step: rays to lessons, lessons to gradients, gradients to parameters. Refines first where a stage ends.
    pub fn step(&mut self) -> StepReport {
        let ends: usize = self.config.steps[..=self.stage].iter().sum();
        if self.step >= ends && self.stage + 1 < self.config.cells.len() {
            self.refine();
        }
        let (lessons, tally) = self.lessons();
        let (gradient, active) = self.shape.gradient_mut();
        gather_shape(&lessons, active, &self.shape_active, gradient);
        let (gradient, active) = self.color.gradient_mut();
        gather_color(&lessons, active, &self.color_active, gradient);
        let decay = self.decay();
        let config = &self.config;
        let rate = |first: f64, ratio: f64| move |level: usize| (first * decay * ratio.powi(level as i32)) as f32;
        self.shape.step(rate(config.shape_rate, config.shape_rate_ratio));
        self.color.step(rate(config.color_rate, config.color_rate_ratio));
        self.map.rebuild(self.shape.baked());
        self.step += 1;
        self.rays_drawn += config.rays as u64;
        self.report(&tally, config.shape_rate * decay)
    }

    /// Factor of the step sizes: falls exponentially to `final_rate`.
    fn decay(&self) -> f64 {
        self.config.final_rate.powf(self.step as f64 / self.total_steps().max(1) as f64)
    }

    /// Follows the rays of one step.
    fn lessons(&self) -> (Vec<Lesson>, Tally) {
        let scene = Scene {
            views: &self.packed,
            shape: self.shape.lattice(),
            values: self.shape.baked(),
            active: &self.shape_active,
            map: &self.map,
            colors: self.color.lattice(),
            color_values: self.color.baked(),
            losses: &self.config.losses,
            compared_views: self.config.compared_views,
        };
        let seed = self.config.seed;
        let chunks: Vec<(Vec<Lesson>, Tally)> = (0..self.config.rays.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut tally = Tally::default();
                let lessons = (chunk * CHUNK..((chunk + 1) * CHUNK).min(self.config.rays))
                    .filter_map(|ray| {
                        let count = self.rays_drawn + ray as u64;
                        let (view, index) = self.order.pick(count, seed);
                        let pixel = self.packed[view as usize].pixel_ray(view, index);
                        scene.lesson(&pixel, mix(seed ^ mix(count)), &mut tally)
                    })
                    .collect();
                (lessons, tally)
            })
            .collect();
        let mut total = Tally::default();
        chunks.iter().for_each(|(_, tally)| total.add(tally));
        (chunks.into_iter().flat_map(|(lessons, _)| lessons).collect(), total)
    }

    /// The next stage: twice the cells.
    fn refine(&mut self) {
        self.stage += 1;
        let lattice = Lattice::new(self.config.cells[self.stage] + 1, HALF_EXTENT);
        let disagreeing = self.config.disagreeing_views.of(self.masks.len());
        let (base, active) = hull_start(&self.masks, &lattice, disagreeing);
        self.shape_active = membership(&active);
        self.shape = self.shape.refined(active, base);
        self.map = SignMap::new(&lattice, self.shape.baked());
        let color_lattice = Lattice::new(self.config.cells[self.stage] / self.config.color_coarseness + 1, HALF_EXTENT);
        let active = coarsened(self.shape.active(), self.config.color_coarseness);
        let base = self.mean_color.repeat(color_lattice.len());
        self.color_active = membership(&active);
        self.color = self.color.refined(active, base);
    }

    fn report(&self, tally: &Tally, learning_rate: f64) -> StepReport {
        let losses = &self.config.losses;
        let mean = 1.0 / self.config.rays as f64;
        let terms = vec![
            ("color", losses.color * tally.color * mean),
            ("cross_view", losses.cross_view * tally.cross_view * mean / self.config.compared_views.max(1) as f64),
            ("depth", losses.depth * tally.depth * mean),
            ("mask", losses.mask * tally.mask * mean),
        ];
        StepReport {
            step: self.step,
            loss: terms.iter().map(|(_, value)| value).sum(),
            terms,
            mask_iou: if tally.union == 0 { 1.0 } else { tally.intersection as f64 / tally.union as f64 },
            learning_rate,
            samples: 0,
        }
    }
}

/// Whether each node of the lattice is in the set.
fn membership(active: &ActiveNodes) -> Vec<bool> {
    let mut member = vec![false; active.lattice().len()];
    active.iter().for_each(|node| member[node] = true);
    member
}

/// The nodes of a lattice coarser by a power of two.
fn coarsened(active: &ActiveNodes, factor: usize) -> ActiveNodes {
    (0..factor.ilog2()).fold(active.clone(), |active, _| active.coarser())
}

fn shape_start(masks: &[MaskDistance], lattice: &Lattice, config: &FastConfig) -> (Levels<1>, Vec<bool>) {
    let (base, active) = hull_start(masks, lattice, config.disagreeing_views.of(masks.len()));
    let member = membership(&active);
    let coarser = (lattice.cells() / config.coarsest_cells).ilog2() as usize;
    (Levels::new(active, base, coarser), member)
}

fn color_start(shape: &Levels<1>, mean: [f32; 3], config: &FastConfig) -> (Levels<3>, Vec<bool>) {
    let active = coarsened(shape.active(), config.color_coarseness);
    let lattice = *active.lattice();
    let base = mean.repeat(lattice.len());
    let member = membership(&active);
    // Two levels of colour: the finest and one coarser.
    (Levels::new(active, base, 1), member)
}
