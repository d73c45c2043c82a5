//! How much memory the photographs of a scene take, and how they are made to take less.

use crate::error::Result;
use crate::paged_images::PagedImages;
use crate::scene::{Scene, View};

/// Bytes of the pixels of a view that are in memory and could be in a scratch file.
fn in_memory(view: &View) -> u64 {
    let masks = [&view.mask, &view.refined_mask].into_iter().flatten().map(|mask| mask.coverage.as_raw());
    let masks = masks.filter(|store| !store.is_paged()).map(|store| store.len());
    let image = view.image.as_raw();
    (masks.sum::<usize>() + if image.is_paged() { 0 } else { image.len() }) as u64
}

impl Scene {
    /// Bytes of photographs and masks that are in memory.
    pub fn photograph_bytes(&self) -> u64 {
        self.views.iter().map(in_memory).sum()
    }

    /// Leaves at most this many bytes of photographs and masks in memory, and puts the others into a scratch file. What is
    /// computed is the same.
    ///
    /// # Errors
    /// [`Error::Scratch`](crate::Error::Scratch) where the temporary folder has no room for the scratch file.
    pub fn keep_in_memory(&mut self, bytes: u64) -> Result<()> {
        let paged = PagedImages::new(Some(bytes));
        for view in &mut self.views {
            if in_memory(view) == 0 {
                continue;
            }
            *view = paged.keep_view(view.clone())?;
            view.refined_mask = view.refined_mask.take().map(|mask| paged.keep_mask(mask)).transpose()?;
        }
        Ok(())
    }
}
