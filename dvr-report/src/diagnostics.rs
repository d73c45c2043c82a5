//! Diagnostics: what a reader should know before trusting a mesh.

use std::fmt;

use dvr_train::{ObjectsMetrics, RunMetrics, ViewSplit};

use crate::chart::median;
use crate::coverage::Coverage;
use crate::html::count;

/// With fewer photographs than this, at most one of them sees whole sides of most objects.
const FEW_VIEWS: usize = 8;

/// Unseen share of the surface from which there is a warning.
const MUCH_UNSEEN: f64 = 0.02;

/// PSNR by which the mesh may be worse than its own field, dB.
const MESH_BEHIND: f64 = 1.0;

/// Silhouette IoU by which a view may be below the median of all views.
const MASK_BEHIND: f64 = 0.04;

/// Masks that are named; the others are counted.
const NAMED_MASKS: usize = 5;

/// Something that may be wrong with a run. [`Display`](fmt::Display) says what was found, in whole sentences.
#[derive(Clone, Debug, PartialEq)]
pub enum Diagnostic {
    /// The field has no surface.
    NoMesh,
    /// The mesh has holes.
    NotWatertight {
        /// Edges with a face on one side only.
        open_edges: usize,
    },
    /// The surface goes through itself.
    SelfIntersecting {
        /// Pairs of faces that intersect though they have no corner in common.
        pairs: usize,
    },
    /// The scene of the run could not be read.
    SceneMissing,
    /// Few photographs were trained on.
    FewViews {
        /// Training views.
        views: usize,
    },
    /// There are no test views.
    NothingTested,
    /// No training view sees a part of the surface.
    Unseen {
        /// Share of the surface's area.
        share: f64,
    },
    /// A single training view sees a part of the surface.
    SeenOnce {
        /// Share of the surface's area.
        share: f64,
    },
    /// Renders of the mesh are worse than renders of the field that it was extracted from.
    MeshBehindField {
        /// Difference of PSNR on test views, dB.
        decibels: f64,
    },
    /// The mask of a view agrees with the mesh much less than other masks do: a wrong mask or a wrong camera.
    MaskDisagrees {
        /// The view's name.
        view: String,
        /// Silhouette IoU of its mask and the mesh.
        iou: f64,
        /// The median over all views.
        median: f64,
    },
    /// Further views of the same kind.
    MoreMasksDisagree {
        /// Number of views.
        views: usize,
    },
    /// Nothing was validated during a training on objects.
    NotValidated,
    /// Objects of a dataset were left out.
    ObjectsLeftOut {
        /// Their names.
        names: Vec<String>,
    },
    /// A warning that the run itself recorded.
    OfRun(String),
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoMesh => write!(f, "There is no mesh: the field has no surface. Check masks and cameras."),
            Self::NotWatertight { open_edges } => write!(
                f,
                "The mesh is not watertight: {} edges have a face on one side only. Programs that print or simulate need \
                 watertight meshes.",
                count(*open_edges)
            ),
            Self::SelfIntersecting { pairs } => write!(
                f,
                "The surface goes through itself: {} of faces. Programs that print, cut or simulate solids may need it \
                 mended.",
                if *pairs == 1 { "1 pair".into() } else { format!("{} pairs", count(*pairs)) }
            ),
            Self::SceneMissing => write!(f, "The scene of the run was not found, so no view is shown."),
            Self::FewViews { views } => write!(
                f,
                "Only {views} photographs were trained on. Use {FEW_VIEWS} or more, from all sides, for a surface to trust."
            ),
            Self::NothingTested => {
                write!(f, "There are no test views, so nothing here tells how the mesh looks from other viewpoints.")
            }
            Self::Unseen { share } => write!(
                f,
                "No photograph sees {} of the surface (often the underside): there the mesh is a guess within the masks' \
                 outlines. The mode \"Confidence\" of the 3D view shows where.",
                percent(*share)
            ),
            Self::SeenOnce { share } => write!(
                f,
                "A single photograph sees another {} of the surface: its colour is known, its depth is not.",
                percent(*share)
            ),
            Self::MeshBehindField { decibels } => write!(
                f,
                "Renders of the mesh are {decibels:.1} dB worse than renders of its field: a mesh of higher resolution keeps \
                 more detail."
            ),
            Self::MaskDisagrees { view, iou, median } => write!(
                f,
                "The silhouette IoU of the mesh and the mask of view {view} is {iou:.2} (median view: {median:.2}). Check its \
                 mask and its camera."
            ),
            Self::MoreMasksDisagree { views } => write!(f, "{views} more masks disagree with the mesh like these."),
            Self::NotValidated => write!(f, "Nothing was validated, so the run's model is that of the last step."),
            Self::ObjectsLeftOut { names } => {
                let first = names.iter().take(3).map(String::as_str).collect::<Vec<_>>().join(", ");
                let rest = if names.len() > 3 { ", ..." } else { "" };
                write!(
                    f,
                    "{} objects could not be used and were left out ({first}{rest}). metrics.json says why.",
                    names.len()
                )
            }
            Self::OfRun(text) => write!(f, "{}", sentence(text)),
        }
    }
}

/// A share of an area, for people.
fn percent(share: f64) -> String {
    if share < 0.0995 { format!("{:.1} %", 100.0 * share) } else { format!("{:.0} %", 100.0 * share) }
}

/// A note of a run as a sentence: notes begin with a small letter and have no full stop.
pub(crate) fn sentence(text: &str) -> String {
    let mut characters = text.chars();
    let first = characters.next().map_or(String::new(), |first| first.to_uppercase().collect());
    let end = if text.ends_with(['.', '!', '?', ')']) { "" } else { "." };
    format!("{first}{}{end}", characters.as_str())
}

/// What was checked of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Diagnostics {
    /// What may be wrong, worst first.
    pub warnings: Vec<Diagnostic>,
    /// What was checked and found right, in sentences.
    pub passed: Vec<String>,
}

impl Diagnostics {
    /// Of a scene's run; `split` are its views, where the scene was found.
    pub fn of_scene(
        metrics: &RunMetrics,
        split: Option<&ViewSplit>,
        coverage: Option<Coverage>,
        open_edges: usize,
    ) -> Self {
        let mut found = Self::default();
        match metrics.mesh {
            None => found.warnings.push(Diagnostic::NoMesh),
            Some(_) if open_edges > 0 => found.warnings.push(Diagnostic::NotWatertight { open_edges }),
            Some(_) => found.passed.push("The mesh is watertight.".into()),
        }
        match metrics.self_intersections {
            Some(0) => found.passed.push("No face of the mesh intersects another.".into()),
            Some(pairs) => found.warnings.push(Diagnostic::SelfIntersecting { pairs }),
            None => {}
        }
        match split.map(|split| split.train.len()) {
            None => found.warnings.push(Diagnostic::SceneMissing),
            Some(views) if views < FEW_VIEWS => found.warnings.push(Diagnostic::FewViews { views }),
            Some(_) => {}
        }
        if split.is_some_and(|split| split.test.is_empty()) {
            found.warnings.push(Diagnostic::NothingTested);
        }
        if let Some(coverage) = coverage {
            found.check_coverage(coverage);
        }
        if let (Some(field), Some(mesh)) = (metrics.test, metrics.test_mesh)
            && field.psnr - mesh.psnr > MESH_BEHIND
        {
            found.warnings.push(Diagnostic::MeshBehindField { decibels: field.psnr - mesh.psnr });
        }
        found.warnings.extend(metrics.warnings.iter().cloned().map(Diagnostic::OfRun));
        found
    }

    fn check_coverage(&mut self, coverage: Coverage) {
        if coverage.unseen > MUCH_UNSEEN {
            self.warnings.push(Diagnostic::Unseen { share: coverage.unseen });
        } else {
            self.passed.push(format!("Photographs see {} of the surface.", percent(1.0 - coverage.unseen)));
        }
        if coverage.seen_once > 2.0 * MUCH_UNSEEN {
            self.warnings.push(Diagnostic::SeenOnce { share: coverage.seen_once });
        }
    }

    /// Of a run on a dataset of objects.
    pub fn of_objects(metrics: &ObjectsMetrics) -> Self {
        let mut found = Self::default();
        if metrics.validation.is_none() {
            found.warnings.push(Diagnostic::NotValidated);
        }
        if !metrics.broken.is_empty() {
            let names = metrics.broken.iter().map(|(name, _)| name.clone()).collect();
            found.warnings.push(Diagnostic::ObjectsLeftOut { names });
        }
        found
    }
}

/// Views whose mask agrees with the mesh much less than the others' masks do. `agreements` are names and silhouette
/// IoUs.
pub(crate) fn disagreeing_masks(agreements: &[(String, f64)]) -> Vec<Diagnostic> {
    let mut sorted: Vec<f64> = agreements.iter().map(|(_, iou)| *iou).collect();
    sorted.sort_by(f64::total_cmp);
    let middle = median(&sorted);
    let mut spread: Vec<f64> = sorted.iter().map(|iou| (iou - middle).abs()).collect();
    spread.sort_by(f64::total_cmp);
    let limit = middle - (6.0 * median(&spread)).max(MASK_BEHIND);
    let mut odd: Vec<&(String, f64)> = agreements.iter().filter(|(_, iou)| *iou < limit).collect();
    odd.sort_by(|a, b| a.1.total_cmp(&b.1));
    let named = odd.iter().take(NAMED_MASKS);
    let mut warnings: Vec<Diagnostic> =
        named.map(|(view, iou)| Diagnostic::MaskDisagrees { view: view.clone(), iou: *iou, median: middle }).collect();
    if odd.len() > NAMED_MASKS {
        warnings.push(Diagnostic::MoreMasksDisagree { views: odd.len() - NAMED_MASKS });
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wrong_mask_among_good_ones_is_named_and_noise_is_not() {
        let mut agreements: Vec<(String, f64)> =
            (0..20).map(|i| (format!("{i:04}"), 0.97 + 0.001 * f64::from(i % 5))).collect();
        assert!(disagreeing_masks(&agreements).is_empty() && disagreeing_masks(&[]).is_empty());
        agreements[7].1 = 0.4;
        let warnings = disagreeing_masks(&agreements);
        assert!(
            matches!(&warnings[..], [Diagnostic::MaskDisagrees { view, iou, .. }] if view == "0007" && *iou == 0.4)
        );
    }
}
