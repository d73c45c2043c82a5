//! Evaluation over a split of a dataset: in parallel, in parts, and from where it was stopped.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;

use dvr_core::Split;
use dvr_core::dataset::ObjectDataset;
use dvr_render::MeshShader;
use dvr_render::extract::ExtractSettings;
use rayon::prelude::*;

use super::results::{ObjectScore, Results};
use super::subject::{Shape, Subject, judged_input};
use crate::error::Result;
use crate::run::Observer;
use crate::validate::agreement;

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

/// Measures the subject on the objects of `split` that are in the shard and not yet in `results`, which hears of each
/// when it is done. `broken` hears of objects that cannot be measured, as `category/name`, with the reason.
///
/// The figures of an object depend on the seed and its files alone. Setting `interrupted` ends the work after the objects
/// that are under way.
///
/// # Errors
/// When results cannot be written.
#[allow(clippy::too_many_arguments, reason = "each is a thing of its own, and all are needed at once")]
pub fn evaluate_objects(
    dataset: &ObjectDataset,
    subject: &Subject,
    split: Split,
    shard: Shard,
    extraction: &ExtractSettings,
    results: &mut Results,
    interrupted: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Vec<(String, String)>> {
    let part = dataset.of_split(split).into_iter().skip(shard.number - 1).step_by(shard.of);
    let wanted: Vec<usize> = part
        .filter(|&object| {
            let object = &dataset.objects()[object];
            !results.holds(&object.category, &object.name)
        })
        .collect();
    let measurement = results.measurement.clone();
    observer.phase("evaluating objects", wanted.len());
    let mut broken = Vec::new();
    let mut failed = None;
    rayon::in_place_scope(|scope| {
        let (sender, receiver) = channel();
        scope.spawn(|_| {
            let sender = sender;
            wanted.par_iter().for_each_with(sender, |sender, &object| {
                if !interrupted.load(Ordering::Relaxed) {
                    let score = score_object(dataset, subject, object, extraction, measurement.seed, measurement.views);
                    // Nobody listens any more where results could not be written; that error is told.
                    let _ = sender.send((object, score));
                }
            });
        });
        for (done, (object, score)) in receiver.iter().enumerate() {
            match score {
                Ok(score) => {
                    if let Err(error) = results.add(score) {
                        failed = Some(error);
                        return;
                    }
                }
                Err(problem) => {
                    let object = &dataset.objects()[object];
                    let title = format!("{}/{}", object.category, object.name);
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

fn score_object(
    dataset: &ObjectDataset,
    subject: &Subject,
    object: usize,
    extraction: &ExtractSettings,
    seed: u64,
    views: usize,
) -> Result<ObjectScore> {
    let input = judged_input(dataset, object, seed)?;
    let truth = dataset.read_ground_truth(object)?;
    let shape = subject.shape(dataset, object, input, extraction)?;
    let agreement = match &shape {
        Shape::Mesh(mesh) if views > 0 => {
            let all = dataset.views(object)?;
            let chosen = (0..views.min(all)).map(|i| dataset.read_view(object, i * all / views.min(all)));
            let chosen = chosen.collect::<dvr_core::Result<Vec<_>>>()?;
            agreement(&MeshShader::new(mesh), &chosen.iter().collect::<Vec<_>>(), usize::MAX)
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
        views: agreement,
    })
}
