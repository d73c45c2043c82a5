//! What a system learns from: the object's own files, drawn for each step.

use std::sync::Arc;

use dvr_core::dataset::{InputPicture, ObjectDataset};
use dvr_core::{GroundTruth, PointCloud, Supervision, View};
use dvr_model::{ShapeDecoderConfig, VoxelDecoder};
use glam::Vec3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::config::{System, SystemConfig};
use super::losses::ray_consistency::VoxelRay;
use super::losses::soft_silhouette::Silhouette;
use crate::error::{Error, Result};
use crate::objects::kept::Kept;
use crate::objects::object_drawer::{DrawnObject, ObjectDrawer};
use crate::objects::voxel_values::voxel_of;

/// Points of an object's surface that are kept: a step draws some of them.
const KEPT_POINTS: usize = 20_000;

/// What is learned from an object in a step.
#[derive(Clone, Debug)]
pub enum Target {
    /// Points of its surface, with normals where these are known.
    Points(PointCloud),
    /// Which voxels it fills.
    Voxels(Arc<Vec<bool>>),
    /// How it looks from some sides.
    Silhouettes(Vec<Silhouette>),
    /// Rays of some views.
    Rays(Vec<VoxelRay>),
}

/// An object of a step.
#[derive(Clone, Debug)]
pub struct SystemObject {
    /// Its place among the training objects.
    pub row: i64,
    /// What the encoder sees of it.
    pub input: Option<InputPicture>,
    /// What is learned from.
    pub target: Target,
}

/// What a step learns from.
#[derive(Clone, Debug)]
pub struct SystemBatch {
    /// The objects.
    pub objects: Vec<SystemObject>,
    /// Places in the squares of pieces of surface, as many in each, for about as many points as are compared with them.
    pub places: Vec<[f32; 2]>,
}

/// Draws the objects of each step. Step `k` depends on the seed, `k` and the files, and on nothing else.
pub(crate) struct SystemDrawer {
    dataset: Arc<ObjectDataset>,
    config: SystemConfig,
    objects: ObjectDrawer,
    surfaces: Kept<PointCloud>,
    voxels: Kept<Vec<bool>>,
}

impl SystemDrawer {
    /// # Errors
    /// When the dataset has no training objects.
    pub fn new(dataset: Arc<ObjectDataset>, config: SystemConfig) -> Result<Self> {
        let objects = ObjectDrawer::new(dataset.clone(), config.objects, config.seed, &config.encoder)?;
        Ok(Self { dataset, config, objects, surfaces: Kept::default(), voxels: Kept::default() })
    }

    /// The objects.
    pub fn objects(&self) -> &ObjectDrawer {
        &self.objects
    }

    /// Draws what a step learns from, counted from 1.
    ///
    /// # Errors
    /// When many objects in a row are broken.
    pub fn draw(&self, step: usize) -> Result<SystemBatch> {
        let (drawn, mut rng) = self.objects.draw(step, |object, rng| self.target(object, rng))?;
        let object =
            |DrawnObject { row, input, target }: DrawnObject<Target>| SystemObject { row: row as i64, input, target };
        let places = match self.config.decoder {
            ShapeDecoderConfig::Patches { patches, .. } => self.config.points.div_ceil(patches) * patches,
            _ => 0,
        };
        let places = (0..places).map(|_| rng.random()).collect();
        Ok(SystemBatch { objects: drawn.into_iter().map(object).collect(), places })
    }

    fn target(&self, object: usize, rng: &mut ChaCha8Rng) -> Result<Target> {
        match self.config.system {
            System::Psgn | System::AtlasNet | System::Pixel2Mesh => {
                let has_normals = self.config.system == System::Pixel2Mesh;
                let read = || self.known(object, |truth| surface(truth, has_normals), |cloud| !cloud.points.is_empty());
                let bytes = |cloud: &PointCloud| {
                    let normals = cloud.normals.as_deref().unwrap_or_default();
                    size_of_val(cloud.points.as_slice()) + size_of_val(normals)
                };
                let all = self.surfaces.of(object, bytes, read)?;
                let drawn: Vec<usize> =
                    (0..self.config.points).map(|_| rng.random_range(0..all.points.len())).collect();
                Ok(Target::Points(rows_of(&all, drawn)))
            }
            System::R2n2 => {
                let read = || self.known(object, voxels, |voxels| voxels.contains(&true));
                Ok(Target::Voxels(self.voxels.of(object, Vec::len, read)?))
            }
            System::SoftRas => {
                let silhouette = |view: View| {
                    let mask = view.mask.clone();
                    mask.map(|mask| Silhouette { camera: view.camera.clone(), mask })
                };
                let views = self.views(object, rng)?;
                Ok(Target::Silhouettes(views.into_iter().filter_map(silhouette).collect()))
            }
            System::Drc => {
                let views = self.views(object, rng)?;
                Ok(Target::Rays(views.iter().flat_map(|view| self.rays(view, rng)).collect()))
            }
        }
    }

    /// Some views of an object, drawn anew each time.
    fn views(&self, object: usize, rng: &mut ChaCha8Rng) -> Result<Vec<View>> {
        let count = self.dataset.views(object)?;
        let read = |_| -> Result<View> {
            let view = self.dataset.read_view(object, rng.random_range(0..count))?;
            let object = &self.dataset.objects()[object];
            let scene = || format!("{}, view {}", object.path.display(), view.name);
            if view.mask.is_none() {
                let remedy = "Systems that learn from silhouettes need masks, as DVR does.";
                return Err(
                    dvr_core::Error::format(&object.path, format!("view {} has no mask", view.name), remedy).into()
                );
            }
            if view.depth.is_none() && self.config.supervision == Supervision::Depth {
                return Err(Error::NeedsDepth { supervision: self.config.supervision, scene: scene() });
            }
            Ok(view)
        };
        (0..self.config.views).map(read).collect()
    }

    /// Pixels of a view: half of them on the object, where there are any.
    fn rays(&self, view: &View, rng: &mut ChaCha8Rng) -> Vec<VoxelRay> {
        let (width, height) = (view.camera.width, view.camera.height);
        let pixels = || (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
        let (object, others): (Vec<_>, Vec<_>) = pixels().partition(|&(u, v)| view.is_object(u, v));
        (0..self.config.rays)
            .map(|i| {
                let among = if (i % 2 == 0 && !object.is_empty()) || others.is_empty() { &object } else { &others };
                let (u, v) = among[rng.random_range(0..among.len())];
                let is_object = view.is_object(u, v);
                let depth = view.depth.as_ref().filter(|_| self.config.supervision == Supervision::Depth);
                let z_depth = depth.map(|depth| depth.get(u, v));
                // An object pixel without a depth says nothing of it.
                let z_depth = z_depth.filter(|depth| depth.is_finite() || !is_object);
                VoxelRay { ray: view.camera.pixel_ray(u, v), is_object, z_depth }
            })
            .collect()
    }

    /// What is known of the true shape of an object.
    fn known<T>(&self, object: usize, of: impl Fn(&GroundTruth) -> T, is_there: impl Fn(&T) -> bool) -> Result<T> {
        let known = of(&self.dataset.read_ground_truth(object)?);
        if is_there(&known) {
            return Ok(known);
        }
        let path = &self.dataset.objects()[object].path;
        let remedy = "Systems with 3D supervision need points on the surface; those with 2D supervision do not.";
        Err(dvr_core::Error::format(path, "there is no pointcloud.npz, or it is empty", remedy).into())
    }
}

/// Points of the surface, spread over those that are known: files are in random order or along scan lines.
fn surface(truth: &GroundTruth, has_normals: bool) -> PointCloud {
    let Some(all) = &truth.surface else { return PointCloud::default() };
    let known = all.points.len();
    let count = known.min(KEPT_POINTS);
    let spread = rows_of(all, (0..count).map(|i| i * known / count).collect());
    PointCloud { normals: spread.normals.filter(|_| has_normals), ..spread }
}

/// Some points of a cloud, without colours.
fn rows_of(cloud: &PointCloud, rows: Vec<usize>) -> PointCloud {
    let pick = |of: &Vec<Vec3>| rows.iter().filter_map(|&row| of.get(row).copied()).collect();
    PointCloud { points: pick(&cloud.points), normals: cloud.normals.as_ref().map(pick), colors: None }
}

/// The voxels that the surface passes through, and those in which most points are inside: what `binvox` makes, by which
/// 3D-R2N2's data were voxelised.
fn voxels(truth: &GroundTruth) -> Vec<bool> {
    let n = VoxelDecoder::RESOLUTION;
    let mut inside = vec![0i32; n.pow(3)];
    if let Some(samples) = &truth.occupancy {
        for (point, is_inside) in samples.points.iter().zip(&samples.inside) {
            if let Some(voxel) = voxel_of(*point, n) {
                inside[voxel] += if *is_inside { 1 } else { -1 };
            }
        }
    }
    let mut filled: Vec<bool> = inside.into_iter().map(|votes| votes > 0).collect();
    for point in truth.surface.iter().flat_map(|cloud| &cloud.points) {
        if let Some(voxel) = voxel_of(*point, n) {
            filled[voxel] = true;
        }
    }
    filled
}
