//! The steps of structure from motion, each a command of COLMAP.
//!
//! Options go by the names of COLMAP 3.8 and later: some moved from `SiftExtraction` to `FeatureExtraction` and from
//! `SiftMatching` to `FeatureMatching`.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use dvr_core::dataset::{ColmapModel, read_colmap_model};

use crate::child::{Heard, Task, run};
use crate::database::{LeftOut, MatchTable, Matches, left_out};
use crate::engine::{Engine, Options};
use crate::error::{Result, SfmError};
use crate::options::{CameraSharing, Event, Mapper, Matching, SfmOptions};
use crate::pictures::Prepared;
use crate::progress::progress_of;
use crate::static_background::StaticBackground;
use crate::workspace::{Workspace, refused, remove};

/// Up to this many pictures are compared each with each.
pub(crate) const FEW: usize = 300;

/// Up to this many frames of a clip.
const FEW_FRAMES: usize = 40;

/// In a sequence, each picture is compared with this many that follow it, and with those at distances of powers of two.
const OVERLAP: usize = 10;

/// About this many pictures of a sequence are compared each with each, so that a walk around an object closes.
const ANCHORS: usize = 40;

/// Features are looked for in pictures of at most this many pixels along their longer side: finer ones are beyond
/// [`SfmOptions::features`] in most pictures, and take long to find.
const LONGEST_SIDE: usize = 2000;

/// Fewer pictures do not tell the principal point: it trades against their rotations.
const TELL_PRINCIPAL_POINT: usize = 30;

/// A model of fewer pictures is no model.
const LEAST_PICTURES: usize = 3;

/// The pictures of a database, a model's features and a model.
pub(crate) const DATABASE: &str = "database.db";
pub(crate) const PICTURES: &str = "pictures";
pub(crate) const MASKS: &str = "masks";
const MODELS: &str = "models";

/// The largest of them, with pictures that were left out at first.
const LARGER_MODEL: &str = "larger_model";

/// Points that are enough to place a picture in a model that stands: as many as COLMAP asks two pictures to share. It asks
/// for twice as many otherwise.
const FEW_POINTS: usize = 15;
pub(crate) const REFINED: &str = "refined";
pub(crate) const UNDISTORTED: &str = "undistorted";
pub(crate) const TEXT_MODEL: &str = "text";

/// COLMAP at work.
pub(crate) struct Steps<'a> {
    pub engine: &'a Engine,
    pub options: &'a SfmOptions,
    /// Whether the pictures are frames of a clip.
    pub is_clip: bool,
    /// A folder of masks, in that of what is half-finished, by the names of the pictures with `.png` behind them: features are looked
    /// for where they are not black.
    pub feature_masks: Option<&'static str>,
    pub tell: &'a mut dyn FnMut(Event),
}

impl Steps<'_> {
    /// SIFT features of all pictures, camera by camera.
    pub fn features(&mut self, workspace: &mut Workspace) -> Result<()> {
        for ending in ["", "-wal", "-shm", "-journal"] {
            remove(&workspace.work(&format!("{DATABASE}{ending}")))?;
        }
        let pictures = workspace.pictures().to_vec();
        self.begin("features", pictures.len());
        let known = self.engine.options("feature_extractor");
        let mut done = 0;
        for (number, group) in groups(&pictures).values().enumerate() {
            let names: Vec<&str> = group.iter().map(|picture| picture.name.as_str()).collect();
            let list = workspace.work(&format!("camera_{number}.txt"));
            std::fs::write(&list, names.join("\n") + "\n").map_err(|source| refused(&list, source))?;
            let mut command = self.engine.command("feature_extractor");
            command.arg("--database_path").arg(workspace.work(DATABASE));
            command.arg("--image_path").arg(workspace.work(PICTURES)).arg("--image_list_path").arg(&list);
            match group.iter().find_map(|picture| picture.pinhole) {
                Some(pinhole) => {
                    known.set(&mut command, &["ImageReader.camera_model"], "PINHOLE");
                    let numbers = pinhole.map(|number| number.to_string()).join(",");
                    known.set(&mut command, &["ImageReader.camera_params"], numbers);
                }
                None => known.set(&mut command, &["ImageReader.camera_model"], &self.options.camera_model),
            }
            if let Some(masks) = self.feature_masks {
                known.set(&mut command, &["ImageReader.mask_path"], workspace.work(masks).display());
            }
            let sharing = match self.options.sharing {
                CameraSharing::Picture => "ImageReader.single_camera_per_image",
                _ => "ImageReader.single_camera",
            };
            known.set(&mut command, &[sharing], 1);
            known.set(&mut command, &["SiftExtraction.max_num_features"], self.options.features);
            known.set(
                &mut command,
                &["FeatureExtraction.max_image_size", "SiftExtraction.max_image_size"],
                LONGEST_SIDE,
            );
            self.set_device(&mut command, &known, ["FeatureExtraction", "SiftExtraction"]);
            self.run(&mut command, "features", workspace, done)?;
            done += names.len();
        }
        Ok(())
    }

    /// Matches of features between pictures, verified by a geometry of two views.
    pub fn matches(&mut self, workspace: &mut Workspace) -> Result<()> {
        let count = workspace.pictures().len();
        self.begin("matching", 1);
        if let Some(tree) = &self.options.vocabulary_tree {
            let tree = tree.clone();
            let (mut command, known) = self.matcher("vocab_tree_matcher", workspace);
            known.set(&mut command, &["VocabTreeMatching.vocab_tree_path"], tree.display());
            return self.run(&mut command, "matching", workspace, 0);
        }
        match self.options.matching.unwrap_or_else(|| self.matching_of(count)) {
            Matching::Exhaustive => {
                let (mut command, known) = self.matcher("exhaustive_matcher", workspace);
                // Smaller blocks read features more often and say more often how far it is.
                known.set(&mut command, &["ExhaustiveMatching.block_size"], (count / 6).clamp(5, 50));
                self.run(&mut command, "matching", workspace, 0)
            }
            Matching::Spatial => {
                let (mut command, _) = self.matcher("spatial_matcher", workspace);
                self.run(&mut command, "matching", workspace, 0)
            }
            Matching::Sequential => {
                let (mut command, known) = self.matcher("sequential_matcher", workspace);
                known.set(&mut command, &["SequentialMatching.overlap"], OVERLAP);
                known.set(&mut command, &["SequentialMatching.quadratic_overlap"], 1);
                known.set(&mut command, &["SequentialMatching.loop_detection"], 0);
                self.run(&mut command, "matching", workspace, 0)?;
                self.close_loops(workspace)
            }
        }
    }

    /// Leaves matches out that show what stands still behind a turntable, and verifies the others anew.
    pub fn leave_out_static_background(&mut self, workspace: &mut Workspace) -> Result<()> {
        let database = workspace.work(DATABASE);
        let left_out = match left_out(&database) {
            // A process that was killed then may not have verified all.
            Some(left_out) => left_out,
            None => {
                let Some(left_out) = drop_static_background(workspace)? else { return Ok(()) };
                left_out
            }
        };
        self.matches(workspace)?;
        let LeftOut { left_out, of } = left_out;
        let note = format!(
            "the pictures show something that stands still while the object turns: {left_out} of {of} matches, which are left out"
        );
        workspace.note(note.clone());
        (self.tell)(Event::Note(note));
        Ok(())
    }

    /// Which pictures are compared where nobody says it.
    fn matching_of(&self, count: usize) -> Matching {
        let few = if self.is_clip { FEW_FRAMES } else { FEW };
        if count <= few { Matching::Exhaustive } else { Matching::Sequential }
    }

    /// Compares every so many-th picture with every other of these.
    fn close_loops(&mut self, workspace: &mut Workspace) -> Result<()> {
        let names: Vec<&str> = workspace.pictures().iter().map(|picture| picture.name.as_str()).collect();
        let Some(pairs) = pairs_of_anchors(&names) else {
            let note = "names of pictures hold spaces, so that COLMAP cannot be told to close loops of the sequence";
            workspace.note(note.to_owned());
            (self.tell)(Event::Note(note.to_owned()));
            return Ok(());
        };
        let list = workspace.work("loops.txt");
        std::fs::write(&list, pairs).map_err(|source| refused(&list, source))?;
        self.begin("closing loops", 1);
        let (mut command, _) = self.matcher("matches_importer", workspace);
        command.arg("--match_list_path").arg(&list).arg("--match_type").arg("pairs");
        self.run(&mut command, "matching", workspace, 0)
    }

    /// A command that matches, and its options.
    fn matcher(&self, name: &str, workspace: &Workspace) -> (Command, Options) {
        let (mut command, known) = (self.engine.command(name), self.engine.options(name));
        command.arg("--database_path").arg(workspace.work(DATABASE));
        self.set_device(&mut command, &known, ["FeatureMatching", "SiftMatching"]);
        (command, known)
    }

    /// Poses and points.
    pub fn mapping(&mut self, workspace: &mut Workspace) -> Result<()> {
        let models = workspace.empty(MODELS)?;
        match self.options.mapper {
            Mapper::Incremental => {
                self.incremental_mapping(workspace, &models)?;
                self.place_rest(workspace)?;
            }
            Mapper::Global => self.global_mapping(workspace, &models)?,
        }
        if folders(&models).is_empty() {
            let pictures = workspace.pictures().len();
            return Err(SfmError::NoModel { pictures, log: workspace.log.path.clone() });
        }
        Ok(())
    }

    /// All pictures at once.
    fn global_mapping(&mut self, workspace: &mut Workspace, models: &Path) -> Result<()> {
        self.begin("global mapping", 1);
        let (mut command, program) = self.engine.global_mapper()?;
        command.arg("--database_path").arg(workspace.work(DATABASE));
        command.arg("--image_path").arg(workspace.work(PICTURES)).arg("--output_path").arg(models);
        self.run_program(program, &mut command, "mapping", workspace, 0)
    }

    /// Picture by picture with bundle adjustment.
    fn incremental_mapping(&mut self, workspace: &mut Workspace, models: &Path) -> Result<()> {
        self.begin("mapping", workspace.pictures().len());
        let (mut command, known) = self.mapper(workspace, models);
        known.set(&mut command, &["Mapper.min_model_size"], LEAST_PICTURES);
        let ended = self.run(&mut command, "mapping", workspace, 0);
        // The mapper fails where it finds no two pictures to begin with, which is no fault of its own.
        match ended {
            Err(SfmError::Failed { how, .. }) if how.starts_with("exit status: 1") && folders(models).is_empty() => {
                Ok(())
            }
            ended => ended,
        }
    }

    /// Pictures that are not in the largest model, once more: to a model that stands, fewer points tell where a picture was
    /// taken. Whether two pictures further apart have enough matches differs from run to run.
    fn place_rest(&mut self, workspace: &mut Workspace) -> Result<()> {
        let models = models(workspace)?;
        let pictures = workspace.pictures().len();
        let Some((largest, model)) = models.first().filter(|(_, model)| model.pictures.len() < pictures) else {
            return Ok(());
        };
        self.begin("mapping of those left out", pictures);
        let larger = workspace.empty(LARGER_MODEL)?;
        let (mut command, known) = self.mapper(workspace, &larger);
        command.arg("--input_path").arg(largest);
        known.set(&mut command, &["Mapper.abs_pose_min_num_inliers"], FEW_POINTS);
        match self.run(&mut command, "mapping", workspace, 0) {
            // The model that stands is as good as before.
            Err(SfmError::Failed { how, .. }) => {
                let note = format!(
                    "COLMAP failed ({how}) as it tried the pictures that it had left out once more; the model without \
                     them is taken (sfm.log has its words)"
                );
                (self.tell)(Event::Note(note.clone()));
                workspace.note(note);
                return Ok(());
            }
            ended => ended?,
        }
        let found = read_colmap_model(&larger)?;
        if found.pictures.len() <= model.pictures.len() {
            return Ok(());
        }
        let names: HashSet<&str> = found.pictures.iter().map(|picture| picture.name.as_str()).collect();
        for (folder, model) in &models {
            if model.pictures.iter().all(|picture| names.contains(picture.name.as_str())) {
                std::fs::remove_dir_all(folder).map_err(|source| refused(folder, source))?;
            }
        }
        std::fs::rename(&larger, largest).map_err(|source| refused(largest, source))
    }

    /// The command of the incremental mapper, and its options.
    fn mapper(&self, workspace: &Workspace, output: &Path) -> (Command, Options) {
        let (mut command, known) = (self.engine.command("mapper"), self.engine.options("mapper"));
        command.arg("--database_path").arg(workspace.work(DATABASE));
        command.arg("--image_path").arg(workspace.work(PICTURES)).arg("--output_path").arg(output);
        if workspace.pictures().iter().all(|picture| picture.pinhole.is_some()) {
            for what in ["focal_length", "principal_point", "extra_params"] {
                known.set(&mut command, &[format!("Mapper.ba_refine_{what}").as_str()], 0);
            }
        }
        if let Some(threads) = self.options.threads {
            known.set(&mut command, &["Mapper.num_threads"], threads);
        }
        (command, known)
    }

    /// A last bundle adjustment of a model that moves the principal point, too, where enough pictures share their intrinsics:
    /// the mapper holds it in the middle, and turns cameras to make up for that.
    pub fn refinement(&mut self, workspace: &mut Workspace, model: &Path) -> Result<()> {
        let target = workspace.empty(REFINED)?;
        self.begin("refinement", 1);
        let known = self.engine.options("bundle_adjuster");
        let mut command = self.engine.command("bundle_adjuster");
        command.arg("--input_path").arg(model).arg("--output_path").arg(&target);
        // On a turntable all cameras are inclined alike: the principal point trades against that.
        let is_turntable = left_out(&workspace.work(DATABASE)).is_some();
        let is_told = workspace.pictures().len() >= TELL_PRINCIPAL_POINT && !is_turntable;
        if is_told && self.options.sharing != CameraSharing::Picture {
            known.set(&mut command, &["BundleAdjustment.refine_principal_point"], 1);
        }
        self.run(&mut command, "refinement", workspace, 0)
    }

    /// Undistorted pictures of a model, which is written as text.
    pub fn undistortion(&mut self, workspace: &mut Workspace, model: &Path) -> Result<()> {
        let (target, text) = (workspace.empty(UNDISTORTED)?, workspace.empty(TEXT_MODEL)?);
        self.begin("undistortion", workspace.pictures().len());
        let mut command = self.engine.command("image_undistorter");
        command.arg("--image_path").arg(workspace.work(PICTURES)).arg("--input_path").arg(model);
        command.arg("--output_path").arg(&target).args(["--output_type", "COLMAP"]);
        self.run(&mut command, "undistortion", workspace, 0)?;
        let mut command = self.engine.command("model_converter");
        command.arg("--input_path").arg(target.join("sparse"));
        command.arg("--output_path").arg(&text).args(["--output_type", "TXT"]);
        self.run(&mut command, "undistortion", workspace, 0)
    }

    fn begin(&mut self, name: &'static str, parts: usize) {
        (self.tell)(Event::Step { name, parts });
    }

    /// On the CPU, unless a GPU is asked for, with the threads that are allowed.
    fn set_device(&self, command: &mut Command, known: &Options, groups: [&str; 2]) {
        let names = |option: &str| groups.map(|group| format!("{group}.{option}"));
        let set = |command: &mut Command, option: &str, value: usize| {
            let names = names(option);
            known.set(command, &[names[0].as_str(), names[1].as_str()], value);
        };
        set(command, "use_gpu", usize::from(self.options.gpu));
        if let Some(threads) = self.options.threads {
            set(command, "num_threads", threads);
        }
    }

    /// Runs a command of COLMAP and tells how far it is; `before` parts of the step were done by others.
    fn run(
        &mut self,
        command: &mut Command,
        step: &'static str,
        workspace: &mut Workspace,
        before: usize,
    ) -> Result<()> {
        self.run_program("colmap", command, step, workspace, before)
    }

    fn run_program(
        &mut self,
        program: &'static str,
        command: &mut Command,
        step: &'static str,
        workspace: &mut Workspace,
        before: usize,
    ) -> Result<()> {
        let task = Task { program, step, takes_bytes: false };
        let mut known_parts = 0;
        let tell = &mut self.tell;
        let mut heard = |heard: Heard<'_>| {
            let Heard::Line(line) = heard else { return };
            let Some((done, parts)) = progress_of(line) else { return };
            // Matching says only by its first line of how many parts it is made.
            if let Some(parts) = parts.filter(|parts| step == "matching" && *parts != known_parts) {
                known_parts = parts;
                tell(Event::Step { name: step, parts });
            }
            tell(Event::Progress(before + done));
        };
        run(command, task, &mut workspace.log, &self.options.cancellation, &mut heard)
    }
}

/// Takes matches of what stands still out of the database; how many, or `None` where nothing does.
fn drop_static_background(workspace: &mut Workspace) -> Result<Option<LeftOut>> {
    let mut sizes = workspace.pictures().iter().map(|picture| picture.size);
    // A camera on a tripod is not turned upright.
    let Some(size) = sizes.next().filter(|size| sizes.all(|other| other == *size)) else { return Ok(None) };
    let path = workspace.work(DATABASE);
    let matches = match Matches::read(&path, MatchTable::Raw) {
        Ok(matches) => matches,
        Err(error) => {
            // A COLMAP that keeps them otherwise still finds cameras.
            workspace.log.line(&format!("whether something stands still was not looked for: {error}"));
            return Ok(None);
        }
    };
    let Some(background) = StaticBackground::of(&matches, f64::from(size.0.max(size.1))) else { return Ok(None) };
    let moving = background.without(&matches);
    let count = |matches: &Matches| matches.pairs.iter().map(|pair| pair.matches.len()).sum::<usize>();
    let of = count(&matches);
    let left_out = LeftOut { left_out: of - count(&moving), of };
    moving.replace(&path, left_out)?;
    Ok(Some(left_out))
}

/// Pictures by their camera.
fn groups(pictures: &[Prepared]) -> BTreeMap<&str, Vec<&Prepared>> {
    let mut groups: BTreeMap<&str, Vec<&Prepared>> = BTreeMap::new();
    for picture in pictures {
        groups.entry(&picture.camera).or_default().push(picture);
    }
    groups
}

/// Lines of two names each; `None` where a name holds a space, which parts them.
fn pairs_of_anchors(names: &[&str]) -> Option<String> {
    if names.iter().any(|name| name.contains(char::is_whitespace)) {
        return None;
    }
    let anchors: Vec<&str> = names.iter().copied().step_by(names.len().div_ceil(ANCHORS).max(1)).collect();
    let pairs = anchors.iter().enumerate().flat_map(|(i, a)| anchors[..i].iter().map(move |b| format!("{b} {a}\n")));
    Some(pairs.collect())
}

/// Folders in a folder.
fn folders(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut folders: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

/// The models of the mapper, that with the most pictures first; of two, that with more points.
pub(crate) fn models(workspace: &Workspace) -> Result<Vec<(PathBuf, ColmapModel)>> {
    let read = |path: PathBuf| Ok((path.clone(), read_colmap_model(&path)?));
    let mut models: Vec<_> = folders(&workspace.work(MODELS)).into_iter().map(read).collect::<Result<_>>()?;
    models.sort_by_key(|(_, model)| std::cmp::Reverse((model.pictures.len(), model.points.points.len())));
    Ok(models)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn anchors_span_a_sequence_and_few_pictures_are_all_anchors() {
        let names: Vec<String> = (0..200).map(|i| format!("{i:05}.jpg")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let pairs = pairs_of_anchors(&names).unwrap();
        assert_eq!(pairs.lines().count(), 40 * 39 / 2);
        assert!(pairs.contains("00000.jpg 00195.jpg\n"));
        assert_eq!(pairs_of_anchors(&names[..3]).unwrap().lines().count(), 3);
        assert_eq!(pairs_of_anchors(&["a b.jpg"]), None);
    }
}
