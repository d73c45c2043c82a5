//! Where the pixels of views go as they are decoded: into memory while the budget lasts, then into a scratch file.

use std::sync::{Mutex, PoisonError};

use crate::error::Result;
use crate::files::ScratchFile;
use crate::pixels::{PixelStore, with_pixels};
use crate::scene::View;

/// Takes views from many threads.
pub(super) struct Shelf {
    /// `None` where everything may stay in memory.
    bounded: Option<Mutex<Bounded>>,
}

struct Bounded {
    /// Bytes that may still stay in memory.
    left: u64,
    /// Made for the first view that may not.
    scratch: Option<ScratchFile>,
}

impl Shelf {
    /// A shelf that leaves so many bytes of colours and masks in memory; all of them with `None`.
    pub(super) fn new(max_memory: Option<u64>) -> Self {
        Self { bounded: max_memory.map(|left| Mutex::new(Bounded { left, scratch: None })) }
    }

    /// The same view, its pixels where there is room for them.
    ///
    /// # Errors
    /// [`Error::Format`](crate::Error::Format) where the scratch file cannot be made or written.
    pub(super) fn put(&self, view: View) -> Result<View> {
        match &self.bounded {
            None => Ok(view),
            // A thread that panicked here leaves a part of a view at the file's end at most, which nobody refers to.
            Some(bounded) => bounded.lock().unwrap_or_else(PoisonError::into_inner).put(view),
        }
    }
}

impl Bounded {
    fn put(&mut self, mut view: View) -> Result<View> {
        let (colors, coverage) = (view.image.as_raw(), view.mask.coverage.as_raw());
        if let Some(left) = self.left.checked_sub((colors.len() + coverage.len()) as u64) {
            self.left = left;
            return Ok(view);
        }
        let scratch = match &mut self.scratch {
            Some(scratch) => scratch,
            None => self.scratch.insert(ScratchFile::new()?),
        };
        let [colors, coverage] = scratch.keep([colors, coverage])?;
        let (width, height) = view.image.dimensions();
        view.image = with_pixels(width, height, PixelStore::Scratch(colors));
        view.mask.coverage = with_pixels(width, height, PixelStore::Scratch(coverage));
        Ok(view)
    }
}
