//! The main figures of a run, as tiles and tables show them.

use dvr_train::{ObjectsMetrics, RunMetrics};

use crate::coverage::Coverage;
use crate::html::{bytes, count, seconds};
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
    if let Some(held_out) = metrics.held_out_mesh {
        let explanation = "of the coloured mesh in views that were not trained on, on white";
        list.add("PSNR", format!("{:.2} dB", held_out.psnr), explanation);
        let explanation = "of the mesh and the masks of views that were not trained on";
        list.add("Silhouette IoU", format!("{:.4}", held_out.mask_iou), explanation);
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
    if let Some(iou) = metrics.shape.volume_iou {
        list.add("Volume IoU", format!("{iou:.3}"), "against the true occupancy");
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
