//! What a step looks at: which objects, which picture of each goes to the encoder, and what it learns from.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use dvr_core::dataset::ObjectDataset;
use dvr_core::{OccupancySamples, Split, View};
use glam::Vec3;
use image::RgbImage;
use rand::Rng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::config::ObjectsConfig;
use super::hulls::{CoarseHull, Hulls};
use crate::error::{Error, Result};
use crate::learners::batch::Pixels;
use crate::learners::objective::StepNoise;
use crate::learners::trainer::step_rng;
use dvr_core::Supervision;

/// The objects of one step and what they show, before it goes to a device.
#[derive(Clone, Debug)]
pub(crate) struct ObjectsBatch {
    /// Place of each object among the training objects.
    pub rows: Vec<i64>,
    /// What the encoder sees of each object; empty where it sees nothing.
    pub inputs: Vec<RgbImage>,
    /// What is learned from.
    pub ray_gradient: RayGradient,
}

/// What is learned from in a step. `owner` is the place of the object in the batch.
#[derive(Clone, Debug)]
pub(crate) enum RayGradient {
    /// Pixels of posed views.
    Pixels { pixels: Pixels, owner: Vec<i64>, noise: StepNoise },
    /// Points, and whether they are inside.
    Points { points: Vec<Vec3>, inside: Vec<bool>, owner: Vec<i64> },
}

impl ObjectsBatch {
    /// The first `count` objects; the others stay.
    pub fn take_first(&mut self, count: usize) -> Self {
        let pictures = count.min(self.inputs.len());
        Self {
            rows: self.rows.drain(..count).collect(),
            inputs: self.inputs.drain(..pictures).collect(),
            ray_gradient: self.ray_gradient.take_first(count as i64),
        }
    }
}

impl RayGradient {
    /// How many pixels or points there are.
    pub fn len(&self) -> usize {
        match self {
            Self::Pixels { owner, .. } | Self::Points { owner, .. } => owner.len(),
        }
    }

    /// What belongs to the first `objects` objects; the others stay, and are counted anew.
    fn take_first(&mut self, objects: i64) -> Self {
        let take_owners = |owner: &mut Vec<i64>| {
            let first: Vec<i64> = owner.drain(..owner.partition_point(|owner| *owner < objects)).collect();
            owner.iter_mut().for_each(|owner| *owner -= objects);
            first
        };
        match self {
            Self::Pixels { pixels, owner, noise } => {
                let owner = take_owners(owner);
                Self::Pixels { pixels: pixels.take_first(owner.len()), noise: noise.take_first(owner.len()), owner }
            }
            Self::Points { points, inside, owner } => {
                let owner = take_owners(owner);
                let count = owner.len();
                Self::Points { points: points.drain(..count).collect(), inside: inside.drain(..count).collect(), owner }
            }
        }
    }
}

/// Draws the batches of a run. Batch `k` depends on the seed, `k` and the files, and on nothing else.
pub(crate) struct BatchDrawer {
    dataset: Arc<ObjectDataset>,
    config: ObjectsConfig,
    /// The training objects.
    objects: Vec<usize>,
    /// Where the masks' hulls stand for depth maps.
    hulls: Option<Hulls>,
    broken: Mutex<BTreeMap<usize, String>>,
}

/// One object of a batch.
struct Drawn {
    row: usize,
    input: Option<RgbImage>,
    ray_gradient: DrawnLesson,
}

enum DrawnLesson {
    Views(Vec<View>, Option<Arc<CoarseHull>>),
    Points(Vec<(Vec3, bool)>),
}

/// How many objects, one after the other, may be broken before training gives up.
const TRIES: usize = 32;

/// The random streams of epochs start here; those of steps, far below, are theirs.
const FIRST_EPOCH_STREAM: u64 = 1 << 62;

impl BatchDrawer {
    /// # Errors
    /// When the dataset has no training objects.
    pub fn new(dataset: Arc<ObjectDataset>, config: ObjectsConfig) -> Result<Self> {
        let objects = dataset.of_split(Split::Train);
        if objects.is_empty() {
            return Err(dvr_core::Error::format(
                dataset.root(),
                "there are no objects to train on",
                "Name them in `train.lst`, one a line, in the folder of each category.",
            )
            .into());
        }
        let hulls = config.uses_hulls().then(|| Hulls::new(config.train.hull.resolution));
        Ok(Self { dataset, config, objects, hulls, broken: Mutex::default() })
    }

    /// How many objects are trained on.
    pub fn objects(&self) -> usize {
        self.objects.len()
    }

    /// The objects that could not be used so far, by their index in the dataset, with the reason.
    pub fn broken(&self) -> BTreeMap<usize, String> {
        self.broken.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Draws the batch of a step, counted from 1.
    ///
    /// Every epoch goes through all objects in an order of its own. In the place of an object that is broken another
    /// one is drawn.
    ///
    /// # Errors
    /// When many objects in a row are broken.
    pub fn draw(&self, step: usize) -> Result<ObjectsBatch> {
        let mut rng = step_rng(self.config.train.seed, step as u64);
        let drawn =
            self.places(step).into_iter().map(|row| self.draw_some(row, &mut rng)).collect::<Result<Vec<_>>>()?;
        let rows = drawn.iter().map(|object| object.row as i64).collect();
        let (mut inputs, mut pixels, mut owner) = (Vec::new(), Pixels::default(), Vec::new());
        let (mut points, mut inside) = (Vec::new(), Vec::new());
        for (place, object) in drawn.into_iter().enumerate() {
            inputs.extend(object.input);
            match object.ray_gradient {
                DrawnLesson::Views(views, hull) => {
                    let views: Vec<&View> = views.iter().collect();
                    let first = pixels.len();
                    pixels.draw(&views, self.config.train.sampling(), &mut rng);
                    if let Some(hull) = hull {
                        pixels.z_depth.truncate(first);
                        pixels.z_depth.extend(pixels.rays[first..].iter().map(|ray| hull.depth(ray)));
                    }
                    owner.resize(pixels.len(), place as i64);
                }
                DrawnLesson::Points(samples) => {
                    points.extend(samples.iter().map(|(point, _)| *point));
                    inside.extend(samples.iter().map(|(_, inside)| *inside));
                    owner.resize(points.len(), place as i64);
                }
            }
        }
        let ray_gradient = if self.config.train.supervision == Supervision::Occupancy {
            RayGradient::Points { points, inside, owner }
        } else {
            let noise = StepNoise::draw(&self.config.train, pixels.len(), &mut rng);
            RayGradient::Pixels { pixels, owner, noise }
        };
        Ok(ObjectsBatch { rows, inputs, ray_gradient })
    }

    /// The training objects of a step, by their place among them.
    fn places(&self, step: usize) -> Vec<usize> {
        let count = self.objects.len();
        let first = (step - 1) * self.config.objects;
        let (mut epoch, mut order) = (usize::MAX, Vec::new());
        (first..first + self.config.objects)
            .map(|place| {
                if place / count != epoch {
                    epoch = place / count;
                    order = (0..count).collect();
                    order.shuffle(&mut step_rng(self.config.train.seed, FIRST_EPOCH_STREAM + epoch as u64));
                }
                order[place % count]
            })
            .collect()
    }

    /// Reads an object, or another one instead of it.
    fn draw_some(&self, mut row: usize, rng: &mut ChaCha8Rng) -> Result<Drawn> {
        let mut last = None;
        for _ in 0..TRIES {
            // The numbers drawn for an object are a stream of their own: what is read of it does not depend on others.
            let stream = rng.random();
            match self.draw_one(row, stream) {
                Ok(drawn) => return Ok(drawn),
                Err(problem) => {
                    let mut broken = self.broken.lock().unwrap_or_else(PoisonError::into_inner);
                    broken.entry(self.objects[row]).or_insert_with(|| problem.to_string());
                    last = Some(problem);
                }
            }
            row = rng.random_range(0..self.objects.len());
        }
        let reason = last.map_or(String::new(), |problem: Error| problem.to_string());
        Err(Error::BrokenObjects {
            dataset: self.dataset.root().to_owned(),
            tries: TRIES,
            last: reason.trim_end_matches('.').to_owned(),
        })
    }

    fn draw_one(&self, row: usize, stream: u64) -> Result<Drawn> {
        let (dataset, config, object) = (&self.dataset, &self.config, self.objects[row]);
        let mut rng = step_rng(config.train.seed, stream);
        let input = match config.encoder.image_size() {
            None => None,
            Some(size) => {
                let input = rng.random_range(0..dataset.inputs(object)?);
                Some(dataset.read_input(object, input, size as u32)?)
            }
        };
        let ray_gradient = if config.train.supervision == Supervision::Occupancy {
            DrawnLesson::Points(self.draw_points(object, &mut rng)?)
        } else {
            let hull = self.hulls.as_ref().map(|hulls| hulls.of(dataset, object)).transpose()?;
            DrawnLesson::Views(self.draw_views(object, &mut rng)?, hull)
        };
        Ok(Drawn { row, input, ray_gradient })
    }

    fn draw_views(&self, object: usize, rng: &mut ChaCha8Rng) -> Result<Vec<View>> {
        let count = self.dataset.views(object)?;
        let read = |view: usize| -> Result<View> {
            let view = self.dataset.read_view(object, view)?;
            if view.depth.is_none() && self.config.train.losses.depth > 0.0 {
                let object = &self.dataset.objects()[object];
                let scene = format!("{}, view {}", object.path.display(), view.name);
                return Err(Error::NeedsDepth { supervision: self.config.train.supervision, scene });
            }
            Ok(view)
        };
        if self.config.one_view {
            return Ok(vec![read(training_view(self.config.train.seed, &self.dataset, object, count))?]);
        }
        (0..self.config.views).map(|_| read(rng.random_range(0..count))).collect()
    }

    fn draw_points(&self, object: usize, rng: &mut ChaCha8Rng) -> Result<Vec<(Vec3, bool)>> {
        let samples = self.dataset.read_occupancy(object)?.filter(|samples| !samples.points.is_empty());
        let Some(samples) = samples else {
            let path = &self.dataset.objects()[object].path;
            let remedy = "Occupancy supervision needs it in every object; rgb and depth do not.";
            return Err(dvr_core::Error::format(path, "there is no points.npz, or it is empty", remedy).into());
        };
        let boxed = (self.config.points as f64 * self.config.box_share).round() as usize;
        let near = if boxed > 0 { in_padded_box(&samples) } else { Vec::new() };
        let all: Vec<usize> = (0..samples.points.len()).collect();
        Ok((0..self.config.points)
            .map(|point| {
                let among = if point < boxed && !near.is_empty() { &near } else { &all };
                let i = among[rng.random_range(0..among.len())];
                (samples.points[i], samples.inside[i])
            })
            .collect())
    }
}

/// The box of an object is padded by this share of its longest edge on each side, as Occupancy Networks pad the cube.
const PADDING: f32 = 0.05;

/// The samples in the padded box around those that are inside; none where nothing is inside.
fn in_padded_box(samples: &OccupancySamples) -> Vec<usize> {
    let inside = || samples.points.iter().zip(&samples.inside).filter_map(|(point, inside)| inside.then_some(*point));
    let (low, high) = (inside().fold(Vec3::INFINITY, Vec3::min), inside().fold(Vec3::NEG_INFINITY, Vec3::max));
    let padding = PADDING * (high - low).max_element();
    let (low, high) = (low - padding, high + padding);
    let is_near = |point: &Vec3| point.cmpge(low).all() && point.cmple(high).all();
    samples.points.iter().enumerate().filter_map(|(i, point)| is_near(point).then_some(i)).collect()
}

/// The one view of an object that is learned from with `one_view`: a hash of the seed and the object's name, so that it stays
/// the same when the dataset grows.
fn training_view(seed: u64, dataset: &ObjectDataset, object: usize, views: usize) -> usize {
    let object = &dataset.objects()[object];
    (stable_hash(seed, &[&object.category, &object.name]) % views as u64) as usize
}

/// A hash of names that is the same on every machine and in every version: FNV-1a, stirred once more (SplitMix64).
pub(crate) fn stable_hash(seed: u64, names: &[&str]) -> u64 {
    let bytes = names.iter().flat_map(|name| name.bytes().chain([0]));
    let hash = seed
        .to_le_bytes()
        .into_iter()
        .chain(bytes)
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3));
    let stirred = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let stirred = (stirred ^ (stirred >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    stirred ^ (stirred >> 31)
}
