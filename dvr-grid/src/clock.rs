//! Where the time of a step goes.

use std::time::{Duration, Instant};

/// The parts of a step, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Rays meet the surface, and are compared with their pixels and with other views.
    Rays,
    /// Ray gradients are added up at the nodes.
    Gather,
    /// The smoothness: its value and its gradient.
    LaplacianSmoothness,
    /// Gradients go to all levels, Adam moves them, and they are summed again.
    MultiResGrid,
    /// What rays need to skip cells without a surface is brought up to date.
    OccupancyBitmask,
}

impl Part {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Rays, Self::Gather, Self::LaplacianSmoothness, Self::MultiResGrid, Self::OccupancyBitmask];
}

/// Wall time of each part, summed over steps. On a GPU, which does not tell them apart, all is counted
/// as [`Part::Rays`].
#[derive(Clone, Copy, Debug, Default)]
pub struct PartTimes {
    totals: [Duration; Part::ALL.len()],
}

impl PartTimes {
    /// Wall time of a part so far.
    pub fn of(&self, part: Part) -> Duration {
        self.totals[part as usize]
    }

    /// Adds the time since `start` to a part, and starts the next one.
    pub(crate) fn lap(&mut self, part: Part, start: &mut Instant) {
        let now = Instant::now();
        self.totals[part as usize] += now - std::mem::replace(start, now);
    }
}
