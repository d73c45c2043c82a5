//! Photographs without cameras on the command line: what is said where COLMAP is missing or fails, and how it is ended.
//! What becomes of its results is tested in `dvr-sfm`.

use std::path::PathBuf;
use std::process::{Command, Output};

#[cfg(unix)]
use crate::support::script;
use crate::support::{dvr, refuses, succeeds, text};
use dvr_core::files::write_jpeg;
use image::{Rgb, RgbImage};

struct Photographs(tempfile::TempDir);

impl Photographs {
    fn new(count: u8) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let photographs = Self(folder);
        std::fs::create_dir(photographs.at("photos")).unwrap();
        for i in 0..count {
            let picture = RgbImage::from_fn(40, 30, |u, v| Rgb([u as u8, v as u8, i]));
            write_jpeg(&photographs.at(&format!("photos/{i}.jpg")), &picture, 90, None).unwrap();
        }
        photographs
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// `dvr` with no program in reach.
    fn alone(&self, args: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_dvr")).args(args).env("PATH", self.at("empty")).output().unwrap()
    }

    fn nothing_was_written(&self) {
        assert_eq!(self.0.path().read_dir().unwrap().count(), 1, "the photographs alone");
    }
}

#[test]
fn without_colmap_one_sentence_says_how_to_install_it() {
    let photographs = Photographs::new(4);
    let (photos, run) = (photographs.at("photos"), photographs.at("run"));
    for args in [&["cameras", text(&photos)][..], &["train", text(&photos), "--out", text(&run)]] {
        refuses(&photographs.alone(args), &["`colmap`", "apt install colmap", "brew install colmap", "conda"]);
        photographs.nothing_was_written();
    }
}

#[test]
fn commands_that_need_cameras_say_how_they_are_found() {
    let photographs = Photographs::new(4);
    refuses(&dvr(&["info", text(&photographs.at("photos"))]), &["no cameras", "dvr cameras", "dvr train"]);
}

#[test]
fn too_few_pictures_and_other_formats_are_refused_with_what_to_do() {
    let photographs = Photographs::new(1);
    let photos = photographs.at("photos");
    refuses(&dvr(&["cameras", text(&photos)]), &["1 of the pictures", "all sides"]);
    std::fs::write(photos.join("IMG_0001.HEIC"), "").unwrap();
    refuses(&dvr(&["cameras", text(&photos)]), &["HEIC", "IMG_0001.HEIC", "heif-convert"]);
    photographs.nothing_was_written();
    std::fs::write(photos.join("IMG_0001.jpg"), "").unwrap();
    refuses(&dvr(&["cameras", text(&photos), "--out", text(&photos.join("cameras"))]), &["photos"]);
    let nothing = photographs.at("nothing");
    std::fs::create_dir(&nothing).unwrap();
    refuses(&dvr(&["cameras", text(&nothing)]), &["nothing", "no pictures"]);
    let tree = photographs.at("no.tree");
    refuses(&dvr(&["cameras", text(&photos), "--vocab-tree", text(&tree)]), &["no.tree"]);
}

#[cfg(unix)]
#[test]
fn colmap_that_fails_is_quoted_and_the_same_command_goes_on() {
    let photographs = Photographs::new(4);
    let (photos, colmap) = (photographs.at("photos"), photographs.at("colmap"));
    let args = ["cameras", text(&photos), "--colmap", text(&colmap)];
    script(&colmap, "[ \"$2\" = -h ] && exit 0\necho 'ERROR: no space left'; exit 4");
    refuses(&dvr(&args), &["colmap failed at features", "exit status: 4", "no space left", "sfm.log"]);
    let out = photographs.at("photos-cameras");
    assert!(!out.join("transforms.json").exists() && out.join("sfm.log").exists());
    // Nothing that fits together: the mapper makes no model.
    script(&colmap, "[ \"$2\" = -h ] && exit 0\n[ \"$1\" = mapper ] && exit 1\nexit 0");
    refuses(&dvr(&args), &["no cameras were found", "4 pictures", "overlapping", "--matching exhaustive"]);
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_colmap_with_exit_code_130() {
    use nix::sys::signal::{Signal, kill};
    use nix::unistd::Pid;
    // It hangs when it is asked what it can do, or in its first step.
    for answers in ["", "[ \"$1\" = help ] && exit 0\n[ \"$2\" = -h ] && exit 0\n"] {
        let photographs = Photographs::new(4);
        let (photos, colmap, pid) = (photographs.at("photos"), photographs.at("colmap"), photographs.at("pid"));
        script(&colmap, &format!("{answers}echo $$ > {0}.half; mv {0}.half {0}; sleep 300", pid.display()));
        let mut command = Command::new(env!("CARGO_BIN_EXE_dvr"));
        let mut child = command.args(["cameras", text(&photos), "--colmap", text(&colmap)]).spawn().unwrap();
        while !pid.exists() {
            assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        let id = |text: &str| Pid::from_raw(text.trim().parse().unwrap());
        let colmap_id = id(&std::fs::read_to_string(&pid).unwrap());
        kill(id(&child.id().to_string()), Signal::SIGTERM).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(130));
        assert!(kill(colmap_id, None).is_err(), "COLMAP goes on");
    }
    assert!(succeeds(&dvr(&["cameras", "--help"])).contains("--camera-model"));
}
