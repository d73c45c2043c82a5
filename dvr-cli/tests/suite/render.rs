//! `dvr render`: pictures of a mesh, the cameras beside them, and turntables as clips.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::files::read_rgb;
use dvr_core::mesh::{Mesh, shapes, write_mesh};
use dvr_test_support::{program, test_with};

/// A ball in the world, red in front (+z), blue behind.
fn ball(folder: &Path) -> PathBuf {
    let ball = shapes::icosphere(3, 2.0);
    let color = |z: f32| if z > 0.0 { [0.8, 0.1, 0.1] } else { [0.1, 0.1, 0.8] };
    let colors = Some(ball.vertices.iter().map(|vertex| color(vertex.z)).collect());
    let path = folder.join("ball.glb");
    write_mesh(&path, &Mesh { colors, ..ball }).unwrap();
    path
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = entries.filter(|name| !name.contains("dvr-folder")).collect();
    names.sort();
    names
}

/// The middle pixel of a picture.
fn middle(picture: &Path) -> [u8; 3] {
    let picture = read_rgb(picture).unwrap();
    picture.get_pixel(picture.width() / 2, picture.height() / 2).0
}

#[test]
fn a_mesh_is_rendered_and_its_cameras_stand_in_its_own_world() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, out) = (ball(folder.path()), folder.path().join("frames"));
    let render = ["render", text(&mesh), "--out", text(&out), "--frames", "4", "--size", "32", "--elevation", "0"];
    succeeds(&dvr(&[&render[..], &["--animation", "none"]].concat()));
    let frames = ["orbit_0000.png", "orbit_0001.png", "orbit_0002.png", "orbit_0003.png", "transforms.json"];
    assert_eq!(names(&out), frames);
    let cameras: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("transforms.json")).unwrap()).unwrap();
    let mut seen = [0, 0];
    for frame in cameras["frames"].as_array().unwrap() {
        let number = |row: usize, column: usize| frame["transform_matrix"][row][column].as_f64().unwrap();
        // The eye looks at the middle along -z of the camera: the column points from the middle to the eye.
        let eye = [0, 1, 2].map(|row| number(row, 3));
        let distance = eye.iter().map(|x| x * x).sum::<f64>().sqrt();
        (0..3).for_each(|row| assert!((number(row, 2) - eye[row] / distance).abs() < 1e-6));
        // 2.2 edges of a cube of which the ball's diameter of 4 fills .9.
        assert!((distance - 2.2 * 4.0 / 0.9).abs() < 1e-3 && eye[1].abs() < 1e-6, "{eye:?}");
        let [r, _, b] = middle(&out.join(frame["file_path"].as_str().unwrap()));
        if eye[2].abs() > 0.5 * distance {
            assert_eq!(r > b, eye[2] > 0.0, "the side that the camera stands on");
            seen[usize::from(eye[2] > 0.0)] += 1;
        }
    }
    assert!(seen.iter().all(|count| *count > 0), "{seen:?}");
    refuses(&dvr(&[&render[..], &["--overwrite", "--cameras", "dataset"]].concat()), &["--data"]);
    refuses(&dvr(&[&render[..], &["--overwrite", "--object", "1"]].concat()), &["--object", "mesh"]);
}

#[test]
fn a_mesh_with_its_scene_is_seen_by_the_scenes_cameras() {
    let tiny = Tiny::rendered(shapes::torus(1.0, 0.45, 32, 16), 12, 48);
    let (scene, mesh, out) = (tiny.scene(), tiny.path("torus.ply"), tiny.path("frames"));
    let torus = shapes::torus(1.0, 0.45, 32, 16);
    write_mesh(&mesh, &Mesh { colors: Some(vec![[0.4; 3]; torus.vertices.len()]), ..torus }).unwrap();
    let render = ["render", text(&mesh), "--out", text(&out), "--data", text(&scene), "--cameras", "dataset"];
    succeeds(&dvr(&render));
    assert_eq!(names(&out).len(), 13);
    let (mut same, mut all) = (0, 0);
    for i in 0..12 {
        let rendered = read_rgb(&out.join(format!("{i:04}.png"))).unwrap();
        let mask = read_rgb(&scene.join(format!("mask/{i:04}.png"))).unwrap();
        for (u, v, mask) in mask.enumerate_pixels() {
            all += 1;
            same += usize::from((mask.0[0] > 127) == (rendered.get_pixel(u, v).0 != [255; 3]));
        }
    }
    assert!(same * 1000 > all * 970, "{same} of {all} pixels");
}

/// What ffmpeg says, and its standard output.
fn ffmpeg(args: &[&str]) -> (String, Vec<u8>) {
    let output = Command::new(program("ffmpeg")).args(args).output().unwrap();
    (String::from_utf8_lossy(&output.stderr).into_owned(), output.stdout)
}

#[test_with(ffmpeg)]
fn a_turntable_is_a_clip_of_all_frames_with_even_sizes_and_their_colours() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = ball(folder.path());
    for (format, codec) in [("mp4", "h264"), ("webm", "vp9")] {
        // What ffmpeg would take for a pattern may be in the folder's name.
        let out = folder.path().join(format!("50 %d {format}"));
        let render = ["render", text(&mesh), "--out", text(&out), "--frames", "5", "--size", "65", "--elevation", "0"];
        let said = succeeds(&dvr(&[&render[..], &["--animation", format]].concat()));
        let clip = out.join(format!("turntable.{format}"));
        assert!(said.contains(text(&clip)), "{said}");
        assert_eq!(names(&out).len(), 7, "{:?}", names(&out));
        let (told, _) = ffmpeg(&["-hide_banner", "-i", text(&clip)]);
        for part in [codec, "yuv420p", "bt709", "66x66", "18 fps"] {
            assert!(told.contains(part), "{part} is missing in: {told}");
        }
        let (_, pixels) = ffmpeg(&["-v", "error", "-i", text(&clip), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]);
        assert_eq!(pixels.len(), 5 * 66 * 66 * 3, "five frames of 66x66");
        for (frame, pixels) in pixels.chunks(66 * 66 * 3).enumerate() {
            let pixel = |u: usize, v: usize| [0, 1, 2].map(|c| i32::from(pixels[3 * (66 * v + u) + c]));
            let expected = middle(&out.join(format!("orbit_{frame:04}.png"))).map(i32::from);
            let found = pixel(32, 32);
            assert!((0..3).all(|c| (found[c] - expected[c]).abs() < 24), "{format} {frame}: {found:?}, {expected:?}");
            assert!(pixel(65, 65).iter().all(|c| *c > 240), "the pixels that make it even are white");
        }
    }
}

/// `dvr render` of a ball with only the programs of a folder in reach.
fn alone(folder: &Path, format: &str) -> Output {
    let (mesh, out) = (ball(folder), folder.join("frames"));
    let args = ["render", text(&mesh), "--out", text(&out), "--frames", "2", "--size", "16", "--animation", format];
    Command::new(env!("CARGO_BIN_EXE_dvr")).args(args).env("PATH", folder.join("programs")).output().unwrap()
}

#[test]
fn without_ffmpeg_one_sentence_says_how_to_install_it_before_anything_is_rendered() {
    let folder = tempfile::tempdir().unwrap();
    for format in ["mp4", "webm"] {
        let refused = alone(folder.path(), format);
        refuses(&refused, &["`ffmpeg`", "makes MP4 and WebM", "apt install ffmpeg", "brew install ffmpeg", "conda"]);
        assert!(!folder.path().join("frames").exists());
    }
    succeeds(&alone(folder.path(), "gif"));
}

#[test]
fn a_clip_of_the_datasets_views_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, out) = (ball(folder.path()), folder.path().join("frames"));
    let args = ["render", text(&mesh), "--out", text(&out), "--cameras", "dataset", "--animation", "mp4"];
    refuses(&dvr(&args), &["turntable.mp4", "--cameras", "--animation none"]);
    assert!(!out.exists());
}

/// An ffmpeg that does what a script says.
#[cfg(unix)]
fn script(folder: &Path, lines: &str) {
    use std::os::unix::fs::PermissionsExt;
    let path = folder.join("programs/ffmpeg");
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(&path, format!("#!/bin/sh\n{lines}\n")).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
}

#[cfg(unix)]
#[test]
fn an_ffmpeg_that_cannot_or_fails_is_quoted_and_leaves_no_half_of_a_clip() {
    let folder = tempfile::tempdir().unwrap();
    script(folder.path(), "echo ' V....D mpeg4  MPEG-4 part 2'");
    refuses(&alone(folder.path(), "webm"), &["`libvpx-vp9`", "WebM", "--animation"]);
    assert!(!folder.path().join("frames").exists());
    let list = "case \"$*\" in *-encoders) echo ' V....D libx264  H.264'; exit;; esac";
    script(
        folder.path(),
        &format!("{list}\nfor last; do :; done; echo half > \"$last\"; echo 'Error: no room' >&2; exit 3"),
    );
    refuses(&alone(folder.path(), "mp4"), &["ffmpeg failed at encoding", "exit status: 3", "no room"]);
    assert_eq!(names(&folder.path().join("frames")), ["orbit_0000.png", "orbit_0001.png", "transforms.json"]);
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_ffmpeg_and_no_half_of_a_clip_is_left() {
    use nix::sys::signal::{Signal, kill};
    use nix::unistd::Pid;
    let folder = tempfile::tempdir().unwrap();
    let (mesh, out, pid) = (ball(folder.path()), folder.path().join("frames"), folder.path().join("pid"));
    let list = "case \"$*\" in *-encoders) echo ' V....D libx264  H.264'; exit;; esac";
    let hang = "for last; do :; done; echo half > \"$last\"";
    // The shell's own commands alone: nothing else is in reach.
    script(
        folder.path(),
        &format!("PATH=/usr/bin:/bin\n{list}\n{hang}\necho $$ > {0}.half; mv {0}.half {0}; sleep 300", pid.display()),
    );
    let args = ["render", text(&mesh), "--out", text(&out), "--frames", "2", "--size", "16", "--animation", "mp4"];
    let mut command = Command::new(env!("CARGO_BIN_EXE_dvr"));
    let mut child = command.args(args).env("PATH", folder.path().join("programs")).spawn().unwrap();
    while !pid.exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let of_ffmpeg: i32 = std::fs::read_to_string(&pid).unwrap().trim().parse().unwrap();
    kill(Pid::from_raw(i32::try_from(child.id()).unwrap()), Signal::SIGINT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(kill(Pid::from_raw(of_ffmpeg), None).is_err(), "ffmpeg goes on");
    assert_eq!(names(&out), ["orbit_0000.png", "orbit_0001.png", "transforms.json"]);
}
