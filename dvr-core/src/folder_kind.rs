//! Kinds of folders of results.

use std::fmt;

use serde::{Deserialize, Serialize};

/// What a folder of results is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FolderKind {
    /// A training run: checkpoints, mesh, figures.
    Run,
    /// Runs side by side.
    Benchmark,
    /// Runs on one difficulty at a time.
    StressTest,
    /// Scenes rendered from meshes.
    Dataset,
    /// Pictures of a model.
    Renders,
    /// Meshes of single pictures.
    Predictions,
    /// Figures of many objects.
    Evaluation,
    /// Cameras of photographs, with the pictures that they belong to.
    Cameras,
    /// Masks of photographs.
    Masks,
    /// A table of the publication, with its runs.
    PaperTable,
}

impl fmt::Display for FolderKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Run => "a run",
            Self::Benchmark => "a benchmark",
            Self::StressTest => "a stress test",
            Self::Dataset => "a rendered dataset",
            Self::Renders => "a set of renders",
            Self::Predictions => "a set of predictions",
            Self::Evaluation => "an evaluation",
            Self::Cameras => "cameras of photographs",
            Self::Masks => "masks of photographs",
            Self::PaperTable => "a table of the paper",
        })
    }
}
