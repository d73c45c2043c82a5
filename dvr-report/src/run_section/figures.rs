//! The main figures of a run, as tiles and tables show them.

use dvr_train::{DepthMapsEvaluation, ObjectsMetrics, PointsEvaluation, RunMetrics};

use crate::coverage::Coverage;
use crate::html::{bytes, count, number, seconds};
use crate::summary::{Figures, RunSummary};

/// Name, value and explanation of each figure.
pub(crate) fn main_figures(summary: &RunSummary) -> Vec<[String; 3]> {
    let mut list = List::default();
    match &summary.figures {
        Figures::Scene(metrics) => {
            quality(&mut list, metrics);
            cost(&mut list, metrics, summary.coverage);
        }
        Figures::Objects(metrics) => of_objects(&mut list, metrics),
    }
    list.0
}

/// Figures in the making.
#[derive(Default)]
struct List(Vec<[String; 3]>);

impl List {
    fn add(&mut self, name: &str, value: String, explanation: &str) {
        self.0.push([name.into(), value, explanation.into()]);
    }
}

/// What the reconstruction of a scene is worth.
fn quality(list: &mut List, metrics: &RunMetrics) {
    if let Some(test) = metrics.test_mesh {
        let explanation = "of the coloured mesh in test views, by which nothing was learned or chosen, on white";
        list.add("PSNR", format!("{:.2} dB", test.psnr), explanation);
        let explanation = "of the mesh and the masks of test views, by which nothing was learned or chosen";
        list.add("Silhouette IoU", format!("{:.4}", test.mask_iou), explanation);
    }
    if let (Some(surface), Some(_)) = (&metrics.shape.surface, metrics.mesh) {
        let explanation = "against the true surface, in edges of the object cube; papers print ten times that";
        list.add("Chamfer-L1", format!("{:.4}", surface.chamfer_l1), explanation);
        if let Some(floor) = &metrics.shape.floor {
            let explanation = "Chamfer-L1 of two samplings of the true surface";
            list.add("its floor", format!("{:.4}", floor.chamfer_l1), explanation);
        }
        if let Some(normals) = surface.normal_consistency {
            list.add("Normals", format!("{:.3}", normals.mean), "mean cosine with the true surface's normals");
        }
    }
    if let (Some(seen), Some(_)) = (&metrics.shape.seen, metrics.mesh) {
        let explanation = "Chamfer-L1 of the surface that at least two views see";
        list.add("where seen", format!("{:.4}", seen.score.chamfer_l1), explanation);
    }
    if let Some(iou) = metrics.shape.volume_iou {
        list.add("Volume IoU", format!("{iou:.3}"), "against the true occupancy");
    }
    if let Some(points) = &metrics.points {
        of_points(list, points);
    }
    if let Some(depth_maps) = &metrics.depth_maps {
        of_depth_maps(list, depth_maps);
    }
}

/// What the run started from, besides the masks.
fn of_depth_maps(list: &mut List, DepthMapsEvaluation { known, surface, points, .. }: &DepthMapsEvaluation) {
    let explanation = "share of the object's pixels whose depth other views confirmed before training";
    list.add("Depth maps", format!("{:.1} %", 100.0 * known), explanation);
    let unit_and_truth = [
        (surface, "edges of the object cube, and in pixels of disparity, against the true surface"),
        (points, "units of the scene, and in pixels of disparity, against verified points"),
    ];
    for (score, truth) in unit_and_truth {
        let Some(score) = score.as_ref().filter(|score| score.known > 0.0) else { continue };
        let [length, pixels] = [&score.distance, &score.disparity_px].map(|summary| summary.median);
        let explanation = format!("median of how far these depths are off along their rays, in {truth}");
        list.add("their error", format!("{} / {pixels:.2} px", number(length, 3)), &explanation);
    }
}

/// The mesh against points that are known to lie on the surface.
fn of_points(list: &mut List, PointsEvaluation { source, not_independent, score }: &PointsEvaluation) {
    let [mean, median] = [score.distances.mean, score.distances.median].map(|length| number(length, 3));
    let caution = not_independent.as_ref().map_or(String::new(), |reason| format!("; not independent: {reason}"));
    let explanation = format!(
        "mean and median distance of {} {source} to the mesh, in units of the scene{caution}",
        count(score.points)
    );
    list.add("Verified points", format!("{mean} / {median}"), &explanation);
    if let Some(floor) = &score.floor {
        let explanation = "what the true surface would score: tracks split in two and triangulated apart";
        list.add("their floor", format!("{} / {}", number(floor.mean, 3), number(floor.median, 3)), explanation);
    }
    if let Some(hidden) = &score.hidden {
        let share = hidden.blocked_sights.unwrap_or(hidden.hidden_from_all);
        let explanation = format!(
            "share of {} that the mesh blocks by more than {} units of the scene",
            if hidden.blocked_sights.is_some() { "lines of sight to these points" } else { "these points" },
            number(hidden.margin, 3)
        );
        list.add("Hidden points", format!("{:.1} %", 100.0 * share), &explanation);
    }
}

/// What it took, and how large it is.
fn cost(list: &mut List, metrics: &RunMetrics, coverage: Option<Coverage>) {
    if let Some(coverage) = coverage {
        let explanation = "share of the area that at least one training photograph sees";
        list.add("Observed surface", format!("{:.1} %", 100.0 * (1.0 - coverage.unseen)), explanation);
    }
    list.add("Training", seconds(metrics.training_seconds), "wall time, preparation included");
    list.add("CPU time", seconds(metrics.resources.cpu_seconds), "of all cores together, the whole job");
    if let Some(peak) = metrics.resources.peak_memory {
        list.add("Memory", bytes(peak as f64), "peak memory of the process");
    }
    list.add("Stored field", bytes(metrics.bytes as f64), "size of the field on disk");
    if let Some([_, faces]) = metrics.mesh {
        list.add("Mesh", format!("{} faces", count(faces)), "as written to mesh.ply and mesh.glb");
    }
    if let Some(support) = &metrics.support {
        let [x, y, z] = support.plane.normal.to_array().map(|part| number(part, 3));
        let explanation = format!(
            "normal of the plane that the object stands on, found with its masks; it lies at {} along it from the origin, in \
             units of the scene; the mesh is {}",
            number(support.plane.offset, 4),
            if support.is_dropped { "cut by it" } else { "not cut by it" }
        );
        list.add("Support plane", format!("({x}, {y}, {z})"), &explanation);
    }
    if let Some(size) = &metrics.real_size {
        let [x, y, z] = size.size_metres.map(|edge| number(edge, 3));
        let agreement = match size.lengths.len() {
            1 => "one known length".to_owned(),
            n => format!("{n} known lengths, which disagree by {:.1} % at most", size.disagreement_percent),
        };
        let explanation = format!(
            "edges of the box around the mesh, which is in metres; a unit of the scene's files is {} m, by {agreement}",
            number(size.metres_per_unit, 4)
        );
        list.add("Real size", format!("{x} \u{d7} {y} \u{d7} {z} m"), &explanation);
    }
    if let Some(simplification) = metrics.simplification {
        let explanation = format!(
            "faces before; the surface moved by {:.2e} in the mean, {:.2e} at most, in the units of the scene",
            simplification.mean_distance, simplification.max_distance
        );
        list.add("Simplified from", format!("{} faces", count(simplification.faces_before)), &explanation);
    }
    if let Some(texture) = metrics.texture {
        let explanation =
            format!("edge of the texture of mesh.glb; photographs show {:.0} % of it", 100.0 * texture.seen);
        list.add("Texture", format!("{} texels", texture.size), &explanation);
    }
}

/// Of a model of many objects.
fn of_objects(list: &mut List, metrics: &ObjectsMetrics) {
    if let Some(best) = metrics.validation {
        let explanation = "of validation objects, at the best checkpoint";
        list.add("Silhouette IoU", format!("{:.3}", best.mask_iou), explanation);
        list.add("PSNR", format!("{:.2} dB", best.psnr), "of validation objects, on white");
    }
    list.add("Objects", count(metrics.objects), "trained on");
    list.add("Steps", count(metrics.steps), "all sessions");
    list.add("Training", seconds(metrics.training_seconds), "wall time, all sessions");
    list.add("Parameters", count(metrics.parameters), "of encoder and decoder");
}
