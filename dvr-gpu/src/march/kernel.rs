//! The march itself: each group of units takes some rays, and keeps a few of them in flight.
//!
//! A ray in flight is either still looking for the first sample inside, or narrowing its bracket; each round asks the
//! field at one point of each. Rays that are done make room for the next at once, so that no unit waits for the
//! longest.

#![allow(missing_docs)]

use cubecl::prelude::*;

use super::network::{RAY_COLUMNS, Tile, evaluate};
use super::plan::{DecoderShape, Search};
use super::root_search::RootSearch;

/// Columns of what is found: status, depth of the crossing, depth of the largest logit.
pub(super) const FOUND_COLUMNS: usize = 3;

/// Ray statuses as numbers.
const MISSES: f32 = 0.0;
const HITS: f32 = 1.0;
const STARTS_INSIDE: f32 = 2.0;

/// Below every logit.
const NOTHING: f32 = -3.0e38;

/// Marches `rays [count, 10]` into `found [count, 3]`.
#[cube(launch)]
pub(super) fn march_decoder(
    rays: &[f32],
    weights: &[f32],
    conditions: &[f32],
    found: &mut [f32],
    count: u32,
    rays_a_cube: u32,
    steps: u32,
    objects: u32,
    leak: f32,
    #[comptime] shape: DecoderShape,
    #[comptime] search: Search,
) {
    let slots = comptime!(shape.slots);
    let slot = UNIT_POS as usize;
    let first = CUBE_POS as u32 * rays_a_cube;
    let end = min(first + rays_a_cube, count);
    let mut tile = Tile::new(shape);
    let mut busy = Shared::<[u32]>::new_slice(slots);
    let mut in_flight = Shared::<[u32]>::new_slice(1usize);

    // What the unit of a slot knows of its ray; the other units have none.
    let mut ray = select(slot < slots, first + slot as u32, end);
    let mut sample = 0u32;
    let mut taken = 0u32;
    let mut narrowing = false;
    let mut last = 0.0f32;
    let mut max_logit = f32::new(NOTHING);
    let mut max_logit_depth = 0.0f32;
    let root_search = RootSearch::new();

    let mut going = 1u32;
    while going > 0u32 {
        if slot < slots {
            // Rays that miss the cube are done before they start.
            while ray < end && rays[ray as usize * RAY_COLUMNS + 7] < rays[ray as usize * RAY_COLUMNS + 6] {
                let entry = rays[ray as usize * RAY_COLUMNS + 6];
                write_found(found, ray, f32::new(MISSES), entry, entry);
                ray += slots as u32;
            }
            busy[slot] = select(ray < end, 1u32, 0u32);
            if ray < end {
                let at = ray as usize * RAY_COLUMNS;
                let depth = if narrowing { root_search.next() } else { depth_of(rays, at, sample, steps, search) };
                #[unroll]
                for axis in 0..3usize {
                    tile.points[axis * slots + slot] = rays[at + axis] + rays[at + 3 + axis] * depth;
                }
                tile.objects[slot] = u32::cast_from(rays[at + 9]);
            } else {
                #[unroll]
                for axis in 0..3usize {
                    tile.points[axis * slots + slot] = 0.0f32;
                }
                tile.objects[slot] = 0u32;
            }
        }
        sync_cube();
        if UNIT_POS == 0 {
            let mut sum = 0u32;
            for s in 0..slots {
                sum += busy[s];
            }
            in_flight[0] = sum;
        }
        going = workgroup_uniform_load(&in_flight[0]);
        if going > 0u32 {
            evaluate(&mut tile, weights, conditions, objects, leak, shape);
            if slot < slots && ray < end {
                let at = ray as usize * RAY_COLUMNS;
                let logit = tile.logits[slot];
                let mut status = f32::new(-1.0);
                let mut depth = 0.0f32;
                if narrowing {
                    root_search.narrow(logit, comptime!(search.root));
                    taken += 1u32;
                } else {
                    depth = depth_of(rays, at, sample, steps, search);
                    if logit > max_logit {
                        max_logit = logit;
                        max_logit_depth = depth;
                    }
                    // A logit of exactly 0 is on the surface, hence inside; NaN is outside.
                    if logit >= 0.0f32 {
                        if sample == 0u32 {
                            status = f32::new(STARTS_INSIDE);
                        } else {
                            let before = depth_of(rays, at, sample - 1u32, steps, search);
                            root_search.begin(before, last, depth, logit, comptime!(search.root));
                            narrowing = true;
                        }
                    } else {
                        last = logit;
                        sample += 1u32;
                        if sample == steps {
                            status = f32::new(MISSES);
                        }
                    }
                }
                if narrowing && taken == comptime!(search.root_steps) {
                    status = f32::new(HITS);
                    depth = root_search.best(comptime!(search.root));
                }
                if status >= 0.0f32 {
                    write_found(found, ray, status, depth, max_logit_depth);
                    ray += slots as u32;
                    sample = 0u32;
                    taken = 0u32;
                    narrowing = false;
                    max_logit = f32::new(NOTHING);
                }
            }
        }
    }
}

/// Depth of a sample of the ray whose numbers begin at `at`.
#[cube]
fn depth_of(rays: &[f32], at: usize, sample: u32, steps: u32, #[comptime] search: Search) -> f32 {
    let share = if comptime!(search.jittered) {
        (f32::cast_from(sample) + rays[at + 8]) / f32::cast_from(steps)
    } else {
        f32::cast_from(sample) / f32::cast_from(steps - 1u32)
    };
    rays[at + 6] + (rays[at + 7] - rays[at + 6]) * share
}

/// Writes down what became of a ray.
#[cube]
fn write_found(found: &mut [f32], ray: u32, status: f32, depth: f32, max_logit_depth: f32) {
    let at = ray as usize * FOUND_COLUMNS;
    found[at] = status;
    found[at + 1] = depth;
    found[at + 2] = max_logit_depth;
}
