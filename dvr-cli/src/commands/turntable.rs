//! The animation of an orbit: a GIF of frames as they are rendered, or a clip that ffmpeg makes of their files.

use std::io;
use std::path::Path;

use anyhow::{Result, bail};
use dvr_core::Cancellation;
use dvr_core::files::write_atomically;
use dvr_sfm::{ClipEncoder, ClipFormat};
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbImage};

use crate::args::{Animation, Cameras, RenderArgs};

/// Frames per second.
const FRAMES_PER_SECOND: u32 = 18;

/// The animation that is going to be made.
pub enum Turntable {
    /// None.
    None,
    /// `turntable.gif`.
    Gif,
    /// `turntable.mp4` or `turntable.webm`.
    Clip(ClipEncoder, &'static str),
}

impl Turntable {
    /// What the arguments ask for.
    ///
    /// # Errors
    /// When a clip is asked for and ffmpeg cannot make it, or there is no orbit.
    pub fn of(args: &RenderArgs, cancellation: &Cancellation) -> Result<Self> {
        let (format, name) = match args.animation {
            Animation::Gif if args.cameras == Cameras::Orbit => return Ok(Self::Gif),
            // It is the default, which nobody has to take back for other cameras.
            Animation::Gif | Animation::None => return Ok(Self::None),
            Animation::Mp4 => (ClipFormat::Mp4, "turntable.mp4"),
            Animation::Webm => (ClipFormat::Webm, "turntable.webm"),
        };
        if args.cameras != Cameras::Orbit {
            bail!("{name} shows a turn around the object: leave out --cameras, or take --animation none");
        }
        Ok(Self::Clip(ClipEncoder::find(format, cancellation)?, name))
    }

    /// Its name, where there is one.
    pub fn file(&self) -> Option<&'static str> {
        match self {
            Self::None => None,
            Self::Gif => Some("turntable.gif"),
            Self::Clip(_, name) => Some(name),
        }
    }

    /// Renders, and writes the animation into the folder of the frames; `render` writes their files and hands them on one
    /// by one. `pattern` is the name of these files as `printf` has it.
    ///
    /// # Errors
    /// Those of `render`, and when the animation cannot be written.
    pub fn write(
        &self,
        folder: &Path,
        pattern: &str,
        mut render: impl FnMut(&mut dyn FnMut(RgbImage) -> Result<()>) -> Result<()>,
    ) -> Result<()> {
        match self {
            Self::None => render(&mut |_| Ok(())),
            Self::Gif => write_gif(&folder.join("turntable.gif"), render),
            Self::Clip(encoder, name) => {
                render(&mut |_| Ok(()))?;
                Ok(encoder.encode(folder, pattern, FRAMES_PER_SECOND, &folder.join(name))?)
            }
        }
    }
}

/// Writes a GIF that repeats without end; none of the frames is kept.
fn write_gif(path: &Path, mut render: impl FnMut(&mut dyn FnMut(RgbImage) -> Result<()>) -> Result<()>) -> Result<()> {
    // What fails in a frame is no failure of this file.
    let mut failure = None;
    let written = write_atomically(path, |file| {
        let mut encoder = GifEncoder::new_with_speed(file, 10);
        encoder.set_repeat(Repeat::Infinite).map_err(io::Error::other)?;
        let rendered = render(&mut |frame| {
            let rgba = image::DynamicImage::ImageRgb8(frame).into_rgba8();
            let delay = Delay::from_numer_denom_ms(1000, FRAMES_PER_SECOND);
            Ok(encoder.encode_frame(Frame::from_parts(rgba, 0, 0, delay))?)
        });
        rendered.map_err(|error| {
            failure = Some(error);
            io::Error::other("a frame failed")
        })
    });
    match failure {
        Some(error) => Err(error),
        None => Ok(written?),
    }
}
