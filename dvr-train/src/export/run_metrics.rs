//! The figures of a finished run.

use dvr_core::ViewNames;
use dvr_core::metrics::Simplification;
use dvr_render::ViewMetrics;
use dvr_texture::TextureReport;
use serde::{Deserialize, Serialize};

use crate::evaluate::{DepthMapsEvaluation, PointsEvaluation, ShapeEvaluation};
use crate::export::pictures::PicturesOf;
use crate::export::real_size::RealSize;
use crate::export::support::Support;
use crate::resources::Resources;

/// The figures of a finished run: `metrics.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunMetrics {
    /// Name of the scene.
    pub scene: String,
    /// What the shape was learned from.
    pub supervision: String,
    /// Seed.
    pub seed: u64,
    /// Optimiser steps of the run, all sessions.
    pub steps: usize,
    /// The step whose model the results were made from: the best where views were validated, else the last.
    pub model_step: usize,
    /// Numbers that the field consists of.
    pub parameters: usize,
    /// Cells along an edge of the cube, where it is a grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cells: Option<usize>,
    /// Bytes that its numbers are stored in.
    pub bytes: usize,
    /// Wall seconds of training, warm start included, all sessions.
    pub training_seconds: f64,
    /// Of these, the seconds until `model_step`.
    pub model_seconds: f64,
    /// Vertices and faces of the mesh; `None` where there is no surface.
    pub mesh: Option<[usize; 2]>,
    /// Pairs of its faces that intersect though they have no corner in common ([`dvr_core::metrics::self_intersections`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub self_intersections: Option<usize>,
    /// What it was simplified from, and how far the surface moved by that, in the units of the scene's files; `None` where
    /// it was not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simplification: Option<Simplification>,
    /// The real size of the object; where it is known, the mesh is in metres, and all other figures are in the units that they
    /// have without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub real_size: Option<RealSize>,
    /// What the object stands on, where that was found with its masks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub support: Option<Support>,
    /// The texture of the mesh; `None` where it has none.
    #[serde(default)]
    pub texture: Option<TextureReport>,
    /// The shape against the truth, where the scene has it.
    pub shape: ShapeEvaluation,
    /// The mesh against the points that come with the scene, where it brings any; in the units of its files.
    #[serde(default)]
    pub points: Option<PointsEvaluation>,
    /// The depth maps that the run started from; `None` where there were none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_maps: Option<DepthMapsEvaluation>,
    /// Which views were trained on, which chose during the run (growth, best step), and which are tested on.
    pub views: ViewNames,
    /// Renders of the field against test views, on an even subset of their pixels: nothing was chosen by these.
    pub test: Option<ViewMetrics>,
    /// What `dvr render` shows against the same pixels; `None` where there are no validation views that choose it, and for
    /// methods of which it shows the field.
    #[serde(default, alias = "test_view_color", skip_serializing_if = "Option::is_none")]
    pub test_pictures: Option<ViewMetrics>,
    /// What that is: of field and mesh, each with and without colours that depend on the viewing direction, the one that is
    /// nearest to validation views.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pictures_of: Option<PicturesOf>,
    /// Renders of the mesh with its texture (without one, with the colours of its vertices), unlit, against the same
    /// pixels: what the user takes home.
    pub test_mesh: Option<ViewMetrics>,
    /// Renders of the field against validation views, which the run was guided by: no measure of quality.
    pub validation: Option<ViewMetrics>,
    /// The darkest and the brightest training photograph, in stops from their mean, where exposures were corrected: each
    /// test and validation view is then compared at its own exposure, which one half of its pixels tells, on the other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_stops: Option<[f64; 2]>,
    /// What the process has cost until here, reading and mesh included.
    pub resources: Resources,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// What training decided on the way and why: how fine the field became, say.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Wall seconds of each part of the work after training; figures of the shape are made meanwhile.
    #[serde(default)]
    pub finishing_seconds: Vec<(String, f64)>,
    /// Wall and CPU seconds that went into following the shape, beside the clock of training.
    #[serde(default)]
    pub measuring_seconds: [f64; 2],
}
