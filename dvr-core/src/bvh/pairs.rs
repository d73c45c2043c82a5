//! Pairs of triangles whose boxes overlap.

use glam::Vec3;
use rayon::prelude::*;

use super::tree::{Bvh, STACK_SIZE};
use crate::cancellation::{Cancellation, Cancelled};

/// Triangles that are asked about between two looks at the token.
const CHUNK: usize = 1024;

impl Bvh {
    /// Counts the pairs of different faces that `meet`, of those whose boxes overlap; each pair is asked about once, the
    /// smaller index first. The order does not matter to the result, nor does the number of threads.
    ///
    /// # Errors
    /// [`Cancelled`] where the token says so.
    pub fn count_pairs(
        &self,
        meet: impl Fn(u32, u32) -> bool + Sync,
        cancellation: &Cancellation,
    ) -> Result<usize, Cancelled> {
        let all: Vec<usize> = (0..self.triangles.len()).collect();
        all.par_chunks(CHUNK)
            .map(|chunk| {
                cancellation.check()?;
                Ok(chunk.iter().map(|&i| self.partners(i, &meet)).sum::<usize>())
            })
            .sum()
    }

    /// The triangles after the one at place `i` of the leaves that meet it.
    fn partners(&self, i: usize, meet: &impl Fn(u32, u32) -> bool) -> usize {
        let bounds = |[a, b, c]: [Vec3; 3]| (a.min(b).min(c), a.max(b).max(c));
        let (low, high) = bounds(self.triangles[i]);
        let is_apart = |(a, b): (Vec3, Vec3)| a.cmpgt(high).any() || b.cmplt(low).any();
        let mut found = 0;
        let mut stack = [0u32; STACK_SIZE];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let node = &self.nodes[stack[height] as usize];
            if is_apart((node.low(), node.high())) {
                continue;
            }
            if node.count() == 0 {
                for child in [node.first() + 1, node.first()] {
                    stack[height] = child;
                    height += 1;
                }
                continue;
            }
            let places = node.first() as usize..(node.first() + node.count()) as usize;
            for j in places.filter(|&j| j > i && !is_apart(bounds(self.triangles[j]))) {
                let (a, b) = (self.faces[i], self.faces[j]);
                found += usize::from(meet(a.min(b), a.max(b)));
            }
        }
        found
    }
}
