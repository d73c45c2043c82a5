//! Errors of training, run folders and evaluation.

use std::path::PathBuf;

use dvr_core::Supervision;

/// Result of anything in this crate that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// What went wrong.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Somebody wanted the work to end, and there is nothing of it to keep.
    #[error("{0}")]
    Cancelled(#[from] dvr_core::Cancelled),
    /// A scene or a file could not be used.
    #[error(transparent)]
    Scene(#[from] dvr_core::Error),
    /// The grid method failed.
    #[error(transparent)]
    Grid(dvr_grid::Error),
    /// A GPU refused.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Device(#[from] dvr_gpu::DeviceError),

    /// A configuration value is out of range.
    #[error("configuration: {0}")]
    OutOfRange(#[from] dvr_core::number_range::OutOfRange),
    /// A configuration key does not exist.
    #[error("configuration: unknown key `{key}`; there are: {}", known.join(", "))]
    UnknownKey {
        /// The key, dotted.
        key: String,
        /// The keys that there are beside it.
        known: Vec<String>,
    },
    /// A configuration value has the wrong type.
    #[error("configuration: {problem}")]
    BadConfig {
        /// What the value is and what was expected.
        problem: String,
    },
    /// No method has this name.
    #[error("there is no method `{name}`; there are: {}", known.join(", "))]
    UnknownMethod {
        /// The name.
        name: String,
        /// The names that there are.
        known: Vec<&'static str>,
    },
    /// Occupancy supervision of a single scene.
    #[error("supervision occupancy is for datasets of many objects; a single scene takes rgb, depth or rgb+depth")]
    SceneOccupancy,
    /// A supervision that a method has no loss for.
    #[error(
        "method {method} learns from {}, not from {supervision}",
        known.iter().map(ToString::to_string).collect::<Vec<_>>().join(" or ")
    )]
    OtherSupervision {
        /// The method.
        method: &'static str,
        /// What was asked for.
        supervision: Supervision,
        /// What it can learn from.
        known: &'static [Supervision],
    },
    /// A system that makes nothing of a picture.
    #[error("the model sees no object in the picture")]
    NothingSeen,
    /// A whole shape where a field is wanted.
    #[error("method {method} makes whole shapes of pictures, and no field of which a mesh could be extracted anew")]
    NoField {
        /// The method.
        method: String,
    },
    /// Objects were to be taken for their own mirror images by a model that knows of no mirror.
    #[error(
        "the model learned without a mirror, so its objects cannot be taken for their own mirror images: leave --symmetry out"
    )]
    NoMirror,
    /// A threshold was given for a method whose shapes have no occupancies.
    #[error("method {method} makes no occupancies, so that no threshold moves its surface: leave --threshold out")]
    NoOccupancies {
        /// The method.
        method: String,
    },
    /// The method learns from many objects, and a single scene was given.
    #[error("method {method} learns from a dataset of objects, not from a single scene")]
    NeedsObjects {
        /// The method.
        method: String,
    },
    /// The method learns from a single scene, and many objects were given.
    #[error("method {method} learns from a single scene, not from a dataset of objects")]
    NeedsScene {
        /// The method.
        method: String,
    },
    /// The method cannot share its steps among devices.
    #[error("method {method} trains on one device; only networks share their steps")]
    OneDevice {
        /// The method.
        method: String,
    },
    /// Depth is to be learned, and nothing was measured.
    #[error("supervision {supervision} needs depth maps, and scene {scene:?} has none")]
    NeedsDepth {
        /// The supervision.
        supervision: Supervision,
        /// The scene.
        scene: String,
    },
    /// Sparse depth is to be learned, and there are no points.
    #[error("losses.sparse_depth needs sparse points, and scene {scene:?} has none")]
    NeedsSparsePoints {
        /// The scene.
        scene: String,
    },

    /// The model learned one scene and takes no pictures.
    #[error("the run reconstructed one scene, and takes no pictures")]
    OneScene,
    /// The model knows many objects by learned codes, and none was chosen.
    #[error("the run knows {objects} objects by their codes, counted from 0, and none was chosen")]
    ChooseObject {
        /// How many.
        objects: usize,
    },
    /// The model learned many objects and needs a picture to know which.
    #[error("the run learned many objects and needs a picture to know which")]
    NeedsPicture,
    /// The model has no learned codes of objects.
    #[error("the run has no learned codes of objects, of which one could be chosen")]
    NoCodes,
    /// The model knows fewer objects.
    #[error("there is no object {object}: the run knows {objects} objects, counted from 0")]
    NoSuchObject {
        /// The object that was asked for.
        object: usize,
        /// How many there are.
        objects: usize,
    },
    /// The model knows objects by learned codes, and takes no pictures.
    #[error("the run knows objects by learned codes and takes no pictures")]
    TakesNoPictures,
    /// The object was not trained on, and the model knows none but those.
    #[error("the model has a learned code for each training object and takes no pictures of others")]
    NotATrainingObject,
    /// A run of learned codes goes on with another dataset.
    #[error("a learned code per object: the run has codes of {before} objects, the dataset {now} training objects")]
    OtherObjects {
        /// Objects of the run.
        before: usize,
        /// Objects of the dataset.
        now: usize,
    },
    /// Too many objects in a row are broken.
    #[error("{}: {tries} objects in a row cannot be used; the last: {last}", dataset.display())]
    BrokenObjects {
        /// The dataset.
        dataset: PathBuf,
        /// How many were tried.
        tries: usize,
        /// What is wrong with the last of them.
        last: String,
    },
    /// A thread that draws batches is gone.
    #[error("a thread that draws batches ended too early")]
    LoaderEnded,
    /// A baseline finds nothing to compare with.
    #[error("{}: no training object has {what}", dataset.display())]
    NothingToCompare {
        /// The dataset.
        dataset: PathBuf,
        /// What the baseline needs of training objects.
        what: &'static str,
    },
    /// A category that no training object has.
    #[error("category {category} has no training object with occupancy points to take the mean of")]
    UnknownCategory {
        /// The category.
        category: String,
    },
    /// An encoder cannot start from a file.
    #[error("pretrained {}: {problem}", path.display())]
    Pretrained {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// The codes beside an imported decoder do not fit it.
    #[error(transparent)]
    Codes(#[from] CodesError),

    /// A run cannot go on without views that it began with.
    #[error("the run trained on or chose by views that are no longer in the scene: {}", views.join(", "))]
    ViewsGone {
        /// The views.
        views: Vec<String>,
    },
    /// A place of a known length does not show the object.
    #[error("known length `{text}`: its {which} pixel misses the {what}")]
    LengthMisses {
        /// The known length, as the user wrote it.
        text: String,
        /// `first` or `second`.
        which: &'static str,
        /// What is missed.
        what: &'static str,
    },
    /// A file is no checkpoint.
    #[error("{}: {problem}", path.display())]
    NotACheckpoint {
        /// The file.
        path: PathBuf,
        /// What was found.
        problem: String,
    },
    /// A checkpoint of another version.
    #[error("{}: checkpoint version {found}; this program reads version {expected}", path.display())]
    CheckpointVersion {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: u64,
        /// The version that is read.
        expected: u32,
    },
    /// Another file of a run, or a configuration, cannot be used.
    #[error("{}: {problem}", path.display())]
    BrokenFile {
        /// The file.
        path: PathBuf,
        /// What was found.
        problem: String,
    },
    /// A file of results holds another measurement.
    #[error("{}: it holds another measurement ({difference})", path.display())]
    OtherMeasurement {
        /// The file.
        path: PathBuf,
        /// Settings that differ, with their values in the file.
        difference: String,
    },
    /// What a checkpoint holds cannot be used.
    #[error("{what} of the checkpoint cannot be used: {problem}")]
    Damaged {
        /// Which part.
        what: &'static str,
        /// What is wrong.
        problem: String,
    },
    /// Stored parameters have other names or shapes than their configuration says.
    #[error("the checkpoint's parameters do not fit its own configuration: {problem}")]
    Misfit {
        /// What differs.
        problem: String,
    },
    /// A file does not hold the view-dependent colour of a run.
    #[error("{}: this is no view-dependent colour: {problem}; without the file, pictures of the run are of its field", path.display())]
    NotViewColor {
        /// The file.
        path: PathBuf,
        /// What was found.
        problem: String,
    },
    /// Something cannot be put in bytes.
    #[error("the state cannot be stored: {problem}")]
    NotStored {
        /// What is wrong.
        problem: String,
    },
    /// A network cannot be written for other programs.
    #[error("the network cannot be written: {problem}")]
    NotSaved {
        /// What is wrong.
        problem: String,
    },
    /// The model is no network that other programs know.
    #[error("the run holds no network")]
    NoNetwork,

    /// The loss is no longer a number.
    #[error("the loss became {value} in step {step}; the last checkpoint is kept")]
    Diverged {
        /// The step.
        step: usize,
        /// The loss.
        value: f64,
    },
    /// A step would take more of a GPU's memory than it may.
    #[error("a step takes about {} of GPU memory, and {} are allowed", megabytes(*bytes), megabytes(*allowed))]
    StepMemory {
        /// Bytes that it takes.
        bytes: u64,
        /// Bytes that it may.
        allowed: u64,
        /// Most rays of a step that fits; `None` where no number of rays does.
        rays: Option<usize>,
    },
    /// The work would take more of the machine's memory than there is, or than is allowed.
    #[error("about {} of memory are needed, and there are {}", megabytes(*bytes), megabytes(*allowed))]
    HostMemory {
        /// Bytes that it takes, besides photographs.
        bytes: u64,
        /// Bytes that it may.
        allowed: u64,
    },
    /// There is no memory for the texture that was asked for.
    #[error(transparent)]
    Texture(dvr_texture::TextureError),
    /// Tensors hold more of a GPU's memory than they may.
    #[error(
        "after step {step}, tensors hold about {} of GPU memory, and {} are allowed",
        megabytes(*bytes), megabytes(*allowed)
    )]
    HeldMemory {
        /// The step after which everything was saved.
        step: usize,
        /// Bytes that are held.
        bytes: u64,
        /// Bytes that may be.
        allowed: u64,
    },
    /// No mesh could be extracted.
    #[error("{0}")]
    NoMesh(String),
}

/// Why codes and an imported network do not fit together.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodesError {
    /// The file has an encoder.
    #[error("the file has an encoder, which makes the codes, and codes were given too")]
    HasEncoder,
    /// The decoder takes none.
    #[error("the decoder takes no codes, and codes were given")]
    NotTaken,
    /// There are none.
    #[error("the decoder takes codes of length {length}, and the file has no encoder that makes them")]
    Missing {
        /// Their length.
        length: usize,
    },
    /// There are none of any object.
    #[error("the file of codes has none")]
    Empty,
    /// They have another length.
    #[error("the codes have the length {found}, and the decoder takes codes of length {expected}")]
    Length {
        /// Their length.
        found: usize,
        /// The decoder's.
        expected: usize,
    },
}

impl From<dvr_grid::Error> for Error {
    fn from(error: dvr_grid::Error) -> Self {
        match error {
            dvr_grid::Error::Cancelled(cancelled) => Self::Cancelled(cancelled),
            dvr_grid::Error::OutOfRange(wrong) => Self::OutOfRange(wrong),
            dvr_grid::Error::Scene(error) => Self::Scene(error),
            dvr_grid::Error::Diverged { step, value } => Self::Diverged { step, value },
            #[cfg(feature = "gpu")]
            dvr_grid::Error::Device(problem) => Self::Device(problem),
            other => Self::Grid(other),
        }
    }
}

/// Bytes for people; of few megabytes, hundredths tell what is allowed from what is not.
fn megabytes(bytes: u64) -> String {
    if (1..10_000_000).contains(&bytes) {
        format!("{:.2} MB", bytes.div_ceil(10_000) as f64 / 100.0)
    } else {
        format!("{} MB", bytes.div_ceil(1_000_000))
    }
}
