//! Batches are drawn on threads of their own, a few steps ahead of training.
//!
//! Thread `i` of `n` draws the batches `i, i + n, i + 2n, ...` into a channel of its own, and training takes from the
//! channels in turn: the order is that of the steps, whatever the timing. A channel holds one batch, and a thread one
//! more that it has just drawn: memory is bounded by `2 n` batches.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{JoinHandle, available_parallelism};

use crate::error::{Error, Result};

/// The most threads that draw batches: decoding is cheap beside a step.
const MAX_THREADS: usize = 4;

/// The threads, and the batches that they have drawn.
pub(crate) struct Loader<B> {
    channels: Vec<Receiver<Result<B>>>,
    threads: Vec<JoinHandle<()>>,
    /// The step whose batch is next.
    next: usize,
    first: usize,
}

impl<B: Send + 'static> Loader<B> {
    /// Starts to draw the batches from step `first` on, counted from 1. `draw` makes the batch of a step.
    pub fn start(draw: impl Fn(usize) -> Result<B> + Send + Sync + 'static, first: usize) -> Self {
        let draw = Arc::new(draw);
        let count = available_parallelism().map_or(1, |cores| cores.get().div_ceil(2)).min(MAX_THREADS);
        let (mut channels, mut threads) = (Vec::new(), Vec::new());
        for thread in 0..count {
            let (sender, receiver) = sync_channel(1);
            let draw = draw.clone();
            threads.push(std::thread::spawn(move || draw_on(draw.as_ref(), first + thread, count, &sender)));
            channels.push(receiver);
        }
        Self { channels, threads, next: first, first }
    }

    /// The batch of the next step.
    ///
    /// # Errors
    /// Those of drawing it.
    pub fn next_batch(&mut self) -> Result<B> {
        let channel = &self.channels[(self.next - self.first) % self.channels.len()];
        self.next += 1;
        channel.recv().unwrap_or(Err(Error::LoaderEnded))
    }
}

/// Draws every `count`-th batch until nobody listens any more.
fn draw_on<B>(draw: &dyn Fn(usize) -> Result<B>, first: usize, count: usize, sender: &SyncSender<Result<B>>) {
    for step in (first..).step_by(count) {
        let batch = draw(step);
        let failed = batch.is_err();
        if sender.send(batch).is_err() || failed {
            return;
        }
    }
}

impl<B> Drop for Loader<B> {
    fn drop(&mut self) {
        // A thread that waits to hand over a batch learns by this that nobody takes it.
        self.channels.clear();
        for thread in self.threads.drain(..) {
            // A panic over there was said there; what is dropped here has no use for it.
            let _ = thread.join();
        }
    }
}
