//! Several sets of photographs, each of which shows the object in another pose before another background, as one scene.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, bail};
use dvr_core::dataset::{detect_format, digest_of_scene, is_object_dataset};
use dvr_core::{Cancellation, Error, Scene};
use dvr_segmentation::{MaskCommand, Wanted};
use dvr_sfm::{FoundCameras, PoseSet, SfmOptions, Source, join_sets};

use super::cameras::{folder_beside, name_of, photographs_without_cameras, scene_of_photographs, show, with_its_name};
use super::masks::{are_missing, find};
use super::{SceneReading, print_notes};
use crate::args::{CamerasArgs, FindingArgs, MasksFrom, SceneArgs};
use crate::progress::Progress;

/// `dvr cameras` with several sets: joins and writes.
pub fn run(args: &CamerasArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let paths: Vec<PathBuf> = [&args.photographs].into_iter().chain(&args.more).cloned().collect();
    let sets = PoseSets {
        paths: &paths,
        folder: args.out.as_ref(),
        finding: &args.finding,
        reading: &SceneArgs::default(),
        segment: None,
        may_replace: args.overwrite,
    };
    let (out, found) = sets.join(cancellation)?;
    println!("{} pictures of {} sets are in one scene", found.placed, found.sets.len());
    println!(
        "wrote {0}: images/, masks/, transforms.json (nerfstudio), sfm.json, sfm.log. Look at the masks",
        out.display()
    );
    Ok(ExitCode::SUCCESS)
}

/// Sets of photographs, and how they become a scene.
pub struct PoseSets<'a> {
    /// Folders of photographs, clips or scenes, in the world of the first of which all is placed.
    pub paths: &'a [PathBuf],
    /// Where the scene goes; by default beside the first set.
    pub folder: Option<&'a PathBuf>,
    /// How cameras are found.
    pub finding: &'a FindingArgs,
    /// How sets are read.
    pub reading: &'a SceneArgs,
    /// What makes masks where no view of a set has one.
    pub segment: Option<&'a MaskCommand>,
    /// Whether cameras of other photographs are replaced.
    pub may_replace: bool,
}

impl PoseSets<'_> {
    /// Finds cameras and masks of each set, and places all in one scene; gives its folder. What is there already is taken.
    pub fn join(&self, cancellation: &Cancellation) -> Result<(PathBuf, FoundCameras)> {
        if let Some(MasksFrom::Folder(folder)) = &self.reading.masks {
            bail!(
                "--masks {}: a folder of masks is for one scene, and these are {} sets. Put masks into the folder `masks` of each",
                folder.display(),
                self.paths.len()
            );
        }
        if self.reading.masks == Some(MasksFrom::Cube) {
            bail!(
                "--masks cube takes in what is around the object, and that is not the same in all sets. Leave it out"
            );
        }
        self.check_apart()?;
        // All are looked at before the cameras of the first are found, which takes a while.
        let sources: Vec<Option<Source>> = self.paths.iter().map(|path| self.source(path)).collect::<Result<_>>()?;
        let names = distinct(self.paths.iter().map(|path| name_of(path)).collect());
        let out = match self.folder {
            Some(folder) => folder.clone(),
            None => with_its_name(&self.paths[0]).with_file_name(format!("{}-joined", names.join("-"))),
        };
        let mut scenes = Vec::new();
        for ((path, source), name) in self.paths.iter().zip(&sources).zip(&names) {
            scenes.push(match source {
                None => path.clone(),
                Some(source) => {
                    let folder = self.folder.map(|folder| cameras_beside(folder, name));
                    let folder = folder.unwrap_or_else(|| folder_beside(path));
                    scene_of_photographs(source, path, Some(&folder), self.finding, self.may_replace, cancellation)?
                }
            });
        }
        let reading = self.set_reading();
        let mut sets = Vec::new();
        for (scene, name) in scenes.iter().zip(&names) {
            let digest = digest_of_scene(scene, &reading.options, None)?;
            let how = serde_json::to_string(&reading)?;
            sets.push(PoseSet { name: name.clone(), path: scene.clone(), digest: format!("{digest} {how}") });
        }
        let options =
            SfmOptions { cancellation: cancellation.clone(), may_replace: self.may_replace, ..self.finding.options() };
        eprintln!(
            "{}: {} sets of photographs become one scene in {}; COLMAP finds what they show in common",
            names.join(", "),
            names.len(),
            out.display()
        );
        let mut progress = Progress::new();
        let mut read = |number: usize| self.read(&sets[number], &reading, cancellation);
        let mut began = false;
        let mut tell = |event| {
            began = true;
            show(&mut progress, event);
        };
        let found = join_sets(&sets, &out, &options, &mut read, &mut tell)?;
        if !began {
            print_notes(&found.notes);
        }
        Ok((out, found))
    }

    /// Refuses sets that are the same, or one within another.
    fn check_apart(&self) -> Result<()> {
        let resolved = |path: &PathBuf| -> Result<PathBuf> {
            Ok(path.canonicalize().map_err(|source| Error::Io { path: path.clone(), source })?)
        };
        let all: Vec<PathBuf> = self.paths.iter().map(resolved).collect::<Result<_>>()?;
        for (i, a) in all.iter().enumerate() {
            for (j, b) in all.iter().enumerate().take(i) {
                let (a_is, b_is) = (self.paths[i].display(), self.paths[j].display());
                if a == b {
                    bail!(
                        "{b_is} and {a_is} are the same set: give each pose of the object once, in a folder of its own"
                    );
                }
                if a.starts_with(b) || b.starts_with(a) {
                    bail!(
                        "{b_is} and {a_is}: one set lies within the other. Put each pose of the object into a folder of its own"
                    );
                }
            }
        }
        Ok(())
    }

    /// The photographs of a set; `None` where it is a scene with cameras.
    fn source(&self, path: &Path) -> Result<Option<Source>> {
        if self.reading.format.is_some() {
            return Ok(None);
        }
        if let Some(source) = photographs_without_cameras(path)? {
            return Ok(Some(source));
        }
        match detect_format(path) {
            Err(Error::NoScene { .. }) => bail!(
                "{}: there are no pictures. Each set is a folder of PNG or JPEG files, a clip, or a scene with cameras",
                path.display()
            ),
            found => found?,
        };
        if is_object_dataset(path)? {
            bail!("{}: this is a dataset of objects, and sets are photographs of one object", path.display());
        }
        Ok(None)
    }

    /// How each set is read: whole, and with its masks as they are. What else is asked for holds for the scene that they
    /// become.
    fn set_reading(&self) -> SceneReading {
        let whole =
            SceneArgs { downscale: None, views: None, ignore: Vec::new(), memory: None, ..self.reading.clone() };
        let mut reading = SceneReading::of_arguments(&whole);
        reading.refine_masks = false;
        reading.segment = self.segment.map(ToString::to_string);
        reading
    }

    /// A set with masks, which are found where no view has one.
    fn read(&self, set: &PoseSet, reading: &SceneReading, cancellation: &Cancellation) -> Result<Scene> {
        let mut reading = reading.clone();
        reading.options.max_memory = self.reading.memory;
        let (mut scene, ..) = reading.read(&set.path, |_| Ok(()), cancellation)?;
        print_notes(&scene.warnings);
        if are_missing(&scene, self.reading.masks.as_ref()) {
            eprintln!(
                "{}: no view has a mask; {}",
                set.name,
                match self.segment {
                    Some(command) => format!("`{command}` makes them"),
                    None => "the object is found from all views together".to_owned(),
                }
            );
            // What is around the object is not the same in all sets.
            let wanted = if self.reading.masks == Some(MasksFrom::Off) { Wanted::Learned } else { Wanted::Object };
            let found = find(&mut scene, self.segment, wanted, self.reading.memory, cancellation)?;
            print_notes(&[format!("{}: {}", set.name, found.summary)]);
            for (view, mask) in scene.views.iter_mut().zip(found.masks) {
                view.mask = Some(mask);
            }
        }
        scene.require_masks()?;
        Ok(scene)
    }
}

/// `DIR-top` beside `DIR`.
fn cameras_beside(folder: &Path, name: &str) -> PathBuf {
    let place = with_its_name(folder);
    place.with_file_name(format!("{}-{name}", place.file_name().unwrap_or(place.as_os_str()).to_string_lossy()))
}

/// Names that are there twice get a number.
fn distinct(names: Vec<String>) -> Vec<String> {
    let mut given: Vec<String> = Vec::new();
    for name in names {
        let numbered = (2..).map(|number| format!("{name}{number}"));
        let free = [name.clone()].into_iter().chain(numbered).find(|name| !given.contains(name));
        given.extend(free);
    }
    given
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_of_one_name_are_told_apart() {
        let names = ["photos", "photos", "photos2", "photos"].map(str::to_owned);
        assert_eq!(distinct(names.to_vec()), ["photos", "photos2", "photos22", "photos3"]);
        assert_eq!(cameras_beside(Path::new("runs/mug"), "top"), Path::new("runs/mug-top"));
    }
}
