//! Remedies: what a user of the command line can do about an error of a library.
//!
//! Libraries say what was found and what was expected, in their own terms. Sentences that name flags, commands or
//! environment variables live here alone. One function per error type; variants that hold another library's error pass
//! it on. A new remedy is one arm and, in `tests/suite/bad_input.rs`, one assertion.

use dvr_core::OutputError;
use dvr_core::files::FolderKind;
use dvr_core::number_range::OutOfRange;
use dvr_report::Diagnostic;
use dvr_segmentation::{ProgramMaskError, SegmentationError};
use dvr_sfm::SfmError;
use dvr_texture::TextureError;
use dvr_train::{CodesError, Error as TrainError};

/// The remedy for the first cause in the chain that has one: one or two sentences with their full stops.
pub fn remedy(error: &anyhow::Error) -> Option<String> {
    error.chain().find_map(|cause| {
        None.or_else(|| cause.downcast_ref().and_then(of_core))
            .or_else(|| cause.downcast_ref().and_then(of_grid))
            .or_else(|| cause.downcast_ref().and_then(of_train))
            .or_else(|| cause.downcast_ref().and_then(of_texture))
            .or_else(|| cause.downcast_ref().and_then(of_extraction))
            .or_else(|| cause.downcast_ref().and_then(of_record))
            .or_else(|| cause.downcast_ref().and_then(of_report))
            .or_else(|| cause.downcast_ref().and_then(of_sfm))
            .or_else(|| cause.downcast_ref().and_then(of_segmentation))
            .or_else(|| cause.downcast_ref().and_then(of_mask_program))
            .or_else(|| of_gpu(cause))
            .or_else(|| cause.downcast_ref().and_then(of_system))
    })
}

/// Masks from all views.
fn of_segmentation(error: &SegmentationError) -> Option<String> {
    match error {
        SegmentationError::Cancelled(_) => None,
        SegmentationError::TooFewViews { .. } | SegmentationError::NothingFound => Some(
            "Put masks into the folder `masks` beside the pictures, or give their folder with --masks DIR; with a plain \
             background, --background white, black or border makes them."
                .into(),
        ),
    }
}

/// Masks by a program of the user's choice.
fn of_mask_program(error: &ProgramMaskError) -> Option<String> {
    match error {
        ProgramMaskError::Cancelled(_) => None,
        ProgramMaskError::Core(error) => of_core(error),
        ProgramMaskError::Program { view, .. } => Some(format!(
            "Try the command of --segment on one picture, with its path for {{in}} and that of a new PNG for {{out}}. --ignore \
             {view} leaves this photograph out; without --segment, masks are found from all views."
        )),
    }
}

/// Reading, checking and writing scenes.
fn of_core(error: &dvr_core::Error) -> Option<String> {
    use dvr_core::Error;
    match error {
        Error::MasksMissing { .. } => Some(
            "Where no view has a mask, `dvr train` finds them from all views; some have one here. `--masks DIR` takes those of a \
             folder. With a plain background, --background white, black or border takes what differs from it as the object. Masks \
             of pictures whose cameras were found go into the folder `masks` beside their `images`."
                .into(),
        ),
        Error::TooFewViews { .. } => Some("Allow more with --views, and leave out fewer with --ignore.".into()),
        Error::NoPlace { .. } => Some("--normalise auto or hull finds the object by the masks.".into()),
        Error::Normalisation(_) | Error::MasksEmpty { .. } => Some(
            "--ignore VIEW leaves views out; --box tells where the object is; --normalise files takes the place that the files \
             give, where they give one."
                .into(),
        ),
        Error::PhotographMemory { .. } => Some(
            "--memory 2G, say, keeps only as much of them in memory and pages the others; --downscale makes them smaller.".into(),
        ),
        Error::UnknownCategory { .. } => Some("Name categories with --categories.".into()),
        Error::Output(error) => Some(of_output(error).into()),
        Error::Scratch { .. } => {
            Some("Set TMPDIR to a folder on a disk with room for them, or allow more with --memory.".into())
        }
        _ => None,
    }
}

/// Places that results may not be written to.
fn of_output(error: &OutputError) -> &'static str {
    match error {
        OutputError::InUse { kind: FolderKind::Run, .. } => {
            "`dvr train --resume` continues the run, --overwrite replaces it; or choose another folder with --out."
        }
        OutputError::InUse { .. } => "Replace them with --overwrite, or choose another folder with --out.",
        OutputError::NotOurs { .. } | OutputError::OtherKind { .. } => {
            "Give a new or an empty folder with --out. Files that dvr did not write are never replaced."
        }
        OutputError::Missing { .. } => "Give the folder of a run with --out, or start the run without --resume.",
        OutputError::Locked { .. } => "Wait until it is done, or choose another folder with --out.",
        OutputError::FileThere { .. } => {
            "Move it away, or give another place with --out. --overwrite replaces a file that was named as an output."
        }
        OutputError::AmongData { .. } => "Give a folder beside the data with --out.",
    }
}

/// The operating system, of a disk that takes no more.
fn of_system(error: &std::io::Error) -> Option<String> {
    use std::io::ErrorKind;
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => Some(
            "Make room on that disk, or write to another with --out; `dvr train --resume` goes on from a run's last checkpoint."
                .into(),
        ),
        ErrorKind::ReadOnlyFilesystem => Some("Nothing can be written there: choose another folder with --out.".into()),
        _ => None,
    }
}

/// Textures.
fn of_texture(error: &TextureError) -> Option<String> {
    match error {
        TextureError::NoFaces => Some("A point cloud has none: make a mesh of it first.".into()),
        TextureError::InsideOut => Some("Turn its faces around, as Blender's Recalculate Outside does.".into()),
        TextureError::Hidden { .. } => Some(
            "The mesh must be in the coordinates of the scene's files, and not inside out: its faces wind counter-clockwise \
             seen from outside."
                .into(),
        ),
        TextureError::TooManyCharts { .. } => Some("Choose a larger --size, or simplify the mesh with --faces 50k.".into()),
        TextureError::Memory { .. } => Some(
            "A smaller --texture N (--size N of `dvr texture`) takes less, --texture off nothing; or allow more with --memory."
                .into(),
        ),
        _ => None,
    }
}

/// The grid method.
fn of_grid(error: &dvr_grid::Error) -> Option<String> {
    use dvr_grid::Error;
    match error {
        Error::Scene(error) => of_core(error),
        Error::OutOfRange(wrong) => Some(another_value(wrong)),
        Error::NoHull => Some("Look at masks and cameras with `dvr info SCENE`.".into()),
        Error::Diverged { .. } => Some(DIVERGED.into()),
        #[cfg(feature = "gpu")]
        Error::Device(error) => of_device(error),
        _ => None,
    }
}

/// A configuration value that is out of range. Of a list, the whole is given.
fn another_value(wrong: &OutOfRange) -> String {
    let key = wrong.key.split("[]").next().unwrap_or_default();
    format!("Give another value with --set {key}=VALUE.")
}

/// For any method whose loss is no longer a number.
const DIVERGED: &str = "Train anew with a smaller --set learning_rate=VALUE, and --overwrite or another --out.";

/// Training, run folders and evaluation.
fn of_train(error: &TrainError) -> Option<String> {
    let text = match error {
        TrainError::Scene(error) => return of_core(error),
        TrainError::Grid(error) => return of_grid(error),
        #[cfg(feature = "gpu")]
        TrainError::Device(error) => return of_device(error),
        TrainError::Codes(error) => return of_codes(error),
        TrainError::Texture(error) => return of_texture(error),
        TrainError::StepMemory { rays, .. } => return Some(less_memory(*rays)),
        TrainError::HostMemory { .. } => {
            "--capacity N (grid), --resolution N, --size N, --set rays=N, --downscale N or --views N take less; or allow more with --memory."
        }
        TrainError::OutOfRange(wrong) => return Some(another_value(wrong)),
        TrainError::UnknownKey { .. } | TrainError::BadConfig { .. } => {
            "`dvr train --print-config` prints all keys with their values."
        }
        TrainError::SceneOccupancy => "Use --supervision rgb, depth or rgb+depth.",
        TrainError::NeedsObjects { .. } => "Use --method grid, network, classic or hull.",
        TrainError::NeedsScene { .. } => {
            "Use --method objects or objects-classic; --method network and others take one scene."
        }
        TrainError::OneDevice { .. } => "Give one device to --devices, or use --method network or classic.",
        TrainError::NeedsDepth { .. } => "Use --supervision rgb.",
        TrainError::NeedsSparsePoints { .. } => "Use --set losses.sparse_depth=0.",
        TrainError::ChooseObject { .. } | TrainError::NoSuchObject { .. } => "--object N chooses an object.",
        TrainError::NoCodes => "Leave --object out.",
        TrainError::NeedsPicture => "Use `dvr predict RUN IMAGE --out DIR`.",
        TrainError::OneScene => "Use `dvr mesh RUN`.",
        TrainError::TakesNoPictures => "`dvr mesh RUN --object N` extracts the mesh of an object.",
        TrainError::NotATrainingObject => "Evaluate it with --split train.",
        TrainError::BrokenObjects { .. } => "`dvr info` checks an object of a dataset like a scene.",
        TrainError::NothingToCompare { .. } => "`dvr synth` renders datasets with all that baselines need.",
        TrainError::UnknownCategory { .. } => "Name other categories with --categories.",
        TrainError::NotACheckpoint { .. } => {
            "Give the folder of a run that `dvr train` wrote, or one of its checkpoints."
        }
        TrainError::OtherMeasurement { .. } => "Write to another folder with --out, or delete the file.",
        TrainError::CheckpointVersion { .. } => "Train again with this version of dvr.",
        TrainError::NoNetwork => "`dvr train --method network` makes a run with a network.",
        TrainError::Diverged { .. } => DIVERGED,
        TrainError::ViewsGone { .. } => "Put them back, or start anew: leave out --resume, and choose another --out.",
        TrainError::LengthMisses { .. } => {
            "Give pixels well within the object with --scale, of the picture's file as it is stored, from (0,0) at the top left."
        }
        TrainError::HeldMemory { .. } => {
            "Everything is saved. `dvr train --resume` continues with a larger --memory, or with --backend cpu."
        }
        _ => return None,
    };
    Some(text.into())
}

/// Codes beside an imported decoder.
fn of_codes(error: &CodesError) -> Option<String> {
    match error {
        CodesError::HasEncoder | CodesError::NotTaken => Some("Leave --codes out.".into()),
        CodesError::Missing { .. } | CodesError::Empty | CodesError::Length { .. } => {
            Some("Give the codes with --codes FILE.npz.".into())
        }
    }
}

/// A step that takes too much GPU memory; `rays` is the most rays of a step that fits.
fn less_memory(rays: Option<usize>) -> String {
    match rays {
        Some(rays) => format!(
            "--set rays={rays} fits; networks of one scene also need --set hull.warm_start_points={rays} or less. Or allow \
             more with --memory."
        ),
        None => {
            "No number of rays fits. Allow more with --memory, take a smaller network with --set model.hidden=N, or \
                 use --backend cpu."
                .into()
        }
    }
}

/// Extraction of a mesh.
fn of_extraction(_: &dvr_render::extract::ExtractError) -> Option<String> {
    None
}

/// Files of networks.
fn of_record(error: &dvr_model::RecordError) -> Option<String> {
    use dvr_model::RecordError;
    match error {
        RecordError::File(error) => of_core(error),
        _ => None,
    }
}

/// Reports.
fn of_report(error: &dvr_report::Error) -> Option<String> {
    use dvr_report::Error;
    match error {
        Error::Run(error) => of_train(error),
        Error::Core(error) => of_core(error),
        Error::NotFinished { .. } => {
            Some("Give the folder of a finished run. `dvr train --resume --out RUN` finishes one.".into())
        }
        Error::Damaged { .. } => Some("Make the run again, or its evaluation.".into()),
        Error::Curves { .. } => Some("Move the file away to report without curves.".into()),
        Error::Picture(_) => None,
    }
}

/// Finding cameras.
fn of_sfm(error: &SfmError) -> Option<String> {
    match error {
        SfmError::Core(error) => of_core(error),
        SfmError::NoNormals { .. } => Some(
            "COLMAP's stereo_fusion and PMVS write normals; MeshLab (Filters, Normals) and CloudCompare compute and orient them              for any cloud."
                .into(),
        ),
        SfmError::NoSurface { trim, .. } if *trim > 0.0 => Some("Trim less with --trim, or not at all with --trim 0.".into()),
        SfmError::NotInstalled { program: "colmap", .. } => Some(
            "Install it: `apt install colmap` (Debian, Ubuntu), `brew install colmap` (macOS), or `conda install -c \
             conda-forge colmap`. Photographs that have cameras need none."
                .into(),
        ),
        SfmError::NotInstalled { program: "glomap", .. } => Some(
            "Install COLMAP 4 or later, or GLOMAP (github.com/colmap/glomap, `conda install -c conda-forge glomap`); or leave out `--mapper global`."
                .into(),
        ),
        SfmError::NotInstalled { .. } => {
            Some("Install it: `apt install ffmpeg`, `brew install ffmpeg`, or `conda install -c conda-forge ffmpeg`.".into())
        }
        SfmError::NoEncoder { .. } => Some(
            "Install one that has it, as `apt install ffmpeg`, `brew install ffmpeg` and `conda install -c conda-forge ffmpeg` do; or take another --animation."
                .into(),
        ),
        SfmError::OtherFormat { kind: "HEIC", .. } => Some(
            "Convert them to JPEG: `for f in *.HEIC; do heif-convert -q 98 \"$f\" \"${f%.*}.jpg\"; done` (apt install \
             libheif-examples), or on a Mac `sips -s format jpeg *.HEIC --out .`. On the phone: Settings, Camera, Formats, \
             Most Compatible."
                .into(),
        ),
        SfmError::OtherFormat { .. } => Some("Develop them to JPEG, PNG or TIFF, all with the same settings.".into()),
        SfmError::OtherPhotographs { .. } => {
            Some("Replace them with --overwrite, or choose another folder (`dvr cameras --out`, `dvr train --cameras`).".into())
        }
        SfmError::NotConnected { .. } => Some(
            "Photograph the sides of the object in both poses, also from low down, in the same light; an object without texture \
             needs something on it. Look at the masks of each set (`dvr masks`, or the folder `masks` of a scene): features are \
             looked for within them alone."
                .into(),
        ),
        SfmError::NoModel { .. } => Some(
            "Try --matching exhaustive and --share-cameras picture; a plain object needs a textured table or background \
             that moves with it."
                .into(),
        ),
        _ => None,
    }
}

/// What to do about a diagnostic of a report.
pub fn remedy_of_diagnostic(diagnostic: &Diagnostic) -> Option<String> {
    match diagnostic {
        Diagnostic::NoMesh => Some("`dvr info SCENE` checks both.".into()),
        Diagnostic::SceneMissing => Some("`dvr report RUN --data SCENE` gives its new place.".into()),
        Diagnostic::MeshBehindField { .. } => Some("Try `dvr mesh RUN --resolution 512`.".into()),
        Diagnostic::MaskDisagrees { view, .. } => Some(format!("Leave it out with --ignore {view}.")),
        _ => None,
    }
}

/// Opening a GPU and computing on it.
#[cfg(feature = "gpu")]
fn of_gpu(error: &(dyn std::error::Error + 'static)) -> Option<String> {
    use dvr_gpu::GpuError;
    if let Some(error) = error.downcast_ref() {
        return of_device(error);
    }
    Some(match error.downcast_ref()? {
        GpuError::NoAdapter | GpuError::Refused { .. } => "Use --backend cpu.".into(),
        GpuError::NoSuchAdapter { .. } => "`dvr devices` lists the GPUs. Or use --backend cpu.".into(),
        #[cfg(feature = "cuda")]
        GpuError::NoCuda { .. } => "Use --backend gpu or --backend cpu.".into(),
    })
}

/// Without the feature, no error comes from a GPU.
#[cfg(not(feature = "gpu"))]
fn of_gpu(_: &(dyn std::error::Error + 'static)) -> Option<String> {
    None
}

/// A GPU that is open and refuses.
#[cfg(feature = "gpu")]
fn of_device(error: &dvr_gpu::DeviceError) -> Option<String> {
    use dvr_gpu::DeviceError;
    Some(match error {
        DeviceError::OverLimit { .. } => {
            "Allow more with --memory. --downscale and a lower --capacity take less.".into()
        }
        DeviceError::TooLarge { .. } => {
            "--downscale and a lower --capacity take less. --backend cpu has no such limit.".into()
        }
        DeviceError::NoGpu | DeviceError::TooFewBindings { .. } | DeviceError::Device(_) => "Use --backend cpu.".into(),
    })
}

#[cfg(test)]
mod tests {
    use anyhow::Context;

    use super::*;

    #[test]
    fn a_remedy_is_found_below_context_and_through_transparent_variants() {
        let error = TrainError::Grid(dvr_grid::Error::NoHull);
        let error = Err::<(), _>(dvr_report::Error::Run(error)).context("the report").unwrap_err();
        assert!(remedy(&error).is_some_and(|text| text.contains("dvr info")));
        assert_eq!(remedy(&anyhow::anyhow!("an error of the command line itself")), None);
    }
}
