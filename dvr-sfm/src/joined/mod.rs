//! Sets of photographs that show one object in different poses, each with cameras of its own, as one scene.
//!
//! Within a set the background holds still and tells where cameras stand. From set to set it does not: there the object
//! alone is the same. Features are therefore looked for within masks, and matched over all sets together. A point that two
//! sets show is triangulated twice, each time by the cameras of one set, and most of these pairs tell the similarity
//! between the worlds of both. No camera is looked for anew: a part of each picture tells it less well than the whole did.

mod registration;
mod set_pictures;
mod tracks;

use std::path::Path;

use dvr_core::Scene;
use dvr_core::dataset::write_transforms;
use dvr_core::files::check_beside_data;
use dvr_core::mesh::{Mesh, write_mesh};
use sha2::{Digest, Sha256};

use crate::database::{MatchTable, Matches};
use crate::engine::Engine;
use crate::error::SfmError;
use crate::options::{CameraSharing, Event, Matching, SfmOptions};
use crate::result::{FoundCameras, PlacedSet};
use crate::steps::{DATABASE, FEW, MASKS, PICTURES, Steps};
use crate::workspace::Workspace;
use registration::{Placement, SharedPoints, place_sets};
pub use set_pictures::PoseSet;
use set_pictures::{FEATURE_MASKS, SetView, read_set, write_set};

/// Version of what is made: another one begins anew.
const VERSION: u32 = 2;

/// Places sets of photographs of one object in different poses in the world of the first, and writes all to the folder
/// `out` as one scene; what is finished there for the same sets and options is taken as it is.
///
/// `read` gives the scene of a set, by its place in `sets`: with cameras, and with masks that leave out what does not
/// move with the object. It is asked where that is not finished yet. `tell` is told what happens.
///
/// # Errors
/// What `read` fails with; [`SfmError::NotConnected`] where a set shares too little with the others, and others as of
/// [`find_cameras`](crate::find_cameras).
pub fn join_sets<E: From<SfmError>>(
    sets: &[PoseSet],
    out: &Path,
    options: &SfmOptions,
    read: &mut dyn FnMut(usize) -> Result<Scene, E>,
    tell: &mut dyn FnMut(Event),
) -> Result<FoundCameras, E> {
    let key = key_of(sets, options);
    if let Some(found) = FoundCameras::read(out).filter(|found| found.key == key) {
        return Ok(found);
    }
    for set in sets {
        check_beside_data(out, &set.path).map_err(SfmError::from)?;
    }
    let purpose = "finds what photographs of an object in different poses have in common";
    let engine = Engine::find(options.program.as_deref(), purpose, &options.cancellation)?;
    let mut workspace = Workspace::open(out, &key, options.may_replace)?;
    for (number, set) in sets.iter().enumerate() {
        let step = format!("pictures of {}", set.name);
        if workspace.is_finished(&step) {
            continue;
        }
        let scene = match read(number) {
            Ok(scene) => scene,
            Err(error) => {
                if workspace.is_new() {
                    workspace.discard()?;
                }
                return Err(error);
            }
        };
        workspace.step(&step, |workspace| write_set(workspace, number, set, &scene, options, tell))?;
    }
    Ok(join(workspace, sets, &engine, &key, options, tell)?)
}

/// From the pictures of all sets to the scene.
fn join(
    mut workspace: Workspace,
    sets: &[PoseSet],
    engine: &Engine,
    key: &str,
    options: &SfmOptions,
    tell: &mut dyn FnMut(Event),
) -> Result<FoundCameras, SfmError> {
    let views: Vec<Vec<SetView>> =
        (0..sets.len()).map(|number| read_set(&workspace, number)).collect::<Result<_, _>>()?;
    let all: usize = views.iter().map(Vec::len).sum();
    // Each picture is compared with each other, whatever its set; of many, some tell how sets belong together.
    let stride = all.div_ceil(FEW).max(1);
    let asked = views.iter().flat_map(|views| views.iter().step_by(stride));
    workspace.set_pictures(asked.map(SetView::prepared).collect());
    let options_of_all = SfmOptions {
        matching: Some(Matching::Exhaustive),
        vocabulary_tree: None,
        sharing: CameraSharing::Similar,
        ..options.clone()
    };
    let mut steps =
        Steps { engine, options: &options_of_all, is_clip: false, feature_masks: Some(FEATURE_MASKS), tell };
    workspace.step("features", |workspace| steps.features(workspace))?;
    workspace.step("matching", |workspace| steps.matches(workspace))?;
    let points = SharedPoints::of(&Matches::read(&workspace.work(DATABASE), MatchTable::Verified)?, &views);
    let placements = place_sets(&points, sets.len());
    let unsure = sets.iter().zip(&placements).find(|(_, placement)| !placement.is_sure());
    if let Some((set, placement)) = unsure {
        return Err(SfmError::NotConnected {
            set: set.name.clone(),
            shared: placement.shared,
            agreeing: placement.agreeing,
            least: placement.least(),
            log: workspace.log.path.clone(),
        });
    }
    let joined = Joined { sets, views, points, placements };
    joined.publish(workspace, &engine.version, key, tell)
}

/// Sets that have their places.
struct Joined<'a> {
    sets: &'a [PoseSet],
    /// The pictures of each.
    views: Vec<Vec<SetView>>,
    points: SharedPoints,
    placements: Vec<Placement>,
}

impl Joined<'_> {
    /// Moves what was made to its place, the description of it last.
    fn publish(
        self,
        mut workspace: Workspace,
        engine: &str,
        key: &str,
        tell: &mut dyn FnMut(Event),
    ) -> Result<FoundCameras, SfmError> {
        let placed: Vec<SetView> = (self.views.iter().zip(&self.placements))
            .flat_map(|(views, placement)| views.iter().map(|view| view.placed(&placement.to_first)))
            .collect();
        let paths: Vec<String> = placed.iter().map(|view| format!("images/{}", view.name)).collect();
        let masks = placed.iter().map(|view| format!("masks/{}", view.name));
        workspace.announce(&paths.iter().cloned().chain(masks).collect::<Vec<_>>())?;
        for view in &placed {
            workspace.move_out(&format!("{PICTURES}/{}", view.name), &format!("images/{}", view.name))?;
            workspace.move_out(&format!("{MASKS}/{}", view.name), &format!("masks/{}", view.name))?;
        }
        let cloud = Mesh { vertices: self.points.in_first(&self.placements), ..Mesh::default() };
        write_mesh(workspace.at("points.ply"), &cloud)?;
        let cameras = paths.iter().map(String::as_str).zip(placed.iter().map(|view| &view.camera));
        write_transforms(&workspace.at("transforms.json"), cameras, Some("points.ply"))?;
        let sets = self.described();
        for note in notes_on(&sets) {
            tell(Event::Note(note.clone()));
            workspace.note(note);
        }
        let found = FoundCameras {
            key: key.to_owned(),
            engine: engine.to_owned(),
            placed: placed.len(),
            not_placed: Vec::new(),
            model_sizes: Vec::new(),
            points: cloud.vertices.len(),
            mean_error_px: self.points.mean_error_px,
            masks: placed.len(),
            sets,
            seconds: workspace.seconds().to_vec(),
            notes: workspace.notes().to_vec(),
        };
        workspace.finish(&found)?;
        Ok(found)
    }

    /// How the sets were placed.
    fn described(&self) -> Vec<PlacedSet> {
        (self.sets.iter().zip(&self.views).zip(&self.placements))
            .map(|((set, views), placement)| PlacedSet {
                name: set.name.clone(),
                pictures: views.len(),
                shared_points: placement.shared,
                agreeing_points: placement.agreeing,
                distance_share: placement.distance_share,
                to_first: placement.to_first,
            })
            .collect()
    }
}

/// What the user should know of how sets were placed.
fn notes_on(sets: &[PlacedSet]) -> Vec<String> {
    let first = sets.first().map_or("", |set| set.name.as_str());
    let of_set = |set: &PlacedSet| {
        format!(
            "`{}` is placed among `{first}` by {} of {} points of the object that both show, {:.2} % of its size apart",
            set.name,
            set.agreeing_points,
            set.shared_points,
            100.0 * set.distance_share
        )
    };
    sets.iter().skip(1).map(of_set).collect()
}

/// What a scene is made from, as a digest.
fn key_of(sets: &[PoseSet], options: &SfmOptions) -> String {
    let mut hash = Sha256::new();
    hash.update(VERSION.to_le_bytes());
    for set in sets {
        for text in [&set.name, &set.digest] {
            hash.update((text.len() as u64).to_le_bytes());
            hash.update(text.as_bytes());
        }
    }
    // What else can be chosen is of the cameras within a set.
    hash.update((options.features as u64).to_le_bytes());
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}
