//! Clips of pictures, by ffmpeg: MP4 (H.264) and WebM (VP9), as browsers play them.

use std::path::{Path, PathBuf};
use std::process::Command;

use dvr_core::Cancellation;
use dvr_core::files::fill_atomically;

use crate::child::{Heard, Log, Task, run};
use crate::engine::program;
use crate::error::{Result, SfmError};

/// The frame becomes even, as half the resolution of colours asks for, by white pixels to the right and below. sRGB
/// becomes YCbCr by BT.709, which is written into the file: a player that has to guess takes another matrix for small
/// pictures.
const FILTERS: &str = "pad=w=ceil(iw/2)*2:h=ceil(ih/2)*2:color=white,scale=out_color_matrix=bt709:out_range=tv,\
                       format=yuv420p";

/// What the filters make, as ffmpeg calls it.
const COLORS: [&str; 8] =
    ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1", "-color_range", "tv"];

/// A format of clips.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClipFormat {
    /// H.264 in MP4, whose index comes first, so that a page plays it while it loads.
    Mp4,
    /// VP9 in WebM.
    Webm,
}

impl ClipFormat {
    fn name(self) -> &'static str {
        match self {
            Self::Mp4 => "MP4",
            Self::Webm => "WebM",
        }
    }

    fn encoder(self) -> &'static str {
        match self {
            Self::Mp4 => "libx264",
            Self::Webm => "libvpx-vp9",
        }
    }

    /// Container and quality: losses that are not seen side by side with the frames.
    fn options(self) -> &'static [&'static str] {
        match self {
            Self::Mp4 => &["-crf", "18", "-movflags", "+faststart", "-f", "mp4"],
            Self::Webm => &["-crf", "24", "-b:v", "0", "-row-mt", "1", "-f", "webm"],
        }
    }
}

/// An ffmpeg that makes clips of one format.
#[derive(Clone, Debug)]
pub struct ClipEncoder {
    ffmpeg: PathBuf,
    format: ClipFormat,
    cancellation: Cancellation,
}

impl ClipEncoder {
    /// The ffmpeg of `PATH`, which is ended where `cancellation` says so.
    ///
    /// # Errors
    /// [`SfmError::NotInstalled`] without ffmpeg; [`SfmError::NoEncoder`] where it was built without the format's encoder.
    pub fn find(format: ClipFormat, cancellation: &Cancellation) -> Result<Self> {
        let missing = SfmError::NotInstalled { program: "ffmpeg", purpose: "makes MP4 and WebM clips" };
        let ffmpeg = program("ffmpeg").ok_or(missing)?;
        // It is started in another folder.
        let ffmpeg = std::path::absolute(&ffmpeg).map_err(|source| dvr_core::Error::io(ffmpeg, source))?;
        let encoder = format.encoder();
        let mut command = Command::new(&ffmpeg);
        command.args(["-hide_banner", "-nostdin", "-encoders"]);
        let mut is_there = false;
        let mut heard = |heard: Heard<'_>| {
            if let Heard::Line(line) = heard {
                is_there |= line.split_whitespace().nth(1) == Some(encoder);
            }
        };
        let task = Task { program: "ffmpeg", step: "listing its encoders", takes_bytes: false };
        run(&mut command, task, &mut Log::none(), cancellation, &mut heard)?;
        if !is_there {
            return Err(SfmError::NoEncoder { encoder, format: format.name() });
        }
        Ok(Self { ffmpeg, format, cancellation: cancellation.clone() })
    }

    /// Writes a clip of the pictures in a folder, in the order of their numbers, which begin at 0. `pattern` is their name
    /// with the place of the number as C's `printf` has it, as in `orbit_%04d.png`. A width or height that is odd grows by
    /// a white pixel. The clip appears whole or not at all.
    ///
    /// # Errors
    /// [`SfmError::Failed`] where ffmpeg does not come to a good end; [`SfmError::Core`] where the clip cannot be written.
    pub fn encode(&self, folder: &Path, pattern: &str, frames_per_second: u32, clip: &Path) -> Result<()> {
        // In the folder itself: its path may hold what ffmpeg takes for a pattern.
        let clip = std::path::absolute(clip).map_err(|source| dvr_core::Error::io(clip, source))?;
        fill_atomically(&clip, |temporary| {
            let mut command = Command::new(&self.ffmpeg);
            command.current_dir(folder).args(["-hide_banner", "-nostdin", "-v", "error", "-y"]);
            command.args(["-framerate", &frames_per_second.to_string(), "-start_number", "0", "-i", pattern]);
            command.args(["-an", "-vf", FILTERS, "-c:v", self.format.encoder()]).args(self.format.options());
            command.args(COLORS).arg(temporary);
            let task = Task { program: "ffmpeg", step: "encoding", takes_bytes: false };
            run(&mut command, task, &mut Log::none(), &self.cancellation, &mut |_| ())
        })
    }
}
