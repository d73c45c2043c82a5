//! How deep pixels see into the visual hull, as a kernel: the counterpart of [`super::super::plane_sweep`].

#![allow(missing_docs)]

use burn::tensor::Device;
use cubecl::prelude::*;
use dvr_gpu::Buffers;

use super::super::plane_sweep::{
    ALIKE, HALF, LEAD, LOOKED_IN, MIN_VARIANCE, PlaneSweep, SAMPLES, Shrunk, SweptPixel, VALUES,
};
use crate::error::Result;
use crate::gpu::launch::{NONE, groups, units};
use crate::gpu::views::{Photo, ViewRecord, photo, table};
use crate::gpu::voxel::{Grid, Point, grid, lerp};

/// Words of a pixel that is looked at: view, column, row.
const PICK: usize = 3;

/// Numbers of what is found: where the ray enters the hull, and the depth of what the pixel shows; below zero for none.
const FOUND: usize = 2;

/// A candidate of depth beside the best.
const BESIDE: usize = 2;

/// The pixels of every view whose rays enter the hull; see [`PlaneSweep::depths`].
///
/// # Errors
/// When the device is no GPU, has no room, or fails.
pub(in super::super) fn depths(
    device: &Device,
    sweep: &PlaneSweep,
    hull: &[f32],
    stride: usize,
) -> Result<Vec<Vec<SweptPixel>>> {
    let buffers = Buffers::on(device)?;
    let pixels: Vec<Vec<[usize; 2]>> =
        (0..sweep.views.len()).map(|view| sweep.pixels(view, stride).collect()).collect();
    let picks: Vec<u32> = (pixels.iter().enumerate())
        .flat_map(|(view, pixels)| pixels.iter().flat_map(move |&[x, y]| [view, x, y].map(|word| word as u32)))
        .collect();
    let record = |(view, picture): (usize, &Shrunk)| {
        let Shrunk { width, height, factor, .. } = *picture;
        let camera = sweep.views[view].camera.shrunk(factor);
        ViewRecord::of_camera(&camera, [width, height].map(|side| side as u32))
    };
    let views = table(&buffers, sweep.pictures.iter().enumerate().map(record).collect())?;
    let colors = sweep.pictures.iter().flat_map(|picture| &picture.colors);
    let colors = colors.flat_map(|color| if color.is_nan() { [-1.0; 3] } else { color.to_array() }).collect();
    let neighbours = sweep.views.iter().flat_map(|view| {
        let others = view.neighbours.iter().copied().take(LOOKED_IN);
        others.chain(std::iter::repeat(NONE)).take(LOOKED_IN)
    });
    let count = picks.len() / PICK;
    let found = buffers.zero_floats("depths of pixels", FOUND * count)?;
    look::launch(
        &buffers.client,
        groups(&buffers.client, count),
        units(),
        buffers.words("pixels to look at", picks)?.into_buffer_arg(),
        views.into_buffer_arg(),
        buffers.floats("shrunk photographs", colors)?.into_buffer_arg(),
        buffers.words("neighbours", neighbours.collect())?.into_buffer_arg(),
        buffers.floats("the hull", hull.to_vec())?.into_buffer_arg(),
        found.clone().into_buffer_arg(),
        sweep.grid.nodes() as u32,
        sweep.grid.half_extent(),
        count as u32,
        sweep.steps(),
    );
    let words = buffers.read(&[&found])?.remove(0);
    let mut words = words.as_chunks::<FOUND>().0.iter();
    let of_view = |(view, pixels): (usize, Vec<[usize; 2]>)| {
        let picture = &sweep.pictures[view];
        let swept = pixels.into_iter().zip(&mut words).filter_map(|([x, y], found)| {
            let [near, depth] = found.map(f32::from_bits);
            let direction = sweep.views[view].camera.direction_through(picture.middle(x, y));
            (near > 0.0).then(|| SweptPixel { direction, near, depth: (depth > 0.0).then_some(depth) })
        });
        swept.collect()
    };
    Ok(pixels.into_iter().enumerate().map(of_view).collect())
}

/// Whether a pixel of the table shows the object.
#[cube]
fn shows(colors: &[f32], at: usize) -> bool {
    colors[3 * at] >= 0.0f32
}

/// Writes the colours around a pixel, less the mean of each channel, to `patch`; returns their variance, below zero where not
/// all of it is object.
#[cube]
fn patch_at(photo: &Photo, colors: &[f32], u: u32, v: u32, patch: &mut Array<f32>) -> f32 {
    let half = comptime!(HALF as u32);
    let mut variance = f32::new(-1.0);
    if u >= half && v >= half && u + half < photo.width && v + half < photo.height {
        let mut all = true;
        #[unroll]
        for i in 0..SAMPLES {
            let (dx, dy) = comptime!((i % (2 * HALF + 1), i / (2 * HALF + 1)));
            let at = photo.index(u + comptime!(dx as u32) - half, v + comptime!(dy as u32) - half);
            all = all && shows(colors, at);
            #[unroll]
            for channel in 0..3usize {
                patch[comptime!(3 * i + channel)] = colors[3 * at + channel];
            }
        }
        if all {
            variance = centered(patch);
        }
    }
    variance
}

/// Takes the mean of each channel off a patch; its variance.
#[cube]
fn centered(patch: &mut Array<f32>) -> f32 {
    let mut squares = 0.0f32;
    #[unroll]
    for channel in 0..3usize {
        let mut mean = 0.0f32;
        #[unroll]
        for i in 0..SAMPLES {
            mean += patch[comptime!(3 * i + channel)];
        }
        mean /= comptime!(SAMPLES as f32);
        #[unroll]
        for i in 0..SAMPLES {
            let value = patch[comptime!(3 * i + channel)] - mean;
            patch[comptime!(3 * i + channel)] = value;
            squares += value * value;
        }
    }
    squares / comptime!(VALUES as f32)
}

/// Writes what a view shows where a ray from `origin` along the directions through a patch reaches a depth, less the mean of each
/// channel, to `patch`; returns the variance, below zero where not all of it is object.
#[cube]
fn seen_at(
    own: &Photo,
    other: &Photo,
    views: &[u32],
    colors: &[f32],
    u: u32,
    v: u32,
    depth: f32,
    patch: &mut Array<f32>,
) -> f32 {
    let half = comptime!(HALF as u32);
    let origin = own.center(views);
    let mut all = true;
    #[unroll]
    for i in 0..SAMPLES {
        let (dx, dy) = comptime!((i % (2 * HALF + 1), i / (2 * HALF + 1)));
        if all {
            let direction = own.direction(views, u + comptime!(dx as u32) - half, v + comptime!(dy as u32) - half);
            let q = other.projected(views, &origin.along(&direction, depth));
            let (x, y) = (q.x / q.z - 0.5f32, q.y / q.z - 0.5f32);
            let within = x >= 0.0f32
                && y >= 0.0f32
                && x < f32::cast_from(other.width) - 1.0f32
                && y < f32::cast_from(other.height) - 1.0f32;
            all = within;
            if within {
                let (left, top) = (u32::cast_from(x), u32::cast_from(y));
                let (s, t) = (x - f32::cast_from(left), y - f32::cast_from(top));
                let (a, b) = (other.index(left, top), other.index(left + 1u32, top));
                let (c, d) = (other.index(left, top + 1u32), other.index(left + 1u32, top + 1u32));
                all = shows(colors, a) && shows(colors, b) && shows(colors, c) && shows(colors, d);
                #[unroll]
                for channel in 0..3usize {
                    let above = lerp(colors[3 * a + channel], colors[3 * b + channel], s);
                    let below = lerp(colors[3 * c + channel], colors[3 * d + channel], s);
                    patch[comptime!(3 * i + channel)] = lerp(above, below, t);
                }
            }
        }
    }
    let mut variance = f32::new(-1.0);
    if all {
        variance = centered(patch);
    }
    variance
}

/// Whether the point at a depth of a ray lies in the hull.
#[cube]
fn is_inside(values: &[f32], grid: &Grid, origin: &Point, direction: &Point, depth: f32) -> bool {
    let point = origin.along(direction, depth);
    let farthest = point.x.abs().max(point.y.abs()).max(point.z.abs());
    depth > 0.0f32 && farthest < grid.half_extent && grid.slope(values, &point).value > 0.0f32
}

/// Looks at `count` pixels, a work-item each. `steps` candidates of depth lie between the corners of the cube.
#[cube(launch)]
fn look(
    picks: &[u32],
    views: &[u32],
    colors: &[f32],
    neighbours: &[u32],
    values: &[f32],
    found: &mut [f32],
    nodes: u32,
    half_extent: f32,
    count: u32,
    #[comptime] steps: usize,
) {
    let pick = ABSOLUTE_POS;
    if pick < count as usize {
        let view = picks[pick * comptime!(PICK)];
        let (u, v) = (picks[pick * comptime!(PICK) + 1], picks[pick * comptime!(PICK) + 2]);
        let grid = grid(nodes, half_extent);
        let step = 0.5f32 * grid.spacing;
        let own = photo(views, view);
        let (origin, direction) = (own.center(views), own.direction(views, u, v));
        let length = direction.length();
        let reach = half_extent * comptime!(3f32.sqrt());
        let from = -origin.dot(&direction) / (length * length) - reach / length;

        // Where the ray enters the hull, and leaves it again.
        let mut enters = 0usize;
        while enters < steps
            && !is_inside(values, &grid, &origin, &direction, from + f32::cast_from(enters as u32) * step)
        {
            enters += 1;
        }
        let mut leaves = enters;
        while leaves < steps
            && is_inside(values, &grid, &origin, &direction, from + f32::cast_from(leaves as u32) * step)
        {
            leaves += 1;
        }
        let near = from + f32::cast_from(enters as u32) * step;
        let mut depth = f32::new(-1.0);
        let mut patch = Array::<f32>::new(VALUES);
        let mut seen = Array::<f32>::new(VALUES);
        let mut likeness = Array::<f32>::new(comptime!(steps + 1));
        let mut variance = f32::new(-1.0);
        if enters < steps {
            variance = patch_at(&own, colors, u, v, &mut patch);
        }
        if variance > MIN_VARIANCE {
            let far = from + f32::cast_from(leaves as u32) * step;
            let candidates = min(u32::cast_from((far - near) / step) as usize + 1, comptime!(steps + 1));
            let mut best = 0usize;
            for k in 0..candidates {
                let at = near + f32::cast_from(k as u32) * step;
                let mut first = f32::new(-1.0);
                let mut second = f32::new(-1.0);
                for i in 0..LOOKED_IN {
                    let other = neighbours[view as usize * LOOKED_IN + i];
                    if other != NONE {
                        let other = photo(views, other);
                        let variance_seen = seen_at(&own, &other, views, colors, u, v, at, &mut seen);
                        if variance_seen >= 0.0f32 {
                            let mut product = 0.0f32;
                            #[unroll]
                            for j in 0..VALUES {
                                product += patch[j] * seen[j];
                            }
                            let scale = (variance * variance_seen).sqrt().max(1e-9f32);
                            let alike = product / comptime!(VALUES as f32) / scale;
                            second = second.max(first.min(alike));
                            first = first.max(alike);
                        }
                    }
                }
                likeness[k] = select(second > -1.0f32, 0.5f32 * (first + second), f32::new(-1.0));
                if likeness[k] >= likeness[best] {
                    best = k;
                }
            }
            let mut rival = f32::new(-1.0);
            for k in 0..candidates {
                if k + comptime!(BESIDE) < best || k > best + comptime!(BESIDE) {
                    rival = rival.max(likeness[k]);
                }
            }
            if likeness[best] > ALIKE && likeness[best] > rival + LEAD {
                depth = near + f32::cast_from(best as u32) * step;
            }
        }
        found[pick * comptime!(FOUND)] = select(enters < steps, near, f32::new(-1.0));
        found[pick * comptime!(FOUND) + 1] = depth;
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::hull::{MaskDistance, hull_distance};
    use dvr_core::voxel::VoxelGrid;
    use dvr_core::{Cancellation, View};
    use dvr_test_support::test_with;

    use super::*;
    use crate::accelerator::Accelerator;
    use crate::step::suite::speckled_arc;
    use crate::views::TrainingView;

    #[test_with(gpu)]
    fn pixels_see_as_deep_as_on_the_cpu_but_for_rounding() {
        let gpu = dvr_test_support::gpu(dvr_gpu::open(0)).device;
        let views = speckled_arc(10);
        let masks: Vec<MaskDistance> = (views.iter().filter_map(|view| view.training_pair()))
            .map(|(camera, mask)| MaskDistance::new(camera, mask))
            .collect();
        let grid = VoxelGrid::new(33, 0.55);
        let hull: Vec<f32> = (0..grid.len()).map(|node| hull_distance(&masks, grid.position(node), 0.1, 4)).collect();
        let views: Vec<&View> = views.iter().collect();
        let views = TrainingView::pack(&views, 6, 1);
        let cancellation = Cancellation::default();
        let sweep = PlaneSweep::new(&views, &grid, &cancellation);
        let [mut of_gpu, mut of_cpu] = [Accelerator::emulated(&gpu), Accelerator::default()];
        let found = [&mut of_gpu, &mut of_cpu].map(|accelerator| sweep.depths(&hull, 2, accelerator).unwrap());
        let [mut hits, mut known, mut odd] = [0; 3];
        for (found, expected) in found[0].iter().zip(&found[1]) {
            // A ray that grazes the hull may miss it on one of them.
            odd += found.len().abs_diff(expected.len());
            for (a, b) in found.iter().zip(expected).take_while(|(a, b)| a.direction == b.direction) {
                hits += 1;
                known += usize::from(b.depth.is_some());
                let apart = match [a.depth, b.depth] {
                    [Some(a), Some(b)] => (a - b).abs(),
                    [None, None] => 0.0,
                    _ => f32::INFINITY,
                };
                odd += usize::from(!((a.near - b.near).abs() < 1e-5 && apart < 1e-5));
            }
        }
        println!("of {hits} pixels {known} have a depth; {odd} differ");
        assert!(hits > 1000 && known > 200 && 200 * odd < hits, "of {hits} pixels {known} have a depth; {odd} differ");
    }
}
