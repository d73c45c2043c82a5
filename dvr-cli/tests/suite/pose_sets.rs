//! Several sets of photographs of one object on the command line: what is refused, and two poses that become one scene.

use std::path::{Path, PathBuf};
use std::process::Command;

#[cfg(unix)]
use crate::support::script;
use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::Camera;
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::files::write_jpeg;
use dvr_core::mesh::{Topology, read_mesh};
use dvr_stress::{TWO_SETS, TwoPoses, seam};
use dvr_test_support::test_with;
use image::{Rgb, RgbImage};

/// Folders with a few pictures each.
fn folders(names: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in names {
        let photos = folder.path().join(name);
        std::fs::create_dir_all(&photos).unwrap();
        for i in 0..4u8 {
            let picture = RgbImage::from_fn(40, 30, |u, v| Rgb([u as u8, v as u8, i]));
            write_jpeg(&photos.join(format!("{i}.jpg")), &picture, 90, None).unwrap();
        }
    }
    folder
}

#[test]
fn sets_that_are_none_are_named_before_anything_is_begun() {
    let folder = folders(&["top", "bottom", "top/inside"]);
    let at = |name: &str| folder.path().join(name);
    let (top, bottom, run) = (at("top"), at("bottom"), at("run"));
    std::fs::create_dir(at("nothing")).unwrap();
    let train = |sets: &[&Path], more: &[&str]| {
        let sets: Vec<&str> = sets.iter().map(|set| text(set)).collect();
        dvr(&[&["train"][..], &sets, &["--out", text(&run)], more].concat())
    };
    let again = at("bottom/../top");
    refuses(&train(&[&top, &again], &[]), &["top", "same set", "folder of its own"]);
    refuses(&train(&[&top, &at("top/inside")], &[]), &["inside", "within the other"]);
    refuses(&train(&[&top, &at("nothing")], &[]), &["nothing", "no pictures", "JPEG"]);
    refuses(&train(&[&top, &at("nowhere")], &[]), &["nowhere"]);
    refuses(&train(&[&top, &bottom], &["--masks", text(&at("masks"))]), &["masks", "2 sets", "of each"]);
    refuses(&train(&[&top, &bottom], &["--masks", "cube"]), &["--masks cube", "all sets", "Leave it out"]);
    refuses(&train(&[&top, &bottom], &["--scale", "0:(1,1)-(9,9)=12cm"]), &["--scale", "dvr mesh RUN"]);
    refuses(&train(&[&top, &bottom], &["--drop-support"]), &["--drop-support", "Leave it out"]);
    refuses(&dvr(&["train", text(&top), text(&bottom), "--out", text(&at("bottom/run"))]), &["bottom"]);
    refuses(&dvr(&["cameras", text(&top), text(&top)]), &["same set"]);
    let mut alone = Command::new(env!("CARGO_BIN_EXE_dvr"));
    let alone = alone.args(["cameras", text(&top), text(&bottom)]).env("PATH", at("empty"));
    refuses(&alone.output().unwrap(), &["`colmap`", "apt install colmap"]);
    let mut left: Vec<_> = folder.path().read_dir().unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["bottom", "nothing", "top"]);
}

#[cfg(unix)]
#[test]
fn scenes_with_cameras_are_joined_as_they_are_and_a_crash_is_gone_on_from() {
    let (one, other) = (Tiny::new(), Tiny::new());
    let (sets, colmap) = ([one.scene(), other.scene()], one.path("colmap"));
    let (joined, run) = (one.path("joined"), one.path("run"));
    let args = ["train", text(&sets[0]), text(&sets[1]), "--out", text(&run), "--cameras", text(&joined)];
    let args = [&args[..], &["--colmap", text(&colmap)]].concat();
    // Features are asked for within masks, by the cameras that are known.
    let help = "--ImageReader.camera_model --ImageReader.camera_params --ImageReader.mask_path";
    let calls = one.path("calls");
    let answers = format!("[ \"$2\" = -h ] && echo '{help}' && exit 0\necho \"$*\" >> {}\n", calls.display());
    script(&colmap, &format!("{answers}[ \"$1\" = exhaustive_matcher ] && echo 'ERROR: no luck' && exit 3\nexit 0"));
    refuses(&dvr(&args), &["colmap failed at matching", "no luck", "sfm.log"]);
    let called = std::fs::read_to_string(&calls).unwrap();
    assert!(called.contains("--ImageReader.camera_model PINHOLE") && called.contains("feature_masks"), "{called}");
    for set in ["torus", "torus2"] {
        let name = format!("work/pictures/{set}_0003.png");
        assert!(joined.join(&name).is_file(), "{name}");
    }
    assert!(!joined.join("transforms.json").exists() && !run.exists());
    // The same command goes on: what is finished is not made again. This program writes no database.
    std::fs::remove_file(&calls).unwrap();
    script(&colmap, &format!("{answers}exit 0"));
    refuses(&dvr(&args), &["database.db", "begin anew"]);
    let called = std::fs::read_to_string(&calls).unwrap();
    assert!(!called.contains("feature_extractor") && called.contains("exhaustive_matcher"), "{called}");
}

/// The cameras of a scene by the names of its views, in its own world.
fn cameras(scene: &Path) -> Vec<(String, Camera)> {
    let scene = read_scene(scene, &ReadOptions::default()).unwrap();
    scene.views.iter().map(|view| (view.name.clone(), view.camera.into_world(&scene.object_to_world))).collect()
}

#[test_with(colmap)]
fn an_object_that_was_turned_over_becomes_one_closed_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| -> PathBuf { folder.path().join(name) };
    TwoPoses { views: 20, width: 400, samples: 2, masks: true }.write(folder.path()).unwrap();
    let run = at("run");
    // One set is a scene with cameras, of the other these are found.
    std::fs::rename(at("top/masks"), at("truth/top/masks")).unwrap();
    let (top, bottom) = (at("truth/top"), at("bottom"));
    let small = ["--capacity", "32", "--steps", "40", "--resolution", "48", "--no-report", "--texture", "off"];
    let args = ["train", text(&top), text(&bottom), "--out", text(&run), "--colmap-threads", "2", "--features", "1200"];
    succeeds(&dvr(&[&args[..], &small].concat()));

    let joined = at("truth/top-bottom-joined");
    let found = cameras(&joined.join("transforms.json"));
    let (mut ours, mut theirs) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    for (set, name) in TWO_SETS.iter().enumerate() {
        for (view, camera) in cameras(&at("truth").join(name).join("transforms.json")) {
            if let Some((_, placed)) = found.iter().find(|(found, _)| *found == format!("{name}_{view}")) {
                ours[set].push(placed.clone());
                theirs[set].push(camera);
            }
        }
        assert!(ours[set].len() >= 12, "{} of 20 pictures of {name}", ours[set].len());
    }
    let truth = read_mesh(at("truth/mesh.ply")).unwrap().mesh;
    let (mean, largest) = seam([&ours[0], &ours[1]], [&theirs[0], &theirs[1]], &truth.vertices).unwrap();
    // The object is about .9 wide, and a cell a 32nd of that.
    assert!(mean < 0.01 && largest < 0.02, "{mean} in the mean, {largest} at most");
    let mesh = read_mesh(run.join("mesh.ply")).unwrap().mesh;
    assert_eq!(Topology::of(&mesh).handles(), Some(0), "one closed surface without holes");

    // What was found is there, also for another run.
    let again = dvr(&["cameras", text(&top), text(&bottom), "--features", "1200"]);
    assert!(succeeds(&again).contains("pictures of 2 sets"), "{again:?}");
    assert!(!String::from_utf8_lossy(&again.stderr).contains("matching"), "{again:?}");
}
