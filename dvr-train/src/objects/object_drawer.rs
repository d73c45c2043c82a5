//! Which objects a step learns from, and what the encoder sees of them.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use dvr_core::Split;
use dvr_core::dataset::{InputPicture, ObjectDataset};
use dvr_model::EncoderConfig;
use rand::Rng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use crate::error::{Error, Result};
use crate::learners::trainer::step_rng;

/// How many objects, one after the other, may be broken before training gives up.
const TRIES: usize = 32;

/// The random streams of epochs start here; those of steps, far below, are theirs.
const FIRST_EPOCH_STREAM: u64 = 1 << 62;

/// Draws the training objects of each step. Step `k` depends on the seed, `k` and the files, and on nothing else.
pub struct ObjectDrawer {
    dataset: Arc<ObjectDataset>,
    /// The training objects.
    objects: Vec<usize>,
    /// Objects a step.
    count: usize,
    seed: u64,
    /// What sees the pictures.
    encoder: EncoderConfig,
    broken: Mutex<BTreeMap<usize, String>>,
}

/// An object of a step.
pub struct DrawnObject<T> {
    /// Its place among the training objects.
    pub row: usize,
    /// What the encoder sees of it.
    pub input: Option<InputPicture>,
    /// What is learned from.
    pub target: T,
}

impl ObjectDrawer {
    /// # Errors
    /// When the dataset has no training objects.
    pub fn new(dataset: Arc<ObjectDataset>, count: usize, seed: u64, encoder: &EncoderConfig) -> Result<Self> {
        let objects = dataset.of_split(Split::Train);
        if objects.is_empty() {
            return Err(dvr_core::Error::format(
                dataset.root(),
                "there are no objects to train on",
                "Name them in `train.lst`, one a line, in the folder of each category.",
            )
            .into());
        }
        Ok(Self { dataset, objects, count, seed, encoder: encoder.clone(), broken: Mutex::default() })
    }

    /// How many objects are trained on.
    pub fn objects(&self) -> usize {
        self.objects.len()
    }

    /// The objects that could not be used so far, by their index in the dataset, with the reason.
    pub fn broken(&self) -> BTreeMap<usize, String> {
        self.broken.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Draws the objects of a step, counted from 1; `target` reads what is learned from an object, given its index in the
    /// dataset. The numbers that follow in the step's random stream come with them.
    ///
    /// Every epoch goes through all objects in an order of its own. In the place of an object that is broken another
    /// one is drawn.
    ///
    /// # Errors
    /// When many objects in a row are broken.
    pub fn draw<T>(
        &self,
        step: usize,
        target: impl Fn(usize, &mut ChaCha8Rng) -> Result<T>,
    ) -> Result<(Vec<DrawnObject<T>>, ChaCha8Rng)> {
        let mut rng = step_rng(self.seed, step as u64);
        let drawn = self.places(step).into_iter().map(|row| self.draw_some(row, &mut rng, &target));
        Ok((drawn.collect::<Result<Vec<_>>>()?, rng))
    }

    /// The training objects of a step, by their place among them.
    fn places(&self, step: usize) -> Vec<usize> {
        let count = self.objects.len();
        let first = (step - 1) * self.count;
        let (mut epoch, mut order) = (usize::MAX, Vec::new());
        (first..first + self.count)
            .map(|place| {
                if place / count != epoch {
                    epoch = place / count;
                    order = (0..count).collect();
                    order.shuffle(&mut step_rng(self.seed, FIRST_EPOCH_STREAM + epoch as u64));
                }
                order[place % count]
            })
            .collect()
    }

    /// Reads an object, or another one instead of it.
    fn draw_some<T>(
        &self,
        mut row: usize,
        rng: &mut ChaCha8Rng,
        target: &impl Fn(usize, &mut ChaCha8Rng) -> Result<T>,
    ) -> Result<DrawnObject<T>> {
        let mut last = None;
        for _ in 0..TRIES {
            // The numbers drawn for an object are a stream of their own: what is read of it does not depend on others.
            let stream = rng.random();
            match self.draw_one(row, stream, target) {
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

    fn draw_one<T>(
        &self,
        row: usize,
        stream: u64,
        target: &impl Fn(usize, &mut ChaCha8Rng) -> Result<T>,
    ) -> Result<DrawnObject<T>> {
        let object = self.objects[row];
        let mut rng = step_rng(self.seed, stream);
        let input = match self.encoder.image_size() {
            None => None,
            Some(size) => {
                let input = rng.random_range(0..self.dataset.inputs(object)?);
                let picture = self.dataset.read_input(object, input, size as u32)?;
                if picture.camera.is_none() && self.encoder.local_channels().is_some() {
                    let path = &self.dataset.objects()[object].path;
                    let problem = format!("the camera of view {input} is unusable, or its picture a mirror image");
                    let remedy = "Encoders of kinds `local` and `local-bn` see views with cameras: mend cameras.npz.";
                    return Err(dvr_core::Error::format(path, problem, remedy).into());
                }
                Some(picture)
            }
        };
        Ok(DrawnObject { row, input, target: target(object, &mut rng)? })
    }
}
