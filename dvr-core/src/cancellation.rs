//! Stopping early: the token that long work asks whether it is still wanted.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Whether somebody wants the work to end. Clones are one token.
///
/// Long loops ask [`Cancellation::check`] and hand its error on with `?`, so that everything on the way is cleared up.
/// Work that saves something when it is cancelled holds a [`Shield`] meanwhile: a program that ends itself after a
/// second without an answer waits for as long as there is one.
#[derive(Clone, Debug, Default)]
pub struct Cancellation(Arc<State>);

#[derive(Debug, Default)]
struct State {
    cancelled: AtomicBool,
    shields: AtomicUsize,
}

impl Cancellation {
    /// Asks all who have the token to end; returns whether nobody had asked before.
    pub fn cancel(&self) -> bool {
        !self.0.cancelled.swap(true, Ordering::Relaxed)
    }

    /// Whether somebody wants the work to end.
    pub fn is_cancelled(&self) -> bool {
        self.0.cancelled.load(Ordering::Relaxed)
    }

    /// # Errors
    /// [`Cancelled`] where somebody wants the work to end.
    pub fn check(&self) -> Result<(), Cancelled> {
        if self.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    }

    /// From now until it is dropped, there is something that will be saved before the work ends.
    #[must_use]
    pub fn shield(&self) -> Shield {
        self.0.shields.fetch_add(1, Ordering::AcqRel);
        Shield(self.0.clone())
    }

    /// Whether something will be saved before the work ends.
    pub fn is_shielded(&self) -> bool {
        self.0.shields.load(Ordering::Acquire) > 0
    }
}

/// Options that differ in their token alone ask for the same work.
impl PartialEq for Cancellation {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// See [`Cancellation::shield`].
#[derive(Debug)]
pub struct Shield(Arc<State>);

impl Drop for Shield {
    fn drop(&mut self) {
        self.0.shields.fetch_sub(1, Ordering::AcqRel);
    }
}

/// The work was not wanted any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped before the end")]
pub struct Cancelled;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_clone_hears_of_it_and_the_second_call_knows_that_it_is_one() {
        let token = Cancellation::default();
        let clone = token.clone();
        assert_eq!(clone.check(), Ok(()));
        assert_eq!((token.cancel(), token.cancel()), (true, false));
        assert_eq!(clone.check(), Err(Cancelled));
    }

    #[test]
    fn a_token_is_shielded_while_any_shield_lives() {
        let token = Cancellation::default();
        let (first, second) = (token.shield(), token.clone().shield());
        drop(first);
        assert!(token.is_shielded());
        drop(second);
        assert!(!token.is_shielded());
    }
}
