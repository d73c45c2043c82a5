//! The summary of one run: all that a page shows of it, gathered from its folder and, where there is one, its scene.

use std::path::Path;

use dvr_core::hull::Bounds;
use dvr_core::mesh::{TexturedMesh, UvVertices};
use dvr_core::{Camera, Scene, View, Visibility};
use dvr_render::MeshShader;
use dvr_train::{CheckpointHeader, ObjectsMetrics, RealSize, RunFolder, RunMetrics, Summary, ViewSplit, view_metrics};
use glam::DVec3;
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::coverage::Coverage;
use crate::curves::Curves;
use crate::diagnostics::{Diagnostics, disagreeing_masks};
use crate::error::{Error, Result};
use crate::mesh_data::{EncodedMesh, encode};
use crate::pictures::{ViewPictures, jpeg, view_pictures};
use crate::region_pictures::RegionPicture;
use crate::run_mesh::{page_texture, read_run_mesh, texture_of};
use crate::settings::Settings;

/// How much of a page one run may fill.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Faces of the mesh.
    pub faces: usize,
    /// Test views.
    pub views: usize,
    /// Largest width of a picture, pixels.
    pub width: u32,
    /// Largest edge of the mesh's texture, texels.
    pub texels: u32,
}

impl Budget {
    /// The share of each of `runs` on one page.
    pub fn of_runs(runs: usize) -> Self {
        let runs = runs.max(1);
        Self {
            faces: (200_000 / runs).max(8_000),
            views: if runs == 1 { 5 } else { (8 / runs).max(1) },
            width: 480,
            texels: if runs == 1 { 2048 } else { 1024 },
        }
    }

    /// A third less of everything.
    pub fn tighter(self) -> Self {
        Self {
            faces: self.faces * 2 / 3,
            views: (self.views * 2 / 3).max(1),
            width: self.width * 5 / 6,
            texels: self.texels * 4 / 5,
        }
    }
}

/// The final figures of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Figures {
    /// Of one scene.
    Scene(Box<RunMetrics>),
    /// Of a dataset of many objects.
    Objects(ObjectsMetrics),
}

/// Facts about the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFacts {
    /// Layout of its files.
    pub format: String,
    /// Views to train on, for validation, and for testing.
    pub views: [usize; 3],
    /// Size of the pictures in pixels.
    pub size: (u32, u32),
}

/// Everything that a page shows of one run.
#[derive(Clone, Debug)]
pub struct RunSummary {
    /// The folder's name.
    pub name: String,
    /// The scene's name, or that of the dataset.
    pub title: String,
    /// How the run was configured.
    pub settings: Settings,
    /// The header of the run's checkpoint.
    pub header: CheckpointHeader,
    /// The final figures.
    pub figures: Figures,
    /// The curves.
    pub curves: Curves,
    /// The mesh for the page's viewer, and facts that the viewer needs.
    pub mesh: Option<(EncodedMesh, Value)>,
    /// The mesh's texture, as a `data:` address.
    pub texture: Option<String>,
    /// How much of the surface the photographs see.
    pub coverage: Option<Coverage>,
    /// The scene, where it was found.
    pub scene: Option<SceneFacts>,
    /// Test views; training views where there are none.
    pub views: Vec<ViewPictures>,
    /// Training views with the box within which the surface was looked for.
    pub region: Vec<RegionPicture>,
    /// Whether these are test views.
    pub views_are_for_testing: bool,
    /// What the reader should know.
    pub diagnostics: Diagnostics,
    /// The preview sheet of a dataset's run, as a `data:` address.
    pub preview: Option<String>,
    /// Evaluations of a dataset's run, by the split's name.
    pub evaluations: Vec<(String, Summary)>,
}

impl RunSummary {
    /// Gathers it. `header` is that of the run's checkpoint, and `scene` its scene in the object space of training,
    /// divided as in training.
    ///
    /// # Errors
    /// [`Error::NotFinished`] when the folder holds no finished run, and others when its files are damaged.
    pub fn gather(
        folder: &RunFolder,
        header: &CheckpointHeader,
        scene: Option<&Scene>,
        budget: Budget,
    ) -> Result<Self> {
        let settings = Settings::new(&header.method, header.common.supervision)?;
        let curves = Curves::read(&folder.metrics_csv())?;
        let name = name_of(folder.root());
        let mut summary = Self {
            name,
            title: String::new(),
            settings,
            header: header.clone(),
            figures: figures(&folder.metrics_json())?,
            curves,
            mesh: None,
            texture: None,
            coverage: None,
            scene: None,
            views: Vec::new(),
            region: Vec::new(),
            views_are_for_testing: false,
            diagnostics: Diagnostics::default(),
            preview: None,
            evaluations: Vec::new(),
        };
        match summary.figures.clone() {
            Figures::Scene(metrics) => summary.gather_scene(folder, &metrics, scene, budget)?,
            Figures::Objects(metrics) => summary.gather_objects(folder, &metrics)?,
        }
        Ok(summary)
    }

    fn gather_scene(
        &mut self,
        folder: &RunFolder,
        metrics: &RunMetrics,
        scene: Option<&Scene>,
        budget: Budget,
    ) -> Result<()> {
        self.title.clone_from(&metrics.scene);
        let split = scene.map(ViewSplit::of).transpose()?;
        let to_export = RealSize::to_export(metrics.real_size.as_ref(), &self.header.object_to_world);
        let mut textured = read_run_mesh(folder, &to_export)?;
        let mesh = &mut textured.mesh;
        if let (Some(split), None, false) = (&split, &mesh.observations, mesh.is_empty()) {
            // A mesh that was written without its scene.
            let cameras: Vec<&Camera> = split.train.iter().map(|view| &view.camera).collect();
            mesh.observations = Some(Visibility::new(mesh).observe(&cameras));
        }
        self.coverage = Coverage::of(mesh);
        self.diagnostics = Diagnostics::of_scene(metrics, split.as_ref(), self.coverage, mesh.open_edges());
        if let (Some(scene), Some(split)) = (scene, &split) {
            self.scene = Some(SceneFacts {
                format: scene.format.into(),
                views: [split.train.len(), split.validation.len(), split.test.len()],
                size: scene.views.first().map_or((0, 0), |view| view.image.dimensions()),
            });
        }
        let up = scene.map_or(DVec3::Y, Scene::up);
        let cameras = split.as_ref().map_or(Value::Null, |split| {
            let others = split.validation.iter().chain(&split.test);
            let all = split.train.iter().map(|view| (view, false)).chain(others.map(|view| (view, true)));
            all.map(|(view, held_out)| frustum(&view.camera, held_out)).collect()
        });
        // What is drawn and what is packed do not wait for each other.
        let textured = &textured;
        let (drawn, packed) = rayon::join(
            || split.as_ref().map(|split| DrawnViews::new(textured, split, budget)).transpose(),
            || packed_mesh(textured, budget),
        );
        if let Some(DrawnViews { region, views, agreements }) = drawn? {
            self.views_are_for_testing = !textured.mesh.is_empty() && split.is_some_and(|split| !split.test.is_empty());
            self.region = region;
            self.views = views;
            self.diagnostics.warnings.extend(disagreeing_masks(&agreements));
        }
        let encoded;
        (self.texture, encoded) = packed?;
        let to_object = to_export.inverse().to_matrix();
        self.mesh = encoded.map(|mesh| {
            let [low, high] = mesh.bounds.map(|corner| corner.to_array());
            let facts = json!({
                "vertices": mesh.vertices, "faces": mesh.faces, "low": low, "high": high,
                "up": up.as_vec3().to_array(), "cameras": cameras, "seen": self.coverage.is_some(),
                "textured": self.texture.is_some(), "toObject": to_object.to_cols_array(),
            });
            (mesh, facts)
        });
        Ok(())
    }

    fn gather_objects(&mut self, folder: &RunFolder, metrics: &ObjectsMetrics) -> Result<()> {
        self.title = name_of(&metrics.dataset);
        self.diagnostics = Diagnostics::of_objects(metrics);
        if folder.preview().is_file() {
            self.preview = Some(jpeg(&dvr_core::files::read_rgb(&folder.preview())?)?);
        }
        for split in ["test", "val", "train"] {
            let path = folder.root().join(format!("eval_{split}")).join("summary.json");
            let Ok(text) = std::fs::read_to_string(&path) else { continue };
            let summaries: Vec<Summary> =
                serde_json::from_str(&text).map_err(|source| Error::Damaged { path, source })?;
            self.evaluations.extend(summaries.into_iter().map(|summary| (split.to_owned(), summary)));
        }
        Ok(())
    }
}

/// What a scene's views show of a run.
struct DrawnViews {
    region: Vec<RegionPicture>,
    views: Vec<ViewPictures>,
    /// How well the mask of each training view agrees with the mesh, by the view's name.
    agreements: Vec<(String, f64)>,
}

impl DrawnViews {
    /// Renders the mesh into test views, and compares it with the mask of every training view; where there is one.
    fn new(mesh: &TexturedMesh, split: &ViewSplit, budget: Budget) -> Result<Self> {
        let region = region_pictures(split, budget)?;
        if mesh.mesh.is_empty() {
            return Ok(Self { region, views: Vec::new(), agreements: Vec::new() });
        }
        let shader = MeshShader::textured(mesh);
        let shown: &[&View] = if split.test.is_empty() { &split.train } else { &split.test };
        let count = budget.views.min(shown.len());
        let chosen: Vec<&View> = (0..count).map(|i| shown[(2 * i + 1) * shown.len() / (2 * count)]).collect();
        let views = chosen.par_iter().map(|view| view_pictures(&shader, view, budget.width)).collect::<Result<_>>()?;
        let of_view = |view: &&View| Some((view.name.clone(), view_metrics(&shader, &[view], MASK_PIXELS)?.mask_iou));
        let agreements = split.train.par_iter().filter_map(of_view).collect();
        Ok(Self { region, views, agreements })
    }
}

/// The texture of a mesh, if it has one, and the mesh, as the page has them.
fn packed_mesh(textured: &TexturedMesh, budget: Budget) -> Result<(Option<String>, Option<EncodedMesh>)> {
    let Some(texture) = texture_of(textured) else {
        return Ok((None, encode(&textured.mesh, &[], budget.faces)));
    };
    let (texture, encoded) = rayon::join(
        || page_texture(texture, budget.texels),
        || {
            let split = UvVertices::of(textured);
            encode(&split.mesh, &split.uvs, budget.faces)
        },
    );
    Ok((Some(texture?), encoded))
}

/// Some training views, evenly spread, with the unit cube.
fn region_pictures(split: &ViewSplit, budget: Budget) -> Result<Vec<RegionPicture>> {
    let count = budget.views.min(split.train.len()).min(REGION_VIEWS);
    let chosen = (0..count).map(|i| split.train[(2 * i + 1) * split.train.len() / (2 * count)]);
    let chosen: Vec<&View> = chosen.collect();
    chosen.par_iter().map(|view| RegionPicture::of(view, &Bounds::UNIT_CUBE, budget.width * 2 / 3)).collect()
}

/// Most training views that are shown with the region.
const REGION_VIEWS: usize = 4;

/// Pixels by which a view's mask is compared with the mesh.
const MASK_PIXELS: usize = 2000;

/// The figures in `metrics.json`. Those of a dataset name it.
fn figures(path: &Path) -> Result<Figures> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::NotFinished { path: path.to_owned(), source })?;
    let damaged = |source| Error::Damaged { path: path.to_owned(), source };
    let is_dataset = serde_json::from_str::<Value>(&text).map_err(damaged)?.get("dataset").is_some();
    let figures = if is_dataset {
        serde_json::from_str(&text).map(Figures::Objects)
    } else {
        serde_json::from_str(&text).map(Figures::Scene)
    };
    figures.map_err(damaged)
}

/// A folder's name; for `.` and the like, the name of the folder that they stand for.
fn name_of(folder: &Path) -> String {
    let whole = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    whole.file_name().map_or_else(|| whole.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// A camera as the viewer draws it: its centre and the corners of its picture a short way in front, in object space.
fn frustum(camera: &Camera, held_out: bool) -> Value {
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
    let reach = 0.06 * camera.center().length();
    let corners = corners.map(|corner| camera.ray(corner.into()).at(reach));
    let points = [camera.center()].into_iter().chain(corners).flat_map(|point| point.to_array());
    let rounded: Vec<f64> = points.map(|value| (value * 1e4).round() / 1e4).collect();
    json!({ "points": rounded, "heldOut": held_out })
}
