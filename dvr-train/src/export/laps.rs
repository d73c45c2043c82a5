//! How long what follows training takes, part by part.

use std::time::Instant;

use dvr_core::Cancellation;

use crate::error::Result;
use crate::observer::Observer;

/// Parts of the work that are told as they are done.
const PARTS: usize = 6;

/// The time of each part of the work.
pub(super) struct Laps<'o> {
    clock: Instant,
    /// Wall seconds of each part that is done.
    pub seconds: Vec<(String, f64)>,
    observer: &'o mut dyn Observer,
    cancellation: &'o Cancellation,
}

impl<'o> Laps<'o> {
    pub fn new(observer: &'o mut dyn Observer, cancellation: &'o Cancellation) -> Self {
        observer.phase("mesh, texture, preview and figures", PARTS);
        Self { clock: Instant::now(), seconds: Vec::new(), observer, cancellation }
    }

    /// A part is done: it took the time since the last.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] where somebody wants the work to end.
    pub fn done(&mut self, part: &str) -> Result<()> {
        let seconds = self.clock.elapsed().as_secs_f64();
        self.clock = Instant::now();
        self.meanwhile(part, seconds)
    }

    /// A part that took so long beside others is done.
    ///
    /// # Errors
    /// As [`Self::done`].
    pub fn meanwhile(&mut self, part: &str, seconds: f64) -> Result<()> {
        self.seconds.push((part.to_owned(), seconds));
        self.observer.progress(self.seconds.len(), part);
        Ok(self.cancellation.check()?)
    }
}
