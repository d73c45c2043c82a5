//! How a run reads its scene, and notes about its masks.

use std::path::Path;

use anyhow::{Result, bail};
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::{Cancellation, MaskReport, Scene, refine_masks};
use serde::{Deserialize, Serialize};

use super::cameras::photographs_without_cameras;
use crate::args::SceneArgs;

/// How a run reads its scene, as its checkpoint stores it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SceneReading {
    /// How the files are read.
    #[serde(flatten)]
    pub options: ReadOptions,
    /// Whether masks are refined then.
    #[serde(default)]
    pub refine_masks: bool,
    /// The command line that made the masks, where a program did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segment: Option<String>,
}

impl SceneReading {
    /// By the arguments.
    pub fn of_arguments(args: &SceneArgs) -> Self {
        Self { options: args.read_options(), refine_masks: !args.no_mask_refinement, segment: None }
    }

    /// Reads the scene, divides its views, and refines the masks of those that are not for testing, unless that is off.
    pub fn read<V>(
        &self,
        path: &Path,
        divide: impl FnOnce(&mut Scene) -> dvr_core::Result<V>,
        cancellation: &Cancellation,
    ) -> Result<(Scene, V, MaskReport)> {
        let options = ReadOptions { cancellation: cancellation.clone(), ..self.options.clone() };
        if options.format.is_none() && photographs_without_cameras(path)?.is_some() {
            bail!(
                "{0}: there are photographs and no cameras. `dvr cameras {0}` finds them; `dvr train {0}` does so by itself",
                path.display()
            );
        }
        let mut scene = read_scene(path, &options)?;
        let views = divide(&mut scene)?;
        let report = if self.refine_masks { refine_masks(&mut scene, cancellation)? } else { MaskReport::default() };
        Ok((scene, views, report))
    }
}

/// What mask refinement changed, and how to turn it off.
pub fn refinement_notes(report: &MaskReport) -> Vec<String> {
    report.notes().iter().map(|note| format!("{note}; --no-mask-refinement takes masks as they are")).collect()
}
