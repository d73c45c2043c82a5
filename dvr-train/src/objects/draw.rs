//! What a step looks at: which objects, which picture of each goes to the encoder, and what it learns from.

use std::sync::Arc;

use dvr_core::dataset::{InputPicture, ObjectDataset};
use dvr_core::{MirrorAxis, OccupancySamples, View};
use glam::Vec3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::color_jitter::ColorJitter;
use super::config::ObjectsConfig;
use super::hulls::{CoarseHull, Hulls};
use super::object_drawer::ObjectDrawer;
use crate::error::{Error, Result};
use crate::learners::batch::Pixels;
use crate::learners::objective::StepNoise;
use dvr_core::Supervision;

/// The objects of one step and what they show, before it goes to a device.
#[derive(Clone, Debug)]
pub struct ObjectsBatch {
    /// Place of each object among the training objects.
    pub rows: Vec<i64>,
    /// What the encoder sees of each object; empty where it sees nothing.
    pub inputs: Vec<InputPicture>,
    /// What is learned from.
    pub targets: Targets,
}

/// What is learned from in a step. `owner` is the place of the object in the batch.
#[derive(Clone, Debug)]
pub enum Targets {
    /// Pixels of posed views, and points of the visual hulls, where these are used.
    Pixels { pixels: Pixels, owner: Vec<i64>, noise: StepNoise, hull: KnownPoints },
    /// Points of the true shape.
    Points(KnownPoints),
}

/// Points, and whether they are inside.
#[derive(Clone, Debug, Default)]
pub struct KnownPoints {
    pub points: Vec<Vec3>,
    pub inside: Vec<bool>,
    pub owner: Vec<i64>,
}

impl KnownPoints {
    /// Adds points of the object at a place in the batch, in the mirror, where there is one.
    fn extend(&mut self, samples: &[(Vec3, bool)], place: usize, mirror: Option<MirrorAxis>) {
        self.points.extend(samples.iter().map(|(point, _)| mirror.map_or(*point, |axis| axis.mirrored(*point))));
        self.inside.extend(samples.iter().map(|(_, inside)| *inside));
        self.owner.resize(self.points.len(), place as i64);
    }

    /// Those of the first `objects` objects; the others stay, and their objects are counted anew.
    fn take_first(&mut self, objects: i64) -> Self {
        let owner = take_owners(&mut self.owner, objects);
        let count = owner.len();
        Self { points: self.points.drain(..count).collect(), inside: self.inside.drain(..count).collect(), owner }
    }
}

/// The owners that are among the first `objects` objects; the others stay, and are counted anew.
fn take_owners(owner: &mut Vec<i64>, objects: i64) -> Vec<i64> {
    let first: Vec<i64> = owner.drain(..owner.partition_point(|owner| *owner < objects)).collect();
    owner.iter_mut().for_each(|owner| *owner -= objects);
    first
}

impl ObjectsBatch {
    /// The first `count` objects; the others stay.
    pub fn take_first(&mut self, count: usize) -> Self {
        let pictures = count.min(self.inputs.len());
        Self {
            rows: self.rows.drain(..count).collect(),
            inputs: self.inputs.drain(..pictures).collect(),
            targets: self.targets.take_first(count as i64),
        }
    }
}

impl Targets {
    /// How many pixels or points there are, beside those of hulls.
    pub fn len(&self) -> usize {
        match self {
            Self::Pixels { owner, .. } => owner.len(),
            Self::Points(points) => points.points.len(),
        }
    }

    /// What belongs to the first `objects` objects; the others stay, and are counted anew.
    fn take_first(&mut self, objects: i64) -> Self {
        match self {
            Self::Pixels { pixels, owner, noise, hull } => {
                let owner = take_owners(owner, objects);
                Self::Pixels {
                    pixels: pixels.take_first(owner.len()),
                    noise: noise.take_first(owner.len()),
                    hull: hull.take_first(objects),
                    owner,
                }
            }
            Self::Points(points) => Self::Points(points.take_first(objects)),
        }
    }
}

/// Draws the batches of a run. Batch `k` depends on the seed, `k` and the files, and on nothing else.
pub(crate) struct BatchDrawer {
    dataset: Arc<ObjectDataset>,
    config: ObjectsConfig,
    objects: ObjectDrawer,
    /// Where visual hulls are learned from.
    hulls: Option<Hulls>,
}

/// What is learned from an object.
struct ObjectTargets {
    seen: SeenOrKnown,
    /// Points of its visual hull.
    hull_points: Vec<(Vec3, bool)>,
    /// Whether it is learned from in the mirror.
    mirror: Option<MirrorAxis>,
    /// Its colours, where they are others.
    jitter: Option<ColorJitter>,
}

enum SeenOrKnown {
    Views(Vec<View>, Option<Arc<CoarseHull>>),
    Points(Vec<(Vec3, bool)>),
}

impl BatchDrawer {
    /// # Errors
    /// When the dataset has no training objects.
    pub fn new(dataset: Arc<ObjectDataset>, config: ObjectsConfig) -> Result<Self> {
        let objects = ObjectDrawer::new(dataset.clone(), config.objects, config.train.seed, &config.encoder)?;
        let hulls = config.uses_hulls().then(|| config.hulls());
        Ok(Self { dataset, config, objects, hulls })
    }

    /// The objects.
    pub fn objects(&self) -> &ObjectDrawer {
        &self.objects
    }

    /// Draws the batch of a step, counted from 1.
    ///
    /// # Errors
    /// When many objects in a row are broken.
    pub fn draw(&self, step: usize) -> Result<ObjectsBatch> {
        let (drawn, mut rng) = self.objects.draw(step, |object, rng| self.draw_targets(object, rng))?;
        let rows = drawn.iter().map(|object| object.row as i64).collect();
        let (mut inputs, mut pixels, mut owner) = (Vec::new(), Pixels::default(), Vec::new());
        let (mut known, mut hull_points) = (KnownPoints::default(), KnownPoints::default());
        for (place, object) in drawn.into_iter().enumerate() {
            let target = object.target;
            inputs.extend(object.input.map(|input| {
                let mut input = target.mirror.map_or(input.clone(), |axis| input.mirrored(axis));
                target.jitter.iter().for_each(|jitter| jitter.picture(&mut input.image));
                input
            }));
            hull_points.extend(&target.hull_points, place, target.mirror);
            match target.seen {
                SeenOrKnown::Views(views, hull) => {
                    let views: Vec<&View> = views.iter().collect();
                    let first = pixels.len();
                    pixels.draw(&views, self.config.train.sampling(), &mut rng);
                    if let Some(hull) = hull {
                        pixels.z_depth.truncate(first);
                        pixels.z_depth.extend(pixels.rays[first..].iter().map(|ray| hull.depth(ray)));
                    }
                    target.jitter.iter().for_each(|jitter| jitter.colors(&mut pixels.color[3 * first..]));
                    if let Some(axis) = target.mirror {
                        pixels.rays[first..].iter_mut().for_each(|ray| *ray = axis.mirrored_ray(ray));
                    }
                    owner.resize(pixels.len(), place as i64);
                }
                SeenOrKnown::Points(samples) => known.extend(&samples, place, target.mirror),
            }
        }
        let targets = if self.config.train.supervision == Supervision::Occupancy {
            Targets::Points(known)
        } else {
            let noise = StepNoise::draw(&self.config.train, pixels.len(), &mut rng);
            Targets::Pixels { pixels, owner, noise, hull: hull_points }
        };
        Ok(ObjectsBatch { rows, inputs, targets })
    }

    fn draw_targets(&self, object: usize, rng: &mut ChaCha8Rng) -> Result<ObjectTargets> {
        let mirror = self.config.mirror_axis().filter(|_| rng.random_bool(0.5));
        if self.config.train.supervision == Supervision::Occupancy {
            let seen = SeenOrKnown::Points(self.draw_points(object, rng)?);
            let jitter = ColorJitter::draw(self.config.color_jitter, rng);
            return Ok(ObjectTargets { seen, hull_points: Vec::new(), mirror, jitter });
        }
        let hull = self.hulls.as_ref().map(|hulls| hulls.of(&self.dataset, object)).transpose()?;
        let count = self.config.hull_points();
        let near = (count as f64 * NEAR_SHARE).round() as usize;
        let hull_points = hull.as_ref().map_or_else(Vec::new, |hull| hull.draw_points(near, count - near, rng));
        let depth_of = hull.filter(|_| self.config.hull_stands_for_depth());
        let seen = SeenOrKnown::Views(self.draw_views(object, rng)?, depth_of);
        Ok(ObjectTargets { seen, hull_points, mirror, jitter: ColorJitter::draw(self.config.color_jitter, rng) })
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
        let all: Vec<usize> = (0..samples.points.len()).collect();
        let share = |share: f64| (self.config.points as f64 * share).round() as usize;
        let (boxed, within) = (share(self.config.box_share), share(self.config.inside_share));
        let near = if boxed > 0 { in_padded_box(&samples) } else { Vec::new() };
        let inside = if within > 0 { all.iter().copied().filter(|i| samples.inside[*i]).collect() } else { Vec::new() };
        Ok((0..self.config.points)
            .map(|point| {
                let among = if point < boxed {
                    &near
                } else if point < boxed + within {
                    &inside
                } else {
                    &all
                };
                // Nothing is inside.
                let among = if among.is_empty() { &all } else { among };
                let i = among[rng.random_range(0..among.len())];
                (samples.points[i], samples.inside[i])
            })
            .collect())
    }
}

/// Share of the points of a visual hull that are drawn near where it ends, the others anywhere in the cube.
const NEAR_SHARE: f64 = 0.3;

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
