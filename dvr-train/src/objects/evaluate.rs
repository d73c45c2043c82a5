//! Evaluation over a split of a dataset: in parallel, in parts, and from where it was stopped.

use std::collections::HashMap;
use std::path::Path;
use std::sync::mpsc::channel;

use dvr_core::dataset::ObjectDataset;
use dvr_core::record::{Digest, RecordKey};
use dvr_core::{Cancellation, Split};
use dvr_render::MeshShader;
use dvr_render::extract::ExtractSettings;
use rayon::prelude::*;

use super::predictor::{Predictor, evaluated_input};
use super::results::{ObjectScore, Results, Unmeasured};
use crate::error::{Error, Result};
use crate::observer::Observer;
use dvr_render::view_metrics;

/// A part of the objects: every `of`-th, starting with number `number`, counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which part, from 1.
    pub number: usize,
    /// Of how many.
    pub of: usize,
}

impl Shard {
    /// All objects.
    pub const WHOLE: Self = Self { number: 1, of: 1 };
}

/// Objects whose files are read between two reports of progress.
const CHUNK: usize = 64;

/// What is to be measured on which objects.
pub struct Evaluation<'a> {
    /// The objects.
    pub dataset: &'a ObjectDataset,
    /// What makes their shapes.
    pub predictor: &'a Predictor,
    /// Which of the objects.
    pub split: Split,
    /// Which part of these.
    pub shard: Shard,
    /// How models are made meshes.
    pub extraction: &'a ExtractSettings,
    /// The key of its rows, but for the object's files.
    pub key: &'a RecordKey,
    /// The folder in which shapes are kept, where they are, as [`Evaluation::shape_files`] says.
    pub kept_in: Option<&'a Path>,
}

impl Evaluation<'_> {
    /// Measures the objects that are not yet in `results`, which hears of each when it is done, and again those whose
    /// key is another by now. Objects that cannot be measured are added to the results as such.
    ///
    /// The figures of an object depend on its key alone. Where `cancellation` says so, the work ends
    /// after the objects that are under way.
    ///
    /// # Errors
    /// When results cannot be written.
    pub fn run(&self, results: &mut Results, cancellation: &Cancellation, observer: &mut dyn Observer) -> Result<()> {
        let (seed, views) = (results.measurement.seed, results.measurement.views);
        let wanted = self.wanted(results, cancellation, observer)?;
        observer.phase("evaluating objects", wanted.len());
        let mut failed: Option<Error> = None;
        rayon::in_place_scope(|scope| {
            let (sender, receiver) = channel();
            let wanted = &wanted;
            scope.spawn(move |_| {
                // Ends early where somebody asks, or nobody listens any more.
                let _ = wanted.par_iter().try_for_each_with(sender, |sender, (object, key)| {
                    let score = || self.score(*object, key, seed, views);
                    let stop = cancellation.is_cancelled();
                    (!stop).then(|| sender.send((*object, score())).ok()).flatten()
                });
            });
            for (done, (object, score)) in receiver.iter().enumerate() {
                let added = match score {
                    Ok(score) => results.add(score),
                    Err(problem) => self.leave_out(object, &problem, results, observer),
                };
                if let Err(error) = added {
                    failed = Some(error);
                    return;
                }
                observer.progress(done + 1, "");
            }
        });
        failed.map_or(Ok(()), Err)
    }

    /// The files in which shapes are kept, within their folder: `shapes/CATEGORY/NAME.ply`.
    pub fn shape_files(&self) -> Vec<String> {
        let file = |object| {
            let (category, name) = self.name(object);
            shape_file(category, name)
        };
        self.objects().map(file).collect()
    }

    /// The objects of the shard.
    fn objects(&self) -> impl Iterator<Item = usize> {
        self.dataset.of_split(self.split).into_iter().skip(self.shard.number - 1).step_by(self.shard.of)
    }

    /// The objects of the shard whose figures are not there yet, with their keys. Rows of other keys leave the results.
    fn wanted(
        &self,
        results: &mut Results,
        cancellation: &Cancellation,
        observer: &mut dyn Observer,
    ) -> Result<Vec<(usize, RecordKey)>> {
        let shard: Vec<usize> = self.objects().collect();
        observer.phase("reading the objects' files", shard.len());
        let seed = results.measurement.seed;
        let (mut keys, mut unreadable, mut done) = (HashMap::new(), Vec::new(), 0);
        for chunk in shard.chunks(CHUNK) {
            if cancellation.is_cancelled() {
                return Ok(Vec::new());
            }
            let read: Vec<_> = chunk.par_iter().map(|&object| (object, self.key_of(object, seed))).collect();
            for (object, key) in read {
                match key {
                    Ok(key) => drop(keys.insert(self.name(object), (object, key))),
                    Err(problem) => unreadable.push((object, problem)),
                }
            }
            done += chunk.len();
            observer.progress(done, "");
        }
        let is_current = |score: &ObjectScore| {
            let file = |folder: &Path| folder.join(shape_file(&score.category, &score.name));
            let is_kept = self.kept_in.is_none_or(|folder| score.is_shape_kept && file(folder).is_file());
            is_kept && keys.get(&(&*score.category, &*score.name)).is_some_and(|(_, key)| *key == score.key)
        };
        let dropped = results.keep(is_current)?;
        if dropped > 0 {
            observer.note(&format!(
                "{dropped} object(s) are measured again: their files, the settings, the program or the machine are others, or their \
                shapes were not kept"
            ));
        }
        for (object, problem) in unreadable {
            self.leave_out(object, &problem, results, observer)?;
        }
        let mut wanted: Vec<_> = keys
            .into_iter()
            .filter(|((category, name), _)| !results.holds(category, name))
            .map(|(_, row)| row)
            .collect();
        wanted.sort_by_key(|(object, _)| *object);
        Ok(wanted)
    }

    /// The key of an object's row.
    fn key_of(&self, object: usize, seed: u64) -> Result<RecordKey> {
        let own = self.dataset.digest(object)?;
        let scene = match self.predictor.other_object(self.dataset, object, seed)? {
            Some(other) => Digest::of_all([&own, &self.dataset.digest(other)?]),
            None => own,
        };
        Ok(RecordKey { scene, ..self.key.clone() })
    }

    /// Notes an object that cannot be measured.
    fn leave_out(
        &self,
        object: usize,
        problem: &Error,
        results: &mut Results,
        observer: &mut dyn Observer,
    ) -> Result<()> {
        observer.note(&format!("{} is left out: {problem}", self.title(object)));
        let object = &self.dataset.objects()[object];
        results.add_unmeasured(Unmeasured {
            category: object.category.clone(),
            category_name: object.category_name.clone(),
            name: object.name.clone(),
            problem: problem.to_string(),
        })
    }

    fn name(&self, object: usize) -> (&str, &str) {
        let object = &self.dataset.objects()[object];
        (&object.category, &object.name)
    }

    fn title(&self, object: usize) -> String {
        let (category, name) = self.name(object);
        format!("{category}/{name}")
    }

    fn score(&self, object: usize, key: &RecordKey, seed: u64, views: usize) -> Result<ObjectScore> {
        let dataset = self.dataset;
        let input = evaluated_input(dataset, object, seed)?;
        let truth = dataset.read_ground_truth(object)?;
        let shape = self.predictor.shape(dataset, object, input, self.extraction)?;
        if let Some(folder) = self.kept_in {
            let (category, name) = self.name(object);
            let file = folder.join(shape_file(category, name));
            let within = file.parent().unwrap_or(folder);
            std::fs::create_dir_all(within).map_err(|e| dvr_core::Error::io(within, e))?;
            shape.write(&file)?;
        }
        let view_metrics = match shape.mesh() {
            Some(mesh) if views > 0 => {
                let all = dataset.views(object)?;
                let chosen = (0..views.min(all)).map(|i| dataset.read_view(object, i * all / views.min(all)));
                let chosen = chosen.collect::<dvr_core::Result<Vec<_>>>()?;
                view_metrics(&MeshShader::new(mesh), &chosen.iter().collect::<Vec<_>>(), usize::MAX)
            }
            _ => None,
        };
        let object = &dataset.objects()[object];
        Ok(ObjectScore {
            category: object.category.clone(),
            category_name: object.category_name.clone(),
            name: object.name.clone(),
            input,
            shape: shape.evaluate(&truth, seed)?,
            views: view_metrics,
            has_colors: shape.mesh().is_some_and(|mesh| mesh.colors.is_some()),
            is_shape_kept: self.kept_in.is_some(),
            key: key.clone(),
        })
    }
}

/// Where an object's shape is kept.
fn shape_file(category: &str, name: &str) -> String {
    format!("shapes/{category}/{name}.ply")
}
