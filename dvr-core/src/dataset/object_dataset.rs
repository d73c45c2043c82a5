//! Datasets of many objects, of which single views are read when they are needed.
//!
//! Opening lists the objects. Which files an object has, and its cameras, is found out when it is first asked for, and
//! kept: about 100 bytes per view, so that the 44 000 objects of ShapeNet with 24 views each take about 100 MB in the
//! end. Pixels are never kept.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::input_picture::{InputPicture, input_camera, input_mask, input_picture};
use super::layouts::dvr::{find_views, read_ground_truth, read_occupancy};
use super::load::load_view;
use super::object_files::IMAGE_FOLDERS;
use super::objects::{ObjectRef, list_objects};
use super::options::ReadOptions;
use super::pairing::{list_files, pictures, stem, sub_folder};
use super::raw_scene::{Projection, RawView};
use crate::error::{Error, Result};
use crate::files::{read_mask, read_photo};
use crate::points::OccupancySamples;
use crate::record::Digest;
use crate::scene::{GroundTruth, Split, View};

/// Folders of pictures that are made for encoders, looked for before those that are trained on: the 3D-R2N2 renders, as the DVR
/// dataset and as 3D-R2N2 itself call them.
const INPUT_FOLDERS: [&str; 2] = ["img_choy2016", "rendering"];

/// How a dataset of objects is read; the default reads all of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ObjectOptions {
    /// The categories to keep, by folder or by their name in `metadata.yaml`; empty keeps all.
    pub categories: Vec<String>,
    /// Another dataset that has the pictures for the encoder, under the same names of category and object; `None` where
    /// they lie with the objects.
    pub inputs: Option<PathBuf>,
    /// Give the views to the encoder, whose cameras are known, even where objects have other pictures for it.
    pub inputs_are_views: bool,
    /// Take depth from `visual_hull_depth/`, even where there is a `depth/`.
    pub visual_hull_depth: bool,
}

/// A dataset of many objects in the DVR layout.
///
/// ```no_run
/// use dvr_core::Split;
/// use dvr_core::dataset::{ObjectDataset, ObjectOptions};
///
/// let dataset = ObjectDataset::open("ShapeNet".as_ref(), ObjectOptions::default())?;
/// for object in dataset.of_split(Split::Val) {
///     let picture = dataset.read_input(object, 0, 224)?; // what an encoder sees
///     let view = dataset.read_view(object, 12)?; // to train on or to compare with
///     println!("{}: {} and {}", dataset.objects()[object].name, picture.image.width(), view.name);
/// }
/// # Ok::<(), dvr_core::Error>(())
/// ```
pub struct ObjectDataset {
    root: PathBuf,
    options: ObjectOptions,
    objects: Vec<ObjectRef>,
    files: Vec<OnceLock<ObjectFiles>>,
    /// Most objects name their files alike: each way of naming is kept once.
    names: Mutex<HashSet<Arc<FileNames>>>,
}

/// What must be known of an object to read any of its views.
struct ObjectFiles {
    names: Arc<FileNames>,
    /// One per view.
    projections: Box<[Projection]>,
}

/// The files of an object; paths start at its folder.
#[derive(PartialEq, Eq, Hash)]
struct FileNames {
    views: Vec<ViewNames>,
    cameras: Box<Path>,
    /// Pictures for the encoder that are no views.
    inputs: Option<Vec<Box<Path>>>,
}

#[derive(PartialEq, Eq, Hash)]
struct ViewNames {
    image: Box<Path>,
    mask: Option<Box<Path>>,
    depth: Option<Box<Path>>,
}

impl ObjectDataset {
    /// Lists the objects of the dataset, or of the single category, in the folder `root`.
    ///
    /// # Errors
    /// As [`list_objects`]; [`Error::NoObjects`] where there is no object, [`Error::UnknownCategory`] where a category to keep does
    /// not exist.
    pub fn open(root: &Path, options: ObjectOptions) -> Result<Self> {
        let mut objects = list_objects(root, None)?;
        if objects.is_empty() {
            return Err(Error::NoObjects { path: root.to_owned() });
        }
        keep_categories(&mut objects, &options.categories)?;
        let files = objects.iter().map(|_| OnceLock::new()).collect();
        Ok(Self { root: root.to_owned(), options, objects, files, names: Mutex::default() })
    }

    /// The folder of the dataset.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// All objects. One that is in two lists is there twice.
    pub fn objects(&self) -> &[ObjectRef] {
        &self.objects
    }

    /// Indices of the objects of one split, in order.
    pub fn of_split(&self, split: Split) -> Vec<usize> {
        (0..self.objects.len()).filter(|&object| self.objects[object].split == split).collect()
    }

    /// How many posed views an object has.
    ///
    /// # Errors
    /// Where the object lacks its pictures or cameras, or these are damaged.
    pub fn views(&self, object: usize) -> Result<usize> {
        Ok(self.files(object)?.projections.len())
    }

    /// How many pictures for the encoder an object has.
    ///
    /// # Errors
    /// As [`ObjectDataset::views`].
    pub fn inputs(&self, object: usize) -> Result<usize> {
        let files = self.files(object)?;
        Ok(files.names.inputs.as_ref().map_or(files.names.views.len(), Vec::len))
    }

    /// Reads one view, in object space.
    ///
    /// # Errors
    /// Where one of its files is missing or damaged, sizes differ, the camera is unusable, or there is no mask.
    pub fn read_view(&self, object: usize, view: usize) -> Result<View> {
        let files = self.files(object)?;
        let names = &files.names.views[view];
        let root = &self.objects[object].path;
        let full = |path: &Path| root.join(path);
        let projection = files.projections[view];
        let found = RawView {
            name: stem(&names.image),
            image: full(&names.image),
            mask: names.mask.as_deref().map(full),
            depth: names.depth.as_deref().map(full),
            projection,
            lens: None,
            split: Split::Train,
        };
        let cameras = full(&files.names.cameras);
        let view = load_view(&found, projection.mirrors(DVec3::ZERO), &cameras, &ReadOptions::default())?;
        if view.mask.is_none() {
            return Err(Error::MasksMissing { views: vec![found.image.display().to_string()] });
        }
        Ok(view)
    }

    /// Reads a picture for the encoder: the object on white, square, `size` pixels wide. Its camera is known where it is one of
    /// the views, and no mirror image.
    ///
    /// # Errors
    /// Where the file, or its mask, is missing or damaged.
    pub fn read_input(&self, object: usize, input: usize, size: u32) -> Result<InputPicture> {
        let files = self.files(object)?;
        let (path, mask, projection) = match &files.names.inputs {
            Some(inputs) => (self.input_root(object).join(&inputs[input]), None, None),
            None => {
                let names = &files.names.views[input];
                let root = &self.objects[object].path;
                let projection = Some(files.projections[input]).filter(|projection| !projection.mirrors(DVec3::ZERO));
                (root.join(&names.image), names.mask.as_ref().map(|mask| root.join(mask)), projection)
            }
        };
        let photo = read_photo(&path)?;
        let mask = mask.filter(|_| photo.alpha.is_none()).map(|mask| read_mask(&mask)).transpose()?;
        let (width, height) = photo.image.dimensions();
        let camera = projection.and_then(|projection| projection.camera(width, height).ok());
        Ok(InputPicture {
            image: input_picture(&photo, mask.as_ref(), size),
            camera: camera.map(|camera| input_camera(&camera, size)),
            mask: input_mask(&photo, mask.as_ref(), size),
        })
    }

    /// Reads the true shape, as far as the object has it.
    ///
    /// # Errors
    /// Where a file is damaged.
    pub fn read_ground_truth(&self, object: usize) -> Result<GroundTruth> {
        read_ground_truth(&self.objects[object].path)
    }

    /// Reads the points of the cube whose occupancy is known; `None` where the object has no `points.npz`.
    ///
    /// # Errors
    /// Where the file is damaged.
    pub fn read_occupancy(&self, object: usize) -> Result<Option<OccupancySamples>> {
        read_occupancy(&self.objects[object].path)
    }

    /// The digest of an object: of the files in its folder, and of its pictures for the encoder.
    ///
    /// # Errors
    /// Where a file cannot be read.
    pub fn digest(&self, object: usize) -> Result<Digest> {
        let (own, inputs) = (&self.objects[object].path, self.input_root(object));
        let digest = Digest::of_files(own, None)?;
        if inputs == *own {
            return Ok(digest);
        }
        Ok(Digest::of_all([&digest, &Digest::of_files(&inputs, None)?]))
    }

    /// The folder that holds an object's pictures for the encoder.
    fn input_root(&self, object: usize) -> PathBuf {
        let object = &self.objects[object];
        match &self.options.inputs {
            Some(root) => root.join(&object.category).join(&object.name),
            None => object.path.clone(),
        }
    }

    fn files(&self, object: usize) -> Result<&ObjectFiles> {
        if let Some(files) = self.files[object].get() {
            return Ok(files);
        }
        let found = self.find_files(object)?;
        Ok(self.files[object].get_or_init(|| found))
    }

    fn find_files(&self, object: usize) -> Result<ObjectFiles> {
        let root = &self.objects[object].path;
        let found = find_views(root, self.options.visual_hull_depth)?;
        let inside = |path: &Path, root: &Path| Box::<Path>::from(path.strip_prefix(root).unwrap_or(path));
        let names_of = |view: &RawView| ViewNames {
            image: inside(&view.image, root),
            mask: view.mask.as_ref().map(|path| inside(path, root)),
            depth: view.depth.as_ref().map(|path| inside(path, root)),
        };
        let input_root = self.input_root(object);
        let own_folders: &[&str] = if self.options.inputs.is_some() { &IMAGE_FOLDERS } else { &[] };
        let input_folder = sub_folder(&input_root, &INPUT_FOLDERS).or_else(|| sub_folder(&input_root, own_folders));
        let input_folder = input_folder.filter(|_| !self.options.inputs_are_views || self.options.inputs.is_some());
        let inputs = match input_folder {
            None if self.options.inputs.is_some() => {
                return Err(Error::format(
                    &input_root,
                    "there is no folder of pictures for the encoder",
                    format!("Looked for {} and {}.", INPUT_FOLDERS.join(", "), IMAGE_FOLDERS.join(", ")),
                ));
            }
            None => None,
            Some(folder) => {
                let files = list_files(&folder, pictures())?;
                if files.is_empty() {
                    return Err(Error::format(&folder, "there are no pictures", "Put PNG or JPEG files there."));
                }
                Some(files.iter().map(|path| inside(path, &input_root)).collect())
            }
        };
        let names = FileNames {
            views: found.views.iter().map(names_of).collect(),
            cameras: inside(&found.cameras, root),
            inputs,
        };
        Ok(ObjectFiles {
            names: self.interned(names),
            projections: found.views.iter().map(|view| view.projection).collect(),
        })
    }

    fn interned(&self, names: FileNames) -> Arc<FileNames> {
        let mut known = self.names.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(same) = known.get(&names) {
            return same.clone();
        }
        let names = Arc::new(names);
        known.insert(names.clone());
        names
    }
}

/// Drops the objects of other categories.
fn keep_categories(objects: &mut Vec<ObjectRef>, categories: &[String]) -> Result<()> {
    if categories.is_empty() {
        return Ok(());
    }
    let is = |object: &ObjectRef, category: &String| object.category == *category || object.category_name == *category;
    if let Some(unknown) = categories.iter().find(|category| !objects.iter().any(|object| is(object, category))) {
        let mut known: Vec<String> = objects.iter().map(|object| object.category_name.clone()).collect();
        known.sort_unstable();
        known.dedup();
        return Err(Error::UnknownCategory { name: unknown.clone(), known });
    }
    objects.retain(|object| categories.iter().any(|category| is(object, category)));
    Ok(())
}
