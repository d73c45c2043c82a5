//! Evaluation over a split of a dataset: in parallel, in parts, and from where it was stopped.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;

use dvr_core::Split;
use dvr_core::dataset::ObjectDataset;
use dvr_render::MeshShader;
use dvr_render::extract::ExtractSettings;
use rayon::prelude::*;

use super::predictor::{Predictor, Shape, evaluated_input};
use super::results::{ObjectScore, Results};
use crate::error::Result;
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
}

impl Evaluation<'_> {
    /// Measures the objects that are not yet in `results`, which hears of each when it is done. Objects that cannot be
    /// measured are returned, as `category/name`, with the reason.
    ///
    /// The figures of an object depend on the seed and its files alone. Setting `interrupted` ends the work after the
    /// objects that are under way.
    ///
    /// # Errors
    /// When results cannot be written.
    pub fn run(
        &self,
        results: &mut Results,
        interrupted: &AtomicBool,
        observer: &mut dyn Observer,
    ) -> Result<Vec<(String, String)>> {
        let wanted = self.wanted(results);
        let (seed, views) = (results.measurement.seed, results.measurement.views);
        observer.phase("evaluating objects", wanted.len());
        let mut broken = Vec::new();
        let mut failed = None;
        rayon::in_place_scope(|scope| {
            let (sender, receiver) = channel();
            let wanted = &wanted;
            scope.spawn(move |_| {
                // Ends early where somebody asks, or nobody listens any more.
                let _ = wanted.par_iter().try_for_each_with(sender, |sender, &object| {
                    let stop = interrupted.load(Ordering::Relaxed);
                    (!stop).then(|| sender.send((object, self.score(object, seed, views))).ok()).flatten()
                });
            });
            for (done, (object, score)) in receiver.iter().enumerate() {
                match score.map(|score| results.add(score)) {
                    Ok(Ok(())) => (),
                    Ok(Err(error)) => {
                        failed = Some(error);
                        return;
                    }
                    Err(problem) => {
                        let title = self.title(object);
                        observer.note(&format!("{title} is left out: {problem}"));
                        broken.push((title, problem.to_string()));
                    }
                }
                observer.progress(done + 1, "");
            }
        });
        broken.sort();
        failed.map_or(Ok(broken), Err)
    }

    /// The objects of the shard whose figures are not there yet.
    fn wanted(&self, results: &Results) -> Vec<usize> {
        let shard = self.dataset.of_split(self.split).into_iter().skip(self.shard.number - 1).step_by(self.shard.of);
        let is_missing = |&object: &usize| {
            let object = &self.dataset.objects()[object];
            !results.holds(&object.category, &object.name)
        };
        shard.filter(is_missing).collect()
    }

    fn title(&self, object: usize) -> String {
        let object = &self.dataset.objects()[object];
        format!("{}/{}", object.category, object.name)
    }

    fn score(&self, object: usize, seed: u64, views: usize) -> Result<ObjectScore> {
        let dataset = self.dataset;
        let input = evaluated_input(dataset, object, seed)?;
        let truth = dataset.read_ground_truth(object)?;
        let shape = self.predictor.shape(dataset, object, input, self.extraction)?;
        let view_metrics = match &shape {
            Shape::Mesh(mesh) if views > 0 => {
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
        })
    }
}
