//! A program in COLMAP's place: what is made of its results, crashes, silence and stops.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::files::{read_mask, write_gray_png, write_jpeg};
use dvr_core::{Camera, Cancellation};
use dvr_sfm::{Event, FoundCameras, Mapper, SfmError, SfmOptions, Source, find_cameras};
use glam::{DQuat, DVec3};
use image::{GrayImage, Luma, Rgb, RgbImage};

/// Answers as COLMAP does. Files beside it change that: `crash_STEP`, `hang_STEP`, `no_model`.
const SCRIPT: &str = r#"#!/bin/sh
here=$(dirname "$0")
step=$1
shift
if [ "$1" = "-h" ]; then cat "$here/help"; exit 0; fi
if [ "$step" = help ]; then echo "COLMAP 3.8 -- a fake"; cat "$here/commands" 2>/dev/null; exit 0; fi
called="$*"
while [ $# -gt 0 ]; do
  case $1 in
    --database_path) database=$2 ;;
    --image_path) images=$2 ;;
    --image_list_path) list=$2 ;;
    --input_path) input=$2 ;;
    --output_path) output=$2 ;;
  esac
  shift
done
if [ "$step" = mapper ] && [ -n "$input" ]; then step=mapper_of_the_rest; fi
echo "$step $called" >> "$here/calls"
if [ -f "$here/hang_$step" ]; then echo $$ > "$here/pid"; echo "half" > "$output/half" 2>/dev/null; sleep 60; fi
if [ -f "$here/crash_$step" ]; then echo "ERROR: out of luck"; kill -SEGV $$; fi
case $step in
  feature_extractor)
    n=0
    while read -r name; do
      test -e "$images/$name" || exit 9
      n=$((n + 1)); echo "$name" >> "$database"; echo "Processed file [$n/$(wc -l < "$list")]"
    done < "$list" ;;
  exhaustive_matcher) printf 'Matching block [1/2, 1/2]'; echo ' in 0.1s'; echo 'Matching block [2/2, 2/2] in 0.1s' ;;
  global_mapper) cp -r "$here/models/." "$output" ;;
  mapper)
    if [ -f "$here/no_model" ]; then echo "=> No good initial image pair found."; exit 1; fi
    cp -r "$here/models/." "$output"
    echo "Registering image #1 (2)" ;;
  mapper_of_the_rest) cp "$here/larger"/* "$output" 2>/dev/null || cp "$input"/* "$output" ;;
  bundle_adjuster) cp "$input"/* "$output" ;;
  image_undistorter)
    mkdir -p "$output/images" "$output/sparse"
    cp -rL "$images/." "$output/images"; cp "$here/undistorted"/* "$output/sparse"
    echo "Undistorting image [1/1]" ;;
  model_converter) cp "$input"/*.txt "$output" ;;
esac
"#;

/// Options by the names of COLMAP 3.8.
const HELP: &str = "--ImageReader.camera_model arg --ImageReader.single_camera arg --SiftExtraction.use_gpu arg \
                    --SiftExtraction.num_threads arg --SiftMatching.use_gpu arg --Mapper.min_model_size arg \
                    --ExhaustiveMatching.block_size arg";

const SIZE: (u32, u32) = (40, 30);

/// Photographs, a fake COLMAP, and the model that it makes.
struct Fake(tempfile::TempDir);

impl Fake {
    /// Five photographs, of which the model has four.
    fn new() -> Self {
        let fake = Self(tempfile::tempdir().unwrap());
        std::fs::create_dir(fake.at("photos")).unwrap();
        for i in 0..5u8 {
            let picture = RgbImage::from_fn(SIZE.0, SIZE.1, |u, v| Rgb([u as u8 * 5, v as u8 * 7, i * 30]));
            write_jpeg(&fake.at(&format!("photos/{i}.jpg")), &picture, 90, None).unwrap();
        }
        let script = fake.at("colmap");
        std::fs::write(&script, SCRIPT).unwrap();
        std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).unwrap();
        std::fs::write(fake.at("help"), HELP).unwrap();
        fake.write_model("models/0", 0..4, "SIMPLE_RADIAL", "35 20 15 -0.2");
        fake.write_model("undistorted", 0..4, "PINHOLE", "35 35 20 15");
        fake
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write_model(&self, folder: &str, numbers: std::ops::Range<usize>, model: &str, parameters: &str) {
        let folder = self.at(folder);
        std::fs::create_dir_all(&folder).unwrap();
        let (mut images, mut points) = (String::new(), String::new());
        for i in numbers.clone() {
            let camera = camera(i);
            let (q, t) = (DQuat::from_mat3(&camera.rotation), camera.translation);
            images += &format!("{i} {} {} {} {} {} {} {} 1 {i}.jpg\n20 15 1\n", q.w, q.x, q.y, q.z, t.x, t.y, t.z);
            points += &format!(" {i} 0");
        }
        std::fs::write(folder.join("cameras.txt"), format!("1 {model} {} {} {parameters}\n", SIZE.0, SIZE.1)).unwrap();
        std::fs::write(folder.join("images.txt"), images).unwrap();
        std::fs::write(folder.join("points3D.txt"), format!("1 0 0 0 255 128 0 0.5{points}\n")).unwrap();
    }

    fn options(&self) -> SfmOptions {
        SfmOptions { program: Some(self.at("colmap")), ..SfmOptions::default() }
    }

    fn find_with(&self, options: &SfmOptions) -> (Result<FoundCameras, SfmError>, Vec<Event>) {
        let source = Source::at(&self.at("photos")).unwrap().unwrap();
        let mut events = Vec::new();
        let found = find_cameras(&source, &self.out(), options, &mut |event| events.push(event));
        (found, events)
    }

    fn find(&self) -> Result<FoundCameras, SfmError> {
        self.find_with(&self.options()).0
    }

    fn out(&self) -> PathBuf {
        self.at("photos-cameras")
    }

    /// The steps that were asked for, in their order.
    fn calls(&self) -> Vec<String> {
        let calls = std::fs::read_to_string(self.at("calls")).unwrap_or_default();
        calls.lines().map(|line| line.split(' ').next().unwrap().to_owned()).collect()
    }

    /// Nothing is there that looks like a result.
    fn assert_nothing_half_written(&self) {
        for name in ["transforms.json", "images", "sparse", "sfm.json", "points.ply"] {
            assert!(!self.out().join(name).exists(), "{name}");
        }
    }
}

fn camera(i: usize) -> Camera {
    let turn = 1.4 * i as f64;
    let eye = DVec3::new(3.0 * turn.cos(), 0.5 + 0.3 * i as f64, 3.0 * turn.sin());
    Camera::look_at(SIZE.0, SIZE.1, 35.0, eye, DVec3::ZERO, DVec3::Y)
}

const ALL: [&str; 7] = [
    "feature_extractor",
    "exhaustive_matcher",
    "mapper",
    "mapper_of_the_rest",
    "bundle_adjuster",
    "image_undistorter",
    "model_converter",
];

#[test]
fn cameras_are_written_for_colmap_and_nerfstudio_and_found_once() {
    let fake = Fake::new();
    let (found, events) = fake.find_with(&fake.options());
    let found = found.unwrap();
    assert_eq!((found.placed, &found.not_placed[..]), (4, &["4.jpg".to_owned()][..]));
    assert_eq!((found.engine.as_str(), found.points, found.mean_error_px), ("COLMAP 3.8", 1, 0.5));
    assert!(events.contains(&Event::Step { name: "features", parts: 5 }));
    assert!(events.contains(&Event::Progress(5)), "the features of five pictures");
    assert!(events.contains(&Event::Step { name: "matching", parts: 4 }) && events.contains(&Event::Progress(4)));
    assert!(events.contains(&Event::Step { name: "mapping", parts: 5 }) && events.contains(&Event::Progress(2)));
    assert!(events.iter().any(|event| matches!(event, Event::Note(note) if note.contains("4.jpg"))), "{events:?}");
    assert!(!fake.out().join("work").exists());
    for path in [fake.out(), FoundCameras::read(&fake.out()).unwrap().scene(&fake.out())] {
        let scene = read_scene(&path, &ReadOptions::default()).unwrap();
        for (i, view) in scene.views.iter().enumerate() {
            assert_eq!(view.name, i.to_string());
            let camera_found = view.camera.into_world(&scene.object_to_world);
            assert!((camera_found.center() - camera(i).center()).length() < 1e-6);
        }
        assert_eq!(scene.sparse_points.unwrap().cloud.points.len(), 1);
    }
    let log = std::fs::read_to_string(fake.out().join("sfm.log")).unwrap();
    assert!(log.contains("Processed file [5/5]") && log.contains("--SiftExtraction.use_gpu 0"), "{log}");
    // A second time there is nothing to do, not even with COLMAP gone.
    assert_eq!(fake.calls(), ALL);
    std::fs::remove_file(fake.at("colmap")).unwrap();
    let (again, events) = fake.find_with(&fake.options());
    assert!(again.unwrap() == found && events.is_empty());
    // Other options are other cameras, which are not replaced in silence.
    let other = SfmOptions { camera_model: "OPENCV".to_owned(), ..fake.options() };
    assert!(matches!(fake.find_with(&other).0, Err(SfmError::NotInstalled { program: "colmap", .. })));
}

#[test]
fn pictures_that_were_left_out_are_placed_in_the_model_that_stands() {
    let fake = Fake::new();
    // The first is joined by what is the second; of the third a picture stays apart.
    fake.write_model("models/0", 0..3, "SIMPLE_RADIAL", "35 20 15 -0.2");
    fake.write_model("models/1", 3..4, "SIMPLE_RADIAL", "35 20 15 -0.2");
    fake.write_model("models/2", 3..5, "SIMPLE_RADIAL", "35 20 15 -0.2");
    fake.write_model("larger", 0..4, "SIMPLE_RADIAL", "35 20 15 -0.2");
    let found = fake.find().unwrap();
    assert_eq!((found.placed, &found.not_placed[..]), (4, &["4.jpg".to_owned()][..]));
    assert_eq!(found.model_sizes, [4, 2]);
    assert_eq!(fake.calls(), ALL);
}

#[test]
fn a_model_that_stands_is_taken_where_colmap_fails_to_place_more() {
    let fake = Fake::new();
    std::fs::write(fake.at("crash_mapper_of_the_rest"), "").unwrap();
    let found = fake.find().unwrap();
    assert_eq!((found.placed, found.model_sizes), (4, vec![4]));
    assert!(
        found.notes.iter().any(|note| note.contains("once more") && note.contains("signal: 11")),
        "{:?}",
        found.notes
    );
    assert_eq!(fake.calls(), ALL);
}

#[test]
fn other_photographs_replace_cameras_only_where_that_is_asked_for() {
    let fake = Fake::new();
    fake.find().unwrap();
    std::fs::remove_file(fake.at("photos/4.jpg")).unwrap();
    assert!(matches!(fake.find(), Err(SfmError::OtherPhotographs { .. })));
    assert!(fake.out().join("transforms.json").exists());
    let found = fake.find_with(&SfmOptions { may_replace: true, ..fake.options() }).0.unwrap();
    assert!(found.not_placed.is_empty() && found.notes.is_empty(), "{found:?}");
}

#[test]
fn a_crash_half_way_leaves_no_result_and_what_was_finished_is_kept() {
    for (at, step) in ALL.iter().enumerate().filter(|(_, step)| **step != "mapper_of_the_rest") {
        let fake = Fake::new();
        let crash = fake.at(&format!("crash_{step}"));
        std::fs::write(&crash, "").unwrap();
        let error = fake.find().unwrap_err();
        assert!(matches!(error, SfmError::Failed { .. }), "{error}");
        let said = error.to_string();
        assert!(
            said.contains("signal: 11") && said.contains("ERROR: out of luck") && said.contains("sfm.log"),
            "{said}"
        );
        fake.assert_nothing_half_written();
        std::fs::remove_file(&crash).unwrap();
        fake.find().unwrap();
        // Undistortion is two commands.
        let repeated = if *step == "model_converter" { at - 1 } else { at };
        let expected: Vec<&str> = ALL[..=at].iter().chain(&ALL[repeated..]).copied().collect();
        assert_eq!(fake.calls(), expected, "{step}");
    }
}

#[test]
fn colmap_ends_with_the_work_which_goes_on_where_it_was() {
    let fake = Fake::new();
    std::fs::write(fake.at("hang_mapper"), "").unwrap();
    let cancellation = Cancellation::default();
    let (token, pid) = (cancellation.clone(), fake.at("pid"));
    let canceller = std::thread::spawn(move || {
        let start = Instant::now();
        while !pid.exists() && start.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(20));
        }
        token.cancel()
    });
    let stopped = fake.find_with(&SfmOptions { cancellation, ..fake.options() }).0;
    assert!(matches!(stopped, Err(SfmError::Cancelled(_))), "{stopped:?}");
    assert!(canceller.join().unwrap());
    let pid = std::fs::read_to_string(fake.at("pid")).unwrap();
    assert!(!Path::new("/proc").join(pid.trim()).exists(), "COLMAP goes on");
    fake.assert_nothing_half_written();
    std::fs::remove_file(fake.at("hang_mapper")).unwrap();
    let found = fake.find().unwrap();
    assert_eq!(found.placed, 4);
    let expected: Vec<&str> = ALL[..3].iter().chain(&ALL[2..]).copied().collect();
    assert_eq!(fake.calls(), expected);
}

#[test]
fn all_pictures_are_placed_at_once_by_a_colmap_that_can() {
    let fake = Fake::new();
    let global = SfmOptions { mapper: Mapper::Global, ..fake.options() };
    // Without GLOMAP, which nobody has beside the tests.
    let error = fake.find_with(&global).0.unwrap_err();
    assert!(matches!(error, SfmError::NotInstalled { program: "glomap", .. }), "{error}");
    assert!(!fake.out().exists() && fake.calls().is_empty(), "nothing was begun");
    std::fs::write(fake.at("commands"), "Commands:\n  global_mapper\n  mapper\n").unwrap();
    assert_eq!(fake.find_with(&global).0.unwrap().placed, 4);
    let of_global = ALL.iter().filter(|step| **step != "mapper_of_the_rest");
    let expected: Vec<&str> = of_global.map(|step| if *step == "mapper" { "global_mapper" } else { step }).collect();
    assert_eq!(fake.calls(), expected);
    // Cameras that were placed another way are others.
    assert!(matches!(fake.find(), Err(SfmError::OtherPhotographs { .. })));
}

#[test]
fn the_largest_of_several_models_is_taken_and_pictures_without_anything_in_common_are_told() {
    let fake = Fake::new();
    fake.write_model("models/0", 3..5, "PINHOLE", "35 35 20 15");
    fake.write_model("models/1", 0..4, "PINHOLE", "35 35 20 15");
    let found = fake.find().unwrap();
    assert_eq!(found.model_sizes, [4, 2]);
    assert!(found.notes.iter().any(|note| note.contains("2 models that are not connected")), "{found:?}");

    let unrelated = Fake::new();
    std::fs::write(unrelated.at("no_model"), "").unwrap();
    let error = unrelated.find().unwrap_err();
    assert!(matches!(error, SfmError::NoModel { pictures: 5, .. }), "{error}");
    unrelated.assert_nothing_half_written();
}

#[test]
fn masks_beside_photographs_follow_the_undistortion() {
    let fake = Fake::new();
    std::fs::create_dir(fake.at("photos/masks")).unwrap();
    let mask = GrayImage::from_fn(SIZE.0, SIZE.1, |u, v| Luma([if (8..32).contains(&u) && v > 9 { 255 } else { 0 }]));
    for i in [0, 1, 4] {
        write_gray_png(&fake.at(&format!("photos/masks/{i}.png")), &mask).unwrap();
    }
    let found = fake.find().unwrap();
    assert_eq!(found.masks, 2, "that of a picture that has no camera is not needed");
    let undistorted = read_mask(&fake.out().join("masks/0.png")).unwrap();
    assert_eq!(undistorted.size(), SIZE);
    // The lens draws the borders inwards: undone, the object is wider.
    let before = mask.pixels().filter(|pixel| pixel.0[0] > 0).count();
    assert!(undistorted.object_pixels() > before, "{} of {before}", undistorted.object_pixels());
}

#[test]
fn too_few_pictures_are_refused_before_anything_is_written() {
    let fake = Fake::new();
    for i in 1..5 {
        std::fs::remove_file(fake.at(&format!("photos/{i}.jpg"))).unwrap();
    }
    let error = fake.find().unwrap_err();
    assert!(matches!(error, SfmError::TooFewPictures { found: 1, .. }), "{error}");
    assert!(!fake.out().exists());
    // Pictures that cannot be read are no pictures.
    for i in 1..4 {
        std::fs::write(fake.at(&format!("photos/{i}.jpg")), "half").unwrap();
    }
    let (error, events) = fake.find_with(&fake.options());
    assert!(matches!(error, Err(SfmError::TooFewPictures { found: 1, .. })), "{error:?}");
    assert_eq!(events.iter().filter(|event| matches!(event, Event::Note(_))).count(), 3);
    assert!(fake.calls().is_empty() && !fake.out().exists(), "nothing was begun");
}

#[test]
fn each_camera_has_its_own_intrinsics() {
    let fake = Fake::new();
    let portrait = RgbImage::from_pixel(SIZE.1, SIZE.0, Rgb([9; 3]));
    write_jpeg(&fake.at("photos/3.jpg"), &portrait, 90, None).unwrap();
    fake.find().unwrap();
    assert_eq!(fake.calls()[..3], [ALL[0], ALL[0], ALL[1]], "landscape and portrait");
    let per_picture = SfmOptions { sharing: dvr_sfm::CameraSharing::Picture, may_replace: true, ..fake.options() };
    fake.find_with(&per_picture).0.unwrap();
    assert_eq!(fake.calls().iter().filter(|call| *call == ALL[0]).count(), 3);
}
