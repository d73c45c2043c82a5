//! The pictures of a set, as all sets share them: undistorted, with masks, by names that no other set has.

use std::collections::BTreeSet;
use std::path::PathBuf;

use dvr_core::files::{read_text, write_bytes_atomically, write_gray_png, write_rgb_png};
use dvr_core::{Camera, Scene, Similarity, View};
use image::GrayImage;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::{Result, SfmError, some};
use crate::options::{Event, SfmOptions};
use crate::pictures::Prepared;
use crate::steps::{MASKS, PICTURES};
use crate::workspace::{Workspace, refused};

/// Where features are looked for.
pub(super) const FEATURE_MASKS: &str = "feature_masks";

/// Fewer views with a mask show no surface.
const LEAST: usize = 3;

/// Pictures that are written at once.
const AT_ONCE: usize = 16;

/// A set of photographs that shows the object in one pose.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PoseSet {
    /// What the names of its pictures begin with.
    pub name: String,
    /// Where it is.
    pub path: PathBuf,
    /// What it holds and how it is read, as a digest: what is finished is kept for the same.
    pub digest: String,
}

/// A picture of a set.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct SetView {
    /// The name of its file, and of that of its mask.
    pub name: String,
    /// Its camera, in the world of the set.
    pub camera: Camera,
}

impl SetView {
    /// As COLMAP gets it.
    pub fn prepared(&self) -> Prepared {
        let Camera { width, height, intrinsics, .. } = &self.camera;
        let pinhole = [intrinsics.x_axis.x, intrinsics.y_axis.y, intrinsics.z_axis.x, intrinsics.z_axis.y];
        Prepared {
            name: self.name.clone(),
            mask: Some(self.name.clone()),
            size: (*width, *height),
            // To a millionth of a pixel: COLMAP is run once for each camera.
            camera: format!("{width}x{height} {pinhole:.6?}"),
            pinhole: Some(pinhole),
        }
    }

    /// With its camera in the world that `to_first` leads to.
    pub fn placed(&self, to_first: &Similarity) -> Self {
        Self { name: self.name.clone(), camera: self.camera.into_world(to_first) }
    }
}

/// The file, in the folder of what is half-finished, of a set's pictures.
fn list(number: usize) -> String {
    format!("set_{number}.json")
}

/// Writes pictures and masks of all views of a set that have a mask.
pub(super) fn write_set(
    workspace: &mut Workspace,
    number: usize,
    set: &PoseSet,
    scene: &Scene,
    options: &SfmOptions,
    tell: &mut dyn FnMut(Event),
) -> Result<()> {
    let (with, without): (Vec<&View>, Vec<&View>) = scene.views.iter().partition(|view| view.mask.is_some());
    if !without.is_empty() {
        let names: Vec<String> = without.iter().map(|view| view.name.clone()).collect();
        let note =
            format!("{} pictures of `{}` have no mask and are left out: {}", names.len(), set.name, some(&names));
        tell(Event::Note(note.clone()));
        workspace.note(note);
    }
    if with.len() < LEAST {
        return Err(SfmError::TooFewPictures { path: set.path.clone(), found: with.len(), least: LEAST });
    }
    let file = |view: &View| format!("{}_{}.png", set.name, view.name);
    // `a` may have a picture `b_1`, and `a_b` a picture `1`.
    for other in 0..number {
        let known: BTreeSet<String> = read_set(workspace, other)?.into_iter().map(|view| view.name).collect();
        if let Some(view) = with.iter().find(|view| known.contains(&file(view))) {
            return Err(SfmError::SameName { path: set.path.clone(), first: file(view), second: file(view) });
        }
    }
    let [pictures, masks, feature_masks] = [PICTURES, MASKS, FEATURE_MASKS].map(|part| workspace.work(part));
    for folder in [&pictures, &masks, &feature_masks] {
        std::fs::create_dir_all(folder).map_err(|source| refused(folder, source))?;
    }
    tell(Event::Step { name: "pictures of the set", parts: with.len() });
    let one = |view: &&View| -> Result<SetView> {
        options.cancellation.check()?;
        let name = file(view);
        write_rgb_png(&pictures.join(&name), &view.image)?;
        if let Some(mask) = &view.mask {
            write_gray_png(&masks.join(&name), &mask.coverage)?;
            let (width, height) = mask.size();
            // COLMAP takes everything for the object that is not black.
            let whole =
                GrayImage::from_fn(width, height, |u, v| image::Luma([if mask.is_object(u, v) { 255 } else { 0 }]));
            write_gray_png(&feature_masks.join(format!("{name}.png")), &whole)?;
        }
        Ok(SetView { name, camera: view.camera.into_world(&scene.object_to_world) })
    };
    let mut views: Vec<SetView> = Vec::with_capacity(with.len());
    for some in with.chunks(AT_ONCE) {
        views.extend(some.par_iter().map(&one).collect::<Result<Vec<_>>>()?);
        tell(Event::Progress(views.len()));
    }
    let json = serde_json::to_vec(&views).map_err(|error| refused(&set.path, std::io::Error::other(error)))?;
    write_bytes_atomically(&workspace.work(&list(number)), &json)?;
    Ok(())
}

/// The pictures of a set that [`write_set`] wrote.
pub(super) fn read_set(workspace: &Workspace, number: usize) -> Result<Vec<SetView>> {
    let path = workspace.work(&list(number));
    serde_json::from_str(&read_text(&path)?).map_err(|error| refused(&path, std::io::Error::other(error)))
}
