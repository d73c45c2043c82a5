//! `transforms.json` of NeRF, instant-ngp and nerfstudio.
//!
//! `transform_matrix` takes camera space to the world, with a camera that looks along -z with y up (OpenGL); it becomes
//! a camera of ours here and nowhere else. Pixel centres are at half integers. Intrinsics stand at the top or in each
//! frame. Documentation: <https://docs.nerf.studio/quickstart/data_conventions.html>.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize;

use super::layout::Layout;
use crate::camera::Similarity;
use crate::dataset::masks::find_masks;
use crate::dataset::options::ReadOptions;
use crate::dataset::pairing::{folder_of, partners, pictures, sub_folder, view_names};
use crate::dataset::raw_scene::{ObjectBounds, Projection, RawScene, RawView, is_rotation};
use crate::error::{Error, Result};
use crate::files::{image_size, read_bytes};
use crate::lens::Lens as CameraLens;
use crate::mesh::{TexturedMesh, read_mesh};
use crate::points::PointCloud;
use crate::scene::{GroundTruth, SparsePoints, Split};

/// NeRF's and nerfstudio's `transforms.json`, or `transforms_{train,val,test}.json`.
pub(super) const LAYOUT: Layout = Layout {
    name: "transforms",
    aliases: &["nerf", "blender", "nerfstudio", "instant-ngp"],
    known_by: "transforms.json or transforms_train.json (NeRF, nerfstudio)",
    is_at: |path| Ok(!files(path).is_empty()),
    find,
};

/// The files of a dataset with splits.
const SPLITS: [(&str, Split); 3] = [
    ("transforms_train.json", Split::Train),
    ("transforms_val.json", Split::Val),
    ("transforms_test.json", Split::Test),
];

#[derive(Deserialize)]
struct Transforms {
    #[serde(flatten)]
    lens: Lens,
    frames: Vec<Frame>,
    val_filenames: Option<HashSet<String>>,
    test_filenames: Option<HashSet<String>>,
    /// nerfstudio: a cloud of sparse points in the world of the cameras.
    ply_file_path: Option<String>,
}

#[derive(Deserialize)]
struct Frame {
    file_path: String,
    transform_matrix: Vec<Vec<f64>>,
    mask_path: Option<String>,
    #[serde(flatten)]
    lens: Lens,
}

/// Intrinsics, as far as they are given in one place.
#[derive(Clone, Default, Deserialize)]
struct Lens {
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

/// The transforms files at `path`, with the split of their frames: the file itself, or those of the folder.
fn files(path: &Path) -> Vec<(PathBuf, Split)> {
    if path.is_file() {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let split = SPLITS.iter().find(|(split_name, _)| *split_name == name).map_or(Split::Train, |(_, split)| *split);
        return if name.ends_with(".json") { vec![(path.to_owned(), split)] } else { Vec::new() };
    }
    let existing = |(name, split): &(&str, Split)| Some((path.join(name), *split)).filter(|(file, _)| file.is_file());
    let splits: Vec<_> = SPLITS.iter().filter_map(existing).collect();
    if splits.is_empty() { existing(&("transforms.json", Split::Train)).into_iter().collect() } else { splits }
}

/// Finds the views that the file, or the files of the folder, list.
fn find(path: &Path, _: &ReadOptions) -> Result<RawScene> {
    let files = files(path);
    let Some((cameras, _)) = files.first().cloned() else {
        return Err(Error::format(path, "there is no transforms.json", "Give the folder or the file itself."));
    };
    let root = folder_of(&cameras);
    let mut warnings = Vec::new();
    let (mut listed, mut sparse_points) = (Vec::new(), None);
    for (file, split) in &files {
        let cloud = find_frames(file, *split, &root, &mut listed, &mut warnings)?;
        sparse_points = sparse_points.or(cloud);
    }
    if listed.is_empty() {
        return Err(Error::format(&cameras, "there are no frames", "List at least two pictures in `frames`."));
    }
    let relative: Vec<PathBuf> =
        listed.iter().map(|view| view.image.strip_prefix(&root).unwrap_or(&view.image).to_owned()).collect();
    let names = view_names(&relative, &cameras)?;
    let masks = masks_of(&root, &relative)?;
    for ((view, name), mask) in listed.iter_mut().zip(names).zip(masks) {
        view.name = name;
        view.mask = view.mask.take().or(mask);
    }
    Ok(RawScene {
        format: "NeRF transforms",
        root,
        cameras,
        views: listed,
        files_to_world: Similarity::default(),
        object_bounds: ObjectBounds::Unknown,
        sparse_points,
        ground_truth: GroundTruth::default(),
        warnings,
    })
}

/// Appends the views of one file, their names still to be made; gives the sparse points that it names.
fn find_frames(
    file: &Path,
    split: Split,
    root: &Path,
    views: &mut Vec<RawView>,
    warnings: &mut Vec<String>,
) -> Result<Option<SparsePoints>> {
    let transforms: Transforms = serde_json::from_slice(&read_bytes(file)?).map_err(|error| {
        Error::format(file, format!("not the JSON of a scene ({error})"), "Export the cameras again.")
    })?;
    let mut missing = Vec::new();
    for frame in &transforms.frames {
        match image_file(root, &frame.file_path) {
            Some(image) => views.push(view_of_frame(file, root, &transforms, frame, image, split)?),
            None => missing.push(&frame.file_path),
        }
    }
    if missing.len() == transforms.frames.len()
        && let Some(first) = missing.first()
    {
        return Err(Error::format(
            file,
            format!("none of the {} pictures exists, first `{first}`", missing.len()),
            "Put the pictures where `file_path` says, relative to this file.",
        ));
    }
    if let Some(first) = missing.first() {
        warnings.push(format!(
            "{} of {} pictures of {} are missing and left out, first `{first}`",
            missing.len(),
            transforms.frames.len(),
            file.display()
        ));
    }
    Ok(transforms.ply_file_path.as_ref().and_then(|cloud| sparse_points(&root.join(cloud), warnings)))
}

/// The points of a PLY file, of which nobody says which views see them. Where they cannot be read, a warning says so: a
/// scene is whole without them.
fn sparse_points(path: &Path, warnings: &mut Vec<String>) -> Option<SparsePoints> {
    match read_mesh(path) {
        Ok(TexturedMesh { mesh, .. }) if !mesh.vertices.is_empty() => Some(SparsePoints {
            visible_in: vec![Vec::new(); mesh.vertices.len()],
            cloud: PointCloud { points: mesh.vertices, normals: None, colors: mesh.colors },
            ..SparsePoints::default()
        }),
        Ok(_) => None,
        Err(error) => {
            warnings.push(format!("sparse points are left out: {error}"));
            None
        }
    }
}

/// The view of a frame whose picture is `image`; `split` is that of the file.
fn view_of_frame(
    file: &Path,
    root: &Path,
    transforms: &Transforms,
    frame: &Frame,
    image: PathBuf,
    split: Split,
) -> Result<RawView> {
    let wrong =
        |problem: String, remedy: &str| Error::format(file, format!("frame `{}`: {problem}", frame.file_path), remedy);
    let lens = frame.lens.or(&transforms.lens);
    let size = match lens.size() {
        Some(size) => size,
        None => image_size(&image)?,
    };
    let (focal, center) = lens.pinhole(size).ok_or_else(|| {
        wrong("there is no focal length".to_owned(), "Give `fl_x` in pixels, or `camera_angle_x` in radians.")
    })?;
    let lens = lens.camera_lens(size, focal, center).map_err(|problem| wrong(problem, "Export the cameras again."))?;
    let (rotation, translation) = world_to_camera(&frame.transform_matrix).ok_or_else(|| {
        wrong(
            "`transform_matrix` is not a rotation with a translation".to_owned(),
            "It must be 4x4 (or 3x4) numbers, camera to world, without stretch or mirror.",
        )
    })?;
    let is_in = |list: &Option<HashSet<String>>| list.as_ref().is_some_and(|list| list.contains(&frame.file_path));
    let split = match () {
        () if is_in(&transforms.test_filenames) => Split::Test,
        () if is_in(&transforms.val_filenames) => Split::Val,
        () => split,
    };
    let mask = match &frame.mask_path {
        Some(path) => Some(image_file(root, path).ok_or_else(|| {
            wrong(format!("its mask `{path}` is missing"), "Put the mask there, or remove `mask_path`.")
        })?),
        None => None,
    };
    let projection = Projection::from_parts(lens.intrinsics(), rotation, translation, Some(size));
    let lens = Some(lens).filter(|lens| !lens.is_pinhole());
    Ok(RawView { name: String::new(), image, mask, depth: None, projection, lens, split })
}

/// The picture that `file_path` means, which may lack its extension.
fn image_file(root: &Path, file_path: &str) -> Option<PathBuf> {
    let portable = file_path.replace('\\', "/");
    let plain = root.join(portable.trim_start_matches("./"));
    let with_extension = pictures().iter().map(|extension| PathBuf::from(format!("{}.{extension}", plain.display())));
    [plain.clone()].into_iter().chain(with_extension).find(|path| path.is_file())
}

/// Masks in a folder beside the file: by the pictures' whole path, or by the path within their own folder.
fn masks_of(root: &Path, images: &[PathBuf]) -> Result<Vec<Option<PathBuf>>> {
    let by_path = find_masks(root, images)?;
    if by_path.iter().any(Option::is_some) {
        return Ok(by_path);
    }
    let Some(folder) = sub_folder(root, &crate::dataset::masks::MASK_FOLDERS) else { return Ok(by_path) };
    let within: Vec<PathBuf> = images.iter().map(|image| image.components().skip(1).collect()).collect();
    partners(&within, &folder, pictures())
}

/// Rotation and translation of `world_to_camera` (x right, y down, z forward) from an OpenGL camera-to-world matrix.
fn world_to_camera(matrix: &[Vec<f64>]) -> Option<(DMat3, DVec3)> {
    if matrix.len() < 3 || matrix.iter().take(3).any(|row| row.len() != 4) {
        return None;
    }
    let column = |c: usize| DVec3::new(matrix[0][c], matrix[1][c], matrix[2][c]);
    let (right, up, backward, center) = (column(0), column(1), column(2), column(3));
    let scale = right.length();
    let to_world = DMat3::from_cols(right, -up, -backward) * scale.recip();
    if !center.is_finite() || !is_rotation(&to_world) {
        return None;
    }
    let rotation = DMat3::from_quat(glam::DQuat::from_mat3(&to_world).normalize()).transpose();
    Some((rotation, -(rotation * center)))
}

impl Lens {
    /// What is given here, completed by `general`.
    fn or(&self, general: &Self) -> Self {
        Self {
            camera_model: self.camera_model.clone().or_else(|| general.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(general.is_fisheye),
            camera_angle_x: self.camera_angle_x.or(general.camera_angle_x),
            camera_angle_y: self.camera_angle_y.or(general.camera_angle_y),
            fl_x: self.fl_x.or(general.fl_x),
            fl_y: self.fl_y.or(general.fl_y),
            cx: self.cx.or(general.cx),
            cy: self.cy.or(general.cy),
            w: self.w.or(general.w),
            h: self.h.or(general.h),
            k1: self.k1.or(general.k1),
            k2: self.k2.or(general.k2),
            k3: self.k3.or(general.k3),
            k4: self.k4.or(general.k4),
            p1: self.p1.or(general.p1),
            p2: self.p2.or(general.p2),
        }
    }

    /// The lens with its distortion: nerfstudio's radial and tangential terms, or those of OpenCV's fisheye.
    fn camera_lens(&self, size: (u32, u32), focal: DVec2, center: DVec2) -> std::result::Result<CameraLens, String> {
        let model = self.camera_model.as_deref().unwrap_or("PINHOLE");
        let known = ["PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "PERSPECTIVE", "perspective"];
        let fisheye = model == "OPENCV_FISHEYE" || self.is_fisheye == Some(true);
        if !known.contains(&model) && !fisheye {
            return Err(format!("camera model {model} is neither a pinhole nor OPENCV nor OPENCV_FISHEYE"));
        }
        let term = |term: Option<f64>| term.unwrap_or(0.0);
        let radial = [self.k1, self.k2, self.k3, self.k4].map(term);
        CameraLens::polynomial(size, focal, center, radial, [self.p1, self.p2].map(term), fisheye)
            .map_err(|problem| problem.to_string())
    }

    fn size(&self) -> Option<(u32, u32)> {
        let pixels = |length: f64| (length >= 1.0 && length < f64::from(u32::MAX)).then_some(length.round() as u32);
        Some((pixels(self.w?)?, pixels(self.h?)?))
    }

    /// Focal lengths and principal point in pixels.
    fn pinhole(&self, (width, height): (u32, u32)) -> Option<(DVec2, DVec2)> {
        let (width, height) = (f64::from(width), f64::from(height));
        let of_angle = |angle: Option<f64>, length: f64| angle.map(|angle| 0.5 * length / (0.5 * angle).tan());
        let of_x = self.fl_x.or(of_angle(self.camera_angle_x, width));
        let of_y = self.fl_y.or(of_angle(self.camera_angle_y, height));
        let focal = DVec2::new(of_x.or(of_y)?, of_y.or(of_x)?);
        Some((focal, DVec2::new(self.cx.unwrap_or(0.5 * width), self.cy.unwrap_or(0.5 * height))))
    }
}
