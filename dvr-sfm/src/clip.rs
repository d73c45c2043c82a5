//! Frames of a clip: sharp ones, evenly spread over its time.
//!
//! ffmpeg decodes several times as many frames as are wanted, evenly spread, and hands them on one by one; nothing but the
//! frames that are taken is written. Of each of as many equal stretches of time as there are frames wanted, the sharpest
//! is taken.

use std::path::Path;
use std::process::Command;

use dvr_core::files::limits::PICTURE_PIXELS;
use dvr_core::files::write_jpeg;
use dvr_core::{Cancellation, laplacian_variance};
use image::RgbImage;

use crate::child::{Heard, Log, Task, run};
use crate::engine::program;
use crate::error::{Result, SfmError};

/// Frames that are looked at for each that is taken.
const CANDIDATES: f64 = 5.0;

/// Quality of the frames: their own losses are larger.
const QUALITY: u8 = 95;

/// Sharpness is measured on means of 2x2 pixels, which hold less of the codec's noise.
const EDGE: u32 = 2;

/// Bytes of the head of a PPM picture, as ffmpeg writes it.
const HEAD_BYTES: usize = 64;

/// Writes the sharpest frames of a clip, `wanted` of them, as `frame_00001.jpg` and so on into `folder`; gives a note where
/// there are fewer.
///
/// # Errors
/// [`SfmError::NotInstalled`] without ffmpeg; [`SfmError::BadClip`] where it reads no frame.
pub(crate) fn take_frames(
    clip: &Path,
    wanted: usize,
    folder: &Path,
    log: &mut Log,
    cancellation: &Cancellation,
    progress: &mut dyn FnMut(usize),
) -> Result<Option<String>> {
    let missing = SfmError::NotInstalled { program: "ffmpeg", purpose: "takes frames from clips" };
    let ffmpeg = program("ffmpeg").ok_or(missing)?;
    let bad = |said: String| SfmError::BadClip { path: clip.to_owned(), said };
    let (seconds, frame_rate) = length_of(&ffmpeg, clip, log, cancellation)?;
    // A frame that is there twice says nothing new.
    let rate = (CANDIDATES * wanted as f64 / seconds).min(frame_rate);
    let candidates = (rate * seconds).floor().max(1.0);
    let windows = wanted.min(candidates as usize);

    let mut command = Command::new(&ffmpeg);
    command.args(["-hide_banner", "-nostdin", "-v", "error", "-i"]).arg(clip);
    command.args(["-an", "-sn", "-vf", &format!("fps={rate:.6}")]);
    command.args(["-f", "image2pipe", "-c:v", "ppm", "-pix_fmt", "rgb24", "-"]);
    let mut choice = Choice::new(windows, candidates, folder);
    let (mut stream, mut problem, mut said) = (PpmStream::default(), None, String::new());
    let mut heard = |heard: Heard<'_>| match heard {
        Heard::Bytes(bytes) if problem.is_none() => {
            let taken = stream.push(bytes, &mut |frame| {
                choice.offer(frame)?;
                progress(choice.window);
                Ok(())
            });
            problem = taken.err();
        }
        Heard::Line(line) if said.is_empty() => line.trim().clone_into(&mut said),
        _ => {}
    };
    let task = Task { program: "ffmpeg", step: "taking frames", takes_bytes: true };
    let ended = run(&mut command, task, log, cancellation, &mut heard);
    if let Some(problem) = problem {
        return Err(problem);
    }
    match ended {
        Err(SfmError::Failed { how, .. }) if choice.taken == 0 && choice.best.is_none() => {
            return Err(bad(if said.is_empty() { how } else { said }));
        }
        Err(SfmError::Cancelled(cancelled)) => return Err(cancelled.into()),
        _ => {}
    }
    let frames = choice.finish()?;
    progress(windows);
    if frames == 0 {
        return Err(bad(if said.is_empty() { "there are none".to_owned() } else { said }));
    }
    let note = (frames < wanted).then(|| match said.as_str() {
        "" => format!("the clip has {frames} different frames, fewer than the {wanted} that were asked for"),
        said => format!("{frames} of {wanted} frames could be taken from the clip, which is damaged ({said})"),
    });
    Ok(note)
}

/// Seconds and frames per second of a clip, as ffmpeg tells them of a file that it is to do nothing with.
fn length_of(ffmpeg: &Path, clip: &Path, log: &mut Log, cancellation: &Cancellation) -> Result<(f64, f64)> {
    let mut command = Command::new(ffmpeg);
    command.args(["-hide_banner", "-nostdin", "-i"]).arg(clip);
    let mut said = String::new();
    let mut heard = |heard: Heard<'_>| {
        if let Heard::Line(line) = heard {
            said += line;
            said.push('\n');
        }
    };
    let task = Task { program: "ffmpeg", step: "looking at the clip", takes_bytes: false };
    // It complains that there is nothing to be written, and fails.
    match run(&mut command, task, log, cancellation, &mut heard) {
        Err(SfmError::Failed { .. }) | Ok(()) => {}
        Err(error) => return Err(error),
    }
    parse_length(&said).ok_or_else(|| {
        let last = said.lines().rev().map(str::trim).find(|line| !line.is_empty() && !line.contains("output file"));
        SfmError::BadClip { path: clip.to_owned(), said: last.unwrap_or("ffmpeg says nothing of it").to_owned() }
    })
}

/// `Duration: 00:01:02.50` and the `29.97 fps` of the first video stream.
fn parse_length(said: &str) -> Option<(f64, f64)> {
    let duration = said.split_once("Duration: ")?.1.split(',').next()?;
    let parts: Vec<f64> = duration.trim().split(':').map(|part| part.parse().ok()).collect::<Option<_>>()?;
    let &[hours, minutes, seconds] = &parts[..] else { return None };
    let seconds = 3600.0 * hours + 60.0 * minutes + seconds;
    let video = said.lines().find(|line| line.contains("Video: "))?;
    let words: Vec<&str> = video.split([' ', ',']).filter(|word| !word.is_empty()).collect();
    let rate = words.windows(2).find(|pair| pair[1] == "fps" || pair[1] == "tbr").and_then(|pair| {
        let (number, factor) = pair[0].strip_suffix('k').map_or((pair[0], 1.0), |number| (number, 1000.0));
        number.parse::<f64>().ok().map(|number| factor * number)
    });
    let rate = rate.filter(|rate| *rate > 0.0).unwrap_or(25.0);
    (seconds > 0.0 && seconds.is_finite()).then_some((seconds, rate))
}

/// PPM pictures one after the other, in pieces of any length.
#[derive(Default)]
struct PpmStream {
    bytes: Vec<u8>,
}

impl PpmStream {
    fn push(&mut self, piece: &[u8], take: &mut dyn FnMut(RgbImage) -> Result<()>) -> Result<()> {
        self.bytes.extend_from_slice(piece);
        while let Some((head, width, height)) = head_of(&self.bytes) {
            let length = head + 3 * width as usize * height as usize;
            if self.bytes.len() < length {
                break;
            }
            let rest = self.bytes.split_off(length);
            let pixels = std::mem::replace(&mut self.bytes, rest).split_off(head);
            if let Some(frame) = RgbImage::from_vec(width, height, pixels) {
                take(frame)?;
            }
        }
        Ok(())
    }
}

/// The length of a head, and the width and height that it tells: `P6`, both, `255`.
fn head_of(bytes: &[u8]) -> Option<(usize, u32, u32)> {
    let mut words: Vec<&[u8]> = Vec::new();
    let mut start = 0;
    for (at, byte) in bytes.iter().take(HEAD_BYTES).enumerate() {
        if byte.is_ascii_whitespace() {
            words.push(&bytes[start..at]);
            start = at + 1;
            if let [magic, width, height, depth] = words[..] {
                let number = |word: &[u8]| std::str::from_utf8(word).ok()?.parse::<u32>().ok();
                let (width, height) = (number(width)?, number(height)?);
                let fits = u64::from(width) * u64::from(height) <= PICTURE_PIXELS && width > 0 && height > 0;
                return (magic == b"P6" && depth == b"255" && fits).then_some((start, width, height));
            }
        }
    }
    None
}

/// The sharpest frame of each window of time.
struct Choice<'a> {
    windows: usize,
    candidates: f64,
    folder: &'a Path,
    offered: usize,
    /// The window of the frame that was offered last.
    window: usize,
    best: Option<(f64, RgbImage)>,
    taken: usize,
}

impl<'a> Choice<'a> {
    fn new(windows: usize, candidates: f64, folder: &'a Path) -> Self {
        Self { windows, candidates, folder, offered: 0, window: 0, best: None, taken: 0 }
    }

    /// The next frame of the clip.
    fn offer(&mut self, frame: RgbImage) -> Result<()> {
        let window = (self.offered as f64 / self.candidates * self.windows as f64) as usize;
        let window = window.min(self.windows.saturating_sub(1));
        self.offered += 1;
        if window != self.window {
            self.take()?;
            self.window = window;
        }
        let sharpness = sharpness(&frame);
        // Of two that are alike, the first.
        if self.best.as_ref().is_none_or(|(best, _)| sharpness > *best) {
            self.best = Some((sharpness, frame));
        }
        Ok(())
    }

    /// Writes the best frame of the window.
    fn take(&mut self) -> Result<()> {
        let Some((_, frame)) = self.best.take() else { return Ok(()) };
        self.taken += 1;
        let path = self.folder.join(format!("frame_{:05}.jpg", self.window + 1));
        Ok(write_jpeg(&path, &frame, QUALITY, None)?)
    }

    /// How many were written.
    fn finish(mut self) -> Result<usize> {
        self.take()?;
        Ok(self.taken)
    }
}

/// Only frames of one clip can be compared.
fn sharpness(frame: &RgbImage) -> f64 {
    laplacian_variance(frame, EDGE)
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn ffmpeg_says_how_long_a_clip_is() {
        let said = "Input #0, mov,mp4, from 'a.mp4':\n  Duration: 00:01:02.50, start: 0.000000, bitrate: 8 kb/s\n  Stream \
                    #0:0(und): Video: h264 (High), yuv420p, 1920x1080, 8 kb/s, 29.97 fps, 29.97 tbr, 90k tbn\n";
        assert_eq!(parse_length(said), Some((62.5, 29.97)));
        assert_eq!(parse_length("Duration: N/A, start: 0\nVideo: h264, 25 fps"), None);
        assert_eq!(parse_length("a.mp4: Invalid data found when processing input"), None);
    }

    #[test]
    fn pictures_come_out_of_pieces_of_any_length() {
        let pictures: Vec<RgbImage> =
            (1..4).map(|n| RgbImage::from_fn(5 * n, 3, |u, v| Rgb([u as u8, v as u8, b'\n']))).collect();
        let bytes: Vec<u8> = pictures
            .iter()
            .flat_map(|p| {
                [format!("P6\n{} {}\n255\n", p.width(), p.height()).into_bytes(), p.as_raw().clone()].concat()
            })
            .collect();
        for length in [1, 7, 64, bytes.len()] {
            let (mut stream, mut found) = (PpmStream::default(), Vec::new());
            for piece in bytes.chunks(length) {
                let mut keep = |picture| {
                    found.push(picture);
                    Ok(())
                };
                stream.push(piece, &mut keep).unwrap();
            }
            assert_eq!(found, pictures);
        }
        for head in [&b"P6\n99999999 99999999\n255\n"[..], b"P5\n3 3\n255\n", b"P6\n-1 3\n255\n", &[b' '; 100]] {
            assert_eq!(head_of(head), None);
        }
    }

    /// A checkerboard, blurred by so many pixels.
    fn blurred(blur: u32) -> RgbImage {
        let board = RgbImage::from_fn(64, 48, |u, v| Rgb([if (u / 8 + v / 8) % 2 == 0 { 230 } else { 20 }; 3]));
        if blur == 0 { board } else { image::imageops::blur(&board, blur as f32) }
    }

    #[test]
    fn of_each_window_the_sharpest_frame_is_taken() {
        assert!(sharpness(&blurred(0)) > 2.0 * sharpness(&blurred(1)));
        assert!(sharpness(&blurred(1)) > 2.0 * sharpness(&blurred(3)));
        let folder = tempfile::tempdir().unwrap();
        let mut choice = Choice::new(3, 9.0, folder.path());
        // The sharp one is the second, the first and the last of its window; one frame comes too late.
        for blur in [2, 0, 2, 0, 3, 3, 4, 3, 2, 4] {
            choice.offer(blurred(blur)).unwrap();
        }
        assert_eq!(choice.finish().unwrap(), 3);
        let read = |n: usize| dvr_core::files::read_rgb(&folder.path().join(format!("frame_{n:05}.jpg"))).unwrap();
        let sharp: Vec<f64> = (1..=3).map(|n| sharpness(&read(n))).collect();
        assert!(sharp[0] > 2.0 * sharp[2] && (sharp[0] / sharp[1] - 1.0).abs() < 0.1, "{sharp:?}");
        assert!((sharp[2] / sharpness(&blurred(2)) - 1.0).abs() < 0.3, "{sharp:?}");
    }
}
