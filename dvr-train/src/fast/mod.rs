//! The fast method: a field on lattices, rays that meet it exactly, and gradients by hand.

mod clock;
mod config;
mod cpu;
#[cfg(feature = "gpu")]
mod device;
mod exact;
mod growth;
mod levels;
mod patch;
mod rays;
mod scatter;
mod start;
mod state;
mod stepper;
mod sweep;
mod trainer;
mod views;
mod wrong_masks;

pub use clock::{Part, PartTimes};
pub use config::{Capacity, DisagreeingViews, FastConfig, FastLosses};
pub use trainer::FastTrainer;
