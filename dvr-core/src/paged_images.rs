//! Where the pixels of views go: into memory while the budget lasts, then into a scratch file.

use std::sync::{Mutex, PoisonError};

use crate::error::Result;
use crate::files::{ScratchBytes, ScratchFile};
use crate::pixels::{PixelStore, with_pixels};
use crate::raster::Mask;
use crate::scene::View;

/// Takes pictures from many threads.
pub(crate) struct PagedImages {
    /// `None` where everything may stay in memory.
    bounded: Option<Mutex<Bounded>>,
}

struct Bounded {
    /// Bytes that may still stay in memory.
    left: u64,
    /// Made for the first picture that may not.
    scratch: Option<ScratchFile>,
}

impl PagedImages {
    /// Leaves at most `max_memory` bytes of colours and masks in memory; all of them with `None`.
    pub(crate) fn new(max_memory: Option<u64>) -> Self {
        Self { bounded: max_memory.map(|left| Mutex::new(Bounded { left, scratch: None })) }
    }

    /// The same view, its colours and mask where there is room for them.
    ///
    /// # Errors
    /// [`Error::Scratch`](crate::Error::Scratch) where the scratch file cannot be made or written.
    pub(crate) fn keep_view(&self, view: View) -> Result<View> {
        self.keep(view, Bounded::keep_view)
    }

    /// The same mask, its coverage where there is room for it.
    ///
    /// # Errors
    /// As [`PagedImages::keep_view`].
    pub(crate) fn keep_mask(&self, mask: Mask) -> Result<Mask> {
        self.keep(mask, Bounded::keep_mask)
    }

    fn keep<T>(&self, item: T, keep: impl FnOnce(&mut Bounded, T) -> Result<T>) -> Result<T> {
        match &self.bounded {
            None => Ok(item),
            // A thread that panicked here leaves a part of a picture at the file's end at most, to which nothing refers.
            Some(bounded) => keep(&mut bounded.lock().unwrap_or_else(PoisonError::into_inner), item),
        }
    }
}

impl Bounded {
    fn keep_view(&mut self, mut view: View) -> Result<View> {
        let colors = view.image.as_raw();
        let coverage: &[u8] = view.mask.as_ref().map_or(&[], |mask| mask.coverage.as_raw());
        if self.fits(colors.len() + coverage.len()) {
            return Ok(view);
        }
        let [colors, coverage] = self.write([colors, coverage])?;
        let (width, height) = view.image.dimensions();
        view.image = with_pixels(width, height, PixelStore::Scratch(colors));
        if let Some(mask) = &mut view.mask {
            mask.coverage = with_pixels(width, height, PixelStore::Scratch(coverage));
        }
        Ok(view)
    }

    fn keep_mask(&mut self, mask: Mask) -> Result<Mask> {
        if self.fits(mask.coverage.as_raw().len()) {
            return Ok(mask);
        }
        let [coverage] = self.write([mask.coverage.as_raw()])?;
        let (width, height) = mask.size();
        Ok(Mask { coverage: with_pixels(width, height, PixelStore::Scratch(coverage)) })
    }

    /// Whether this many more bytes may stay in memory; if so, they are counted.
    fn fits(&mut self, bytes: usize) -> bool {
        let left = self.left.checked_sub(bytes as u64);
        self.left = left.unwrap_or(self.left);
        left.is_some()
    }

    /// Writes to the scratch file, which is made first where there is none.
    fn write<const N: usize>(&mut self, parts: [&[u8]; N]) -> Result<[ScratchBytes; N]> {
        let scratch = match &mut self.scratch {
            Some(scratch) => scratch,
            none => none.insert(ScratchFile::new()?),
        };
        scratch.keep(parts)
    }
}
