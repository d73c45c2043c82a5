//! Clips, by ffmpeg: made of rendered frames, some of them blurred, whole and damaged.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::{photograph, true_cameras};
use dvr_core::files::{read_rgb, write_jpeg};
use dvr_sfm::{Event, SfmError, SfmOptions, Source, find_cameras};
use dvr_test_support::{program, test_with};
use image::{Rgb, RgbImage};

/// A clip of two seconds whose frames show their numbers as brightness; `is_sharp` says which show stripes, too.
fn write_clip(clip: &Path, is_sharp: impl Fn(u32) -> bool) {
    let frames = clip.with_extension("frames");
    std::fs::create_dir_all(&frames).unwrap();
    for i in 0..60u32 {
        let sharp = is_sharp(i);
        let frame = RgbImage::from_fn(160, 120, |u, v| {
            let stripe = if sharp && (u / 4 + v / 4) % 2 == 0 { 60 } else { 0 };
            Rgb([(20 + 3 * i + stripe).min(255) as u8; 3])
        });
        write_jpeg(&frames.join(format!("{i:03}.jpg")), &frame, 98, None).unwrap();
    }
    encode(&frames, clip, "30");
}

fn encode(frames: &Path, clip: &Path, rate: &str) {
    let mut ffmpeg = Command::new(program("ffmpeg"));
    ffmpeg.args(["-v", "error", "-framerate", rate, "-i"]).arg(frames.join("%03d.jpg"));
    let encoded = ffmpeg.args(["-c:v", "mpeg4", "-q:v", "2", "-y"]).arg(clip).output().unwrap();
    assert!(encoded.status.success(), "{}", String::from_utf8_lossy(&encoded.stderr));
}

/// A COLMAP that fails at once: what was done before it stays to be looked at.
fn no_colmap(folder: &Path) -> PathBuf {
    let path = folder.join("colmap");
    std::fs::write(&path, "#!/bin/sh\nexit 7\n").unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

/// The frames that are taken of a clip, with what was told.
fn frames_of(clip: &Path, frames: usize) -> (Result<Vec<RgbImage>, SfmError>, Vec<Event>) {
    let folder = clip.parent().unwrap();
    let out = folder.join(format!("cameras_{frames}"));
    let options = SfmOptions { frames, program: Some(no_colmap(folder)), ..SfmOptions::default() };
    let source = Source::at(clip).unwrap().unwrap();
    let mut events = Vec::new();
    let frames = match find_cameras(&source, &out, &options, &mut |event| events.push(event)) {
        Err(SfmError::Failed { program: "colmap", .. }) => {
            let pictures = dvr_core::dataset::list_pictures(&out.join("work/frames")).unwrap();
            Ok(pictures.iter().map(|picture| read_rgb(picture).unwrap()).collect())
        }
        other => Err(other.unwrap_err()),
    };
    (frames, events)
}

#[test_with(ffmpeg)]
fn the_sharp_frames_of_a_clip_are_taken_evenly_and_always_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let clip = folder.path().join("clip.mp4");
    write_clip(&clip, |i| i % 5 == 3);
    let (frames, events) = frames_of(&clip, 12);
    let frames = frames.unwrap();
    assert_eq!(frames.len(), 12);
    assert!(events.contains(&Event::Step { name: "frames", parts: 12 }) && events.contains(&Event::Progress(12)));
    let range = |frame: &RgbImage| {
        let values = || frame.pixels().map(|pixel| pixel.0[0]);
        (values().min().unwrap(), values().max().unwrap())
    };
    for (i, frame) in frames.iter().enumerate() {
        let (low, high) = range(frame);
        assert!(high - low > 40, "frame {i} is one without stripes");
        let number = (f64::from(low) - 20.0) / 3.0;
        assert!((number - (5 * i + 3) as f64).abs() < 3.0, "frame {i} is number {number} of the clip");
    }
    std::fs::remove_dir_all(folder.path().join("cameras_12")).unwrap();
    assert_eq!(frames_of(&clip, 12).0.unwrap(), frames);
    // More than there are.
    let (all, events) = frames_of(&clip, 200);
    assert!((55..=60).contains(&all.unwrap().len()));
    assert!(events.iter().any(|event| matches!(event, Event::Note(note) if note.contains("fewer than the 200"))));
}

#[test_with(ffmpeg)]
fn a_corrupt_clip_is_refused_and_half_a_clip_gives_what_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let noise = folder.path().join("noise.mp4");
    std::fs::write(&noise, (0..50_000u32).map(|i| (i * i % 251) as u8).collect::<Vec<_>>()).unwrap();
    let error = frames_of(&noise, 10).0.unwrap_err().to_string();
    assert!(error.contains("noise.mp4: no frames can be read from the clip"), "{error}");
    assert!(!folder.path().join("cameras_10").exists(), "nothing half-written");
    let whole = folder.path().join("whole.avi");
    write_clip(&whole, |_| true);
    let bytes = std::fs::read(&whole).unwrap();
    let half = folder.path().join("half.avi");
    std::fs::write(&half, &bytes[..bytes.len() / 2]).unwrap();
    match frames_of(&half, 10).0 {
        Ok(frames) => assert!((3..=10).contains(&frames.len()), "{}", frames.len()),
        Err(error) => assert!(matches!(error, SfmError::BadClip { .. } | SfmError::TooFewPictures { .. }), "{error}"),
    }
    std::fs::write(&half, "").unwrap();
    assert!(matches!(frames_of(&half, 10).0, Err(SfmError::BadClip { .. })));
}

#[test_with(ffmpeg, colmap)]
fn a_walk_around_an_object_on_film_has_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let frames = folder.path().join("frames");
    std::fs::create_dir(&frames).unwrap();
    for (i, camera) in true_cameras(48).iter().step_by(2).enumerate() {
        write_jpeg(&frames.join(format!("{i:03}.jpg")), &photograph(camera), 97, None).unwrap();
    }
    let clip = folder.path().join("walk.mp4");
    encode(&frames, &clip, "6");
    let source = Source::at(&clip).unwrap().unwrap();
    let options =
        SfmOptions { frames: 18, program: Some(program("colmap")), threads: Some(2), ..SfmOptions::default() };
    let found = find_cameras(&source, &folder.path().join("walk-cameras"), &options, &mut |_| ()).unwrap();
    assert!(found.placed >= 16, "{found:?}");
}
