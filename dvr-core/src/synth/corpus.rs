//! Many objects: a ShapeNet-like dataset from a collection of mesh files.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::config::SynthConfig;
use super::dataset::render_object;
use super::lists::{LISTS, register_category, write_list};
use crate::cancellation::Cancellation;
use crate::error::{Error, Result};
use crate::mesh::read_mesh_with_warnings;
use crate::scene::Split;

/// A mesh file that becomes an object of a dataset.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CorpusObject {
    /// Name of the object, unique in its category: a folder's name.
    pub name: String,
    /// Name of the category: the folder around it.
    pub category: String,
    /// The mesh file.
    pub mesh: PathBuf,
}

/// How the objects of a category are divided.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SplitRatios {
    /// Share of the objects that is held back for choosing between models; 0.1.
    pub val: f64,
    /// Share of the objects that is held back for the final figures; 0.2.
    pub test: f64,
}

impl Default for SplitRatios {
    fn default() -> Self {
        Self { val: 0.1, test: 0.2 }
    }
}

/// What became of a collection.
#[derive(Debug, Default)]
pub struct CorpusReport {
    /// `category/name` of the objects that were rendered.
    pub rendered: Vec<String>,
    /// `category/name` of the objects that were there already, and were left as they are.
    pub kept: Vec<String>,
    /// Objects that could not be rendered, and why.
    pub skipped: Vec<(String, Error)>,
    /// What was left out of objects that were rendered, a missing texture, say.
    pub warnings: Vec<(String, String)>,
}

/// Renders every object of a collection, and writes the lists of each category.
///
/// An object whose mesh is broken is reported and skipped; one whose folder is there already is kept, so a run that was
/// stopped can be taken up again. Objects are divided at random by `ratios`, by the configuration's seed; the only
/// object of a category is in all three lists. `progress` gets how many objects are done, and of how many.
///
/// # Errors
/// [`Error::OutOfRange`] where the configuration is unusable, [`Error::AlreadyThere`] where two objects share a name; [`Error::Io`] where something
/// cannot be written; [`Error::Cancelled`] where somebody wants it to end.
pub fn render_corpus(
    objects: &[CorpusObject],
    out: &Path,
    config: &SynthConfig,
    ratios: SplitRatios,
    cancellation: &Cancellation,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<CorpusReport> {
    config.check()?;
    let mut seen = HashSet::new();
    if let Some(twice) = objects.iter().find(|o| !seen.insert((&o.category, &o.name))) {
        return Err(Error::AlreadyThere { name: format!("{}/{}", twice.category, twice.name) });
    }
    let mut report = CorpusReport::default();
    let mut categories: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (i, object) in objects.iter().enumerate() {
        cancellation.check()?;
        if render_one(object, out, config, &mut report)? {
            categories.entry(&object.category).or_default().push(&object.name);
        }
        progress(i + 1, objects.len());
    }
    for (category, names) in categories {
        for (split, names) in divide(names, ratios, config.seed) {
            for (_, file) in LISTS.iter().filter(|(of, _)| *of == split) {
                write_list(&out.join(category).join(file), &names)?;
            }
        }
        register_category(out, category)?;
    }
    Ok(report)
}

/// Whether the object is in the dataset afterwards. Only what hinders all objects alike is an error.
fn render_one(object: &CorpusObject, out: &Path, config: &SynthConfig, report: &mut CorpusReport) -> Result<bool> {
    let title = format!("{}/{}", object.category, object.name);
    if out.join(&object.category).join(&object.name).join("cameras.npz").is_file() {
        report.kept.push(title);
        return Ok(true);
    }
    let mut warnings = Vec::new();
    let mesh = match read_mesh_with_warnings(&object.mesh, &mut warnings) {
        Ok(mesh) => mesh,
        Err(problem) => {
            report.skipped.push((title, problem));
            return Ok(false);
        }
    };
    match render_object(&mesh, &object.name, &object.category, out, config, &|_, _| ()) {
        Ok(()) => {
            report.warnings.extend(warnings.into_iter().map(|warning| (title.clone(), warning)));
            report.rendered.push(title);
            Ok(true)
        }
        Err(problem @ (Error::NoExtent { .. } | Error::FolderName { .. } | Error::AlreadyThere { .. })) => {
            report.skipped.push((title, problem));
            Ok(false)
        }
        Err(problem) => Err(problem),
    }
}

/// Which objects of a category are in which list.
fn divide(mut names: Vec<&str>, ratios: SplitRatios, seed: u64) -> [(Split, Vec<&str>); 3] {
    if names.len() < 2 {
        return LISTS.map(|(split, _)| (split, names.clone()));
    }
    names.sort_unstable();
    names.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let share = |ratio: f64| (ratio.clamp(0.0, 1.0) * names.len() as f64).round() as usize;
    let held_back = |count: usize, left: usize| count.min(left);
    let test = held_back(share(ratios.test), names.len() - 1);
    let val = held_back(share(ratios.val), names.len() - 1 - test);
    let mut train = names;
    let mut test = train.split_off(train.len() - test);
    let mut val = train.split_off(train.len() - val);
    [&mut train, &mut val, &mut test].into_iter().for_each(|list| list.sort_unstable());
    [(Split::Train, train), (Split::Val, val), (Split::Test, test)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_object_is_in_exactly_one_list() {
        let names: Vec<String> = (0..20).map(|i| format!("o{i:02}")).collect();
        let [(_, train), (_, val), (_, test)] =
            divide(names.iter().map(String::as_str).collect(), SplitRatios::default(), 5);
        assert_eq!((train.len(), val.len(), test.len()), (14, 2, 4));
        let mut all = [train, val, test].concat();
        all.sort_unstable();
        assert_eq!(all, names);
    }

    #[test]
    fn something_is_always_left_to_train_on() {
        for count in 1..4 {
            let names = &["a", "b", "c"][..count];
            let [(_, train), ..] = divide(names.to_vec(), SplitRatios { val: 0.9, test: 0.9 }, 0);
            assert!(!train.is_empty());
        }
    }
}
