//! What a reader should know before believing a mesh, in plain words.

use dvr_train::{ObjectsMetrics, RunMetrics, ViewSplit};

use crate::html::count;
use crate::surface::Coverage;

/// With fewer photographs than this, whole sides of most objects are seen by one or none of them.
const FEW_VIEWS: usize = 8;

/// Unseen share of the surface from which it is worth a warning.
const MUCH_UNSEEN: f64 = 0.02;

/// PSNR that the mesh may be behind its own field, dB.
const MESH_BEHIND: f64 = 1.0;

/// Silhouette IoU that a view may be behind the median of all.
const MASK_BEHIND: f64 = 0.04;

/// What is good, and what is not.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Findings {
    /// What may be wrong, worst first.
    pub warnings: Vec<String>,
    /// What was checked and found right.
    pub good: Vec<String>,
}

impl Findings {
    /// Of a scene's run.
    pub fn of_scene(
        metrics: &RunMetrics,
        scene_is_known: bool,
        split: Option<&ViewSplit>,
        coverage: Option<Coverage>,
        open_edges: usize,
    ) -> Self {
        let mut found = Self::default();
        match metrics.mesh {
            None => found.warn(
                "There is no mesh: the field has no surface. Masks or cameras are the usual reason; \
                                `dvr info SCENE` looks at both.",
            ),
            Some(_) if open_edges > 0 => found.warn(format!(
                "The mesh is not watertight: {} edges have a hole beside them. Programs that print or simulate will \
                 complain.",
                count(open_edges)
            )),
            Some(_) => found.good.push("The mesh is watertight.".into()),
        }
        if !scene_is_known {
            found.warn(
                "The scene was not where it was when the run was made, so no view is shown. `dvr report RUN \
                        --data SCENE` says where it is now.",
            );
        }
        if let Some(split) = split {
            let views = split.train.len();
            if views < FEW_VIEWS {
                found.warn(format!(
                    "Only {views} photographs taught the shape. Eight or more, from all sides, make a \
                                    surface that can be trusted."
                ));
            }
            if metrics.held_out_mesh.is_none() {
                found.warn(
                    "No view was held out, so nothing here says how the mesh looks from where no photograph was taken.",
                );
            }
        }
        if let Some(coverage) = coverage {
            let share = |value: f64| {
                if value < 0.0995 { format!("{:.1} %", 100.0 * value) } else { format!("{:.0} %", 100.0 * value) }
            };
            if coverage.unseen > MUCH_UNSEEN {
                found.warn(format!(
                    "No photograph sees {} of the surface (often the underside): there the mesh is a guess within the \
                     masks' outlines. \
                     The mode \"Confidence\" of the view in 3D shows where.",
                    share(coverage.unseen)
                ));
            } else {
                found.good.push(format!("Photographs saw {} of the surface.", share(1.0 - coverage.unseen)));
            }
            if coverage.seen_once > 2.0 * MUCH_UNSEEN {
                found.warn(format!(
                    "A single photograph sees another {} of the surface: its colour is known, its depth is not.",
                    share(coverage.seen_once)
                ));
            }
        }
        if let (Some(field), Some(mesh)) = (metrics.held_out, metrics.held_out_mesh)
            && field.psnr - mesh.psnr > MESH_BEHIND
        {
            found.warn(format!(
                "The mesh looks {:.1} dB worse than the field that it was made from: a finer one (`dvr mesh RUN \
                 --resolution 512`) keeps more.",
                field.psnr - mesh.psnr
            ));
        }
        found.warnings.extend(metrics.warnings.iter().cloned());
        found
    }

    /// Of a run over many objects.
    pub fn of_objects(metrics: &ObjectsMetrics) -> Self {
        let mut found = Self::default();
        if metrics.validation.is_none() {
            found.warn("Nothing was validated, so the last step stands for the run.");
        }
        if !metrics.broken.is_empty() {
            let first: Vec<&str> = metrics.broken.iter().take(3).map(|(name, _)| name.as_str()).collect();
            found.warn(format!(
                "{} objects could not be used and were left out ({}{}). metrics.json tells why.",
                metrics.broken.len(),
                first.join(", "),
                if metrics.broken.len() > 3 { ", ..." } else { "" }
            ));
        }
        found
    }

    fn warn(&mut self, text: impl Into<String>) {
        self.warnings.push(text.into());
    }
}

/// Views whose mask agrees with the mesh much less than the others' masks do: a wrong mask or a wrong camera.
/// `agreements` are names and silhouette IoUs.
pub fn disagreeing_masks(agreements: &[(String, f64)]) -> Vec<String> {
    let mut sorted: Vec<f64> = agreements.iter().map(|(_, iou)| *iou).collect();
    sorted.sort_by(f64::total_cmp);
    let median = crate::chart::median(&sorted);
    let mut spread: Vec<f64> = sorted.iter().map(|iou| (iou - median).abs()).collect();
    spread.sort_by(f64::total_cmp);
    let limit = median - (6.0 * crate::chart::median(&spread)).max(MASK_BEHIND);
    let mut odd: Vec<&(String, f64)> = agreements.iter().filter(|(_, iou)| *iou < limit).collect();
    odd.sort_by(|a, b| a.1.total_cmp(&b.1));
    let told = odd.iter().take(5).map(|(name, iou)| {
        format!(
            "The mask of view {name} agrees with the mesh to {iou:.2} only (of 1; the median view to {median:.2}): \
             look at its mask and \
             its camera, or leave it out with `--ignore {name}`."
        )
    });
    let mut warnings: Vec<String> = told.collect();
    if odd.len() > 5 {
        warnings.push(format!("{} more masks disagree with the mesh like these.", odd.len() - 5));
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
        assert!(warnings.len() == 1 && warnings[0].contains("view 0007") && warnings[0].contains("--ignore 0007"));
    }
}
