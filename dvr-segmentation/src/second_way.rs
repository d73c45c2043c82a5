//! Object and background learned together, beside the masks that were found from all views.

use dvr_core::{Cancellation, Cancelled, Mask, View};

use crate::all_views::of_all_views;
use crate::evidence::Evidence;
use crate::merge::merged;
use crate::radiance::{Fit, LEVELS, LearnedMasks};
use crate::shrunk::Shrunk;
use crate::two_ways::{Nearer, TwoWays, nearer, overlap};

/// Mean overlap (intersection over union) with the masks found before, after each level, from which those learned are believed
/// unless the support plane speaks against them: two ways that have little in common do not find the same by chance. Below it
/// they are believed only where the plane speaks for them.
const ALIKE: [f64; LEVELS.len()] = [0.88, 0.93, 0.94];

/// What is learned, and of what.
pub(crate) struct SecondWay<'a> {
    pub views: &'a [View],
    pub small: &'a [Shrunk],
    pub asked: &'a [bool],
    pub evidence: &'a Evidence,
    pub cancellation: &'a Cancellation,
    /// Is told how much of the work is done, in parts.
    pub advance: &'a (dyn Fn(usize) + Sync),
}

/// Which masks are right, where some were found before.
pub(crate) enum Believed {
    /// Those.
    First,
    /// Those, and where they differ by more than a rim what was learned.
    Both(Vec<Mask>),
    /// Those learned: the support plane shows that the others are wrong.
    Second(Vec<Mask>),
}

impl SecondWay<'_> {
    /// Masks by what is learned alone; `None` where that is nothing.
    pub fn alone(&self) -> Result<Option<Vec<Mask>>, Cancelled> {
        let mut fit = self.fit();
        for _ in LEVELS {
            self.learn(&mut fit)?;
        }
        let Some(learned) = self.masks(&fit)? else { return Ok(None) };
        self.drawn(|i| learned.mask(&self.views[i])).map(Some)
    }

    /// What to believe beside masks that were found before. Where these stay, that mostly shows after the first level.
    pub fn beside(&self, first: &[Mask]) -> Result<Believed, Cancelled> {
        let mut fit = self.fit();
        for (level, alike) in ALIKE.into_iter().enumerate() {
            self.learn(&mut fit)?;
            let Some(learned) = self.masks(&fit)? else { break };
            let ways = learned.beside(first);
            let (is_alike, is_last) = (overlap(&ways) >= alike, level + 1 == ALIKE.len());
            // What is learned first is too coarse to be refuted.
            if is_alike && !is_last {
                continue;
            }
            let mask = |i: usize| learned.mask(&self.views[i]);
            match (self.nearer(&ways)?, is_alike) {
                (Nearer::First, _) | (Nearer::Unknown, false) => break,
                (_, true) => return self.drawn(|i| merged(&first[i], &mask(i))).map(Believed::Both),
                (Nearer::Second, false) if is_last => return self.drawn(mask).map(Believed::Second),
                (Nearer::Second, false) => {}
            }
        }
        Ok(Believed::First)
    }

    fn fit(&self) -> Fit<'_> {
        let used = self.small.iter().zip(self.asked).filter_map(|(view, asked)| asked.then_some(view)).collect();
        Fit::new(used, &self.evidence.stands_still)
    }

    fn learn(&self, fit: &mut Fit) -> Result<(), Cancelled> {
        fit.learn(self.cancellation)?;
        (self.advance)(2 * self.views.len());
        Ok(())
    }

    fn masks<'b>(&self, fit: &'b Fit) -> Result<Option<LearnedMasks<'b>>, Cancelled> {
        LearnedMasks::new(fit, self.views, self.asked, self.evidence.support, self.cancellation)
    }

    fn nearer(&self, ways: &[TwoWays]) -> Result<Nearer, Cancelled> {
        self.evidence.support.map_or(Ok(Nearer::Unknown), |plane| nearer(ways, plane, self.cancellation))
    }

    fn drawn(&self, mask: impl Fn(usize) -> Mask + Sync) -> Result<Vec<Mask>, Cancelled> {
        of_all_views(self.views.len(), self.cancellation, self.advance, mask)
    }
}
