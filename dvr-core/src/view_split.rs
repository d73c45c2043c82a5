//! Which views are trained on, which choose during a run, and which give its final figures.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::scene::{Scene, Split, View, require_masks};

/// The views of a scene in three parts, by [`View::split`].
#[derive(Clone, Debug)]
pub struct ViewSplit<'a> {
    /// Trained on.
    pub train: Vec<&'a View>,
    /// Never trained on. Every choice during a run goes by these: growth, the end of training, the best checkpoint.
    pub validation: Vec<&'a View>,
    /// For the final figures. Nothing is learned from these, and nothing chosen by them.
    pub test: Vec<&'a View>,
}

impl<'a> ViewSplit<'a> {
    /// The parts of a scene, which [`Scene::hold_out`] or [`ViewNames::apply`] may have made.
    ///
    /// # Errors
    /// When there are fewer than two views to train on.
    pub fn of(scene: &'a Scene) -> Result<Self> {
        let [train, validation, test] =
            [Split::Train, Split::Val, Split::Test].map(|split| scene.views_of(split).collect::<Vec<_>>());
        if train.len() < 2 {
            let (scene, all) = (scene.name.clone(), scene.views.len());
            return Err(Error::TooFewViews { scene, left: train.len(), all, purpose: "to train on" });
        }
        Ok(Self { train, validation, test })
    }

    /// Checks that every view has a mask: for methods that cannot do without.
    ///
    /// # Errors
    /// [`Error::MasksMissing`] naming the views that have none.
    pub fn require_masks(&self) -> Result<()> {
        require_masks(self.train.iter().chain(&self.validation).chain(&self.test).copied())
    }
}

/// Which view is for what, by name: fixed when a run starts, and kept by its checkpoints.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ViewNames {
    /// Trained on.
    pub train: Vec<String>,
    /// For choices during the run.
    pub validation: Vec<String>,
    /// For the final figures.
    pub test: Vec<String>,
    /// How the views came to their parts, in a sentence for people.
    pub rule: String,
}

/// Names of a part of which so many are printed.
const NAMED: usize = 8;

impl ViewNames {
    /// The views of a scene as they are divided now.
    pub fn of(scene: &Scene, rule: String) -> Self {
        let names = |split| scene.views_of(split).map(|view| view.name.clone()).collect();
        Self { train: names(Split::Train), validation: names(Split::Val), test: names(Split::Test), rule }
    }

    /// All names.
    pub fn all(&self) -> impl Iterator<Item = &str> {
        self.train.iter().chain(&self.validation).chain(&self.test).map(String::as_str)
    }

    /// Gives the views of a scene the parts that they have here, and warns of views that are gone.
    ///
    /// # Errors
    /// [`Error::ViewsUnknown`] naming the views that have no part here:
    /// [`ReadOptions::known_views`](crate::dataset::ReadOptions::known_views) leaves them out.
    pub fn apply(&self, scene: &mut Scene) -> Result<()> {
        let mut unknown = Vec::new();
        for view in &mut scene.views {
            match self.part_of(&view.name) {
                Some(split) => view.split = split,
                None => unknown.push(view.name.clone()),
            }
        }
        if !unknown.is_empty() {
            return Err(Error::ViewsUnknown { scene: scene.name.clone(), views: unknown });
        }
        for split in [Split::Train, Split::Val, Split::Test] {
            let gone = self.missing(scene, split);
            if gone.is_empty() {
                continue;
            }
            let (purpose, count) = (purpose(split), gone.len());
            let warning = format!("views of the run that are gone, {count} {purpose}: {}", abbreviated(&gone));
            if !scene.warnings.contains(&warning) {
                scene.warnings.push(warning);
            }
        }
        Ok(())
    }

    /// The views of a part that a scene does not have.
    pub fn missing(&self, scene: &Scene, split: Split) -> Vec<String> {
        let is_there = |name: &&String| scene.views.iter().any(|view| view.name == **name);
        self.part(split).iter().filter(|name| !is_there(name)).cloned().collect()
    }

    fn part(&self, split: Split) -> &[String] {
        match split {
            Split::Train => &self.train,
            Split::Val => &self.validation,
            Split::Test => &self.test,
        }
    }

    fn part_of(&self, name: &str) -> Option<Split> {
        let has = |split: &Split| self.part(*split).iter().any(|other| other == name);
        [Split::Train, Split::Val, Split::Test].into_iter().find(has)
    }
}

/// How many views each part has, the names of those that are not trained on, and the rule.
impl fmt::Display for ViewNames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.train.len(), purpose(Split::Train))?;
        for split in [Split::Val, Split::Test] {
            let names = self.part(split);
            write!(f, "; {} {}", names.len(), purpose(split))?;
            if !names.is_empty() {
                write!(f, " ({})", abbreviated(names))?;
            }
        }
        write!(f, "; {}", self.rule)
    }
}

/// What views of a part are for.
fn purpose(split: Split) -> &'static str {
    match split {
        Split::Train => "to train on",
        Split::Val => "for validation",
        Split::Test => "for testing",
    }
}

/// Some names, and how many more there are.
pub fn abbreviated(names: &[String]) -> String {
    let shown = names.iter().take(NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > NAMED { format!("{shown} and {} more", names.len() - NAMED) } else { shown }
}
