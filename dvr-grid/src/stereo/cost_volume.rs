//! What each depth of each pixel of a view costs.

use std::ops::Range;

use super::picture::Picture;

/// The least sine of an angle between neighbours that sets the distance of planes.
const LEAST_ANGLE: f32 = 0.05;

/// Pixels that a point moves in a neighbour from plane to plane.
const STEP: f32 = 1.0;

/// Most planes of a view, but for one more by rounding.
const MAX_PLANES: usize = 256;

/// The same with that one.
#[cfg(feature = "gpu")]
pub(super) const ROOM: usize = MAX_PLANES + 1;

/// Correlation below which the best depth is none.
pub(super) const MIN_CORRELATION: f32 = 0.2;

/// What a depth without a match costs: a correlation of zero.
pub(super) const UNKNOWN: f32 = 1.0;

/// The part of a picture that shows the object.
#[derive(Clone, Copy)]
pub(super) struct Part {
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
}

/// Which depths the pixels of a view may have, in the part that shows the object.
pub(super) struct VolumeLayout {
    pub part: Part,
    /// The depths.
    pub near: f32,
    pub step: f32,
    pub planes: usize,
    /// Where the costs of each pixel begin, and where those of the last end: those of the depths of the first pixel that
    /// lie in the hull, then of the second.
    pub starts: Vec<usize>,
    /// First and last depth of each pixel that lies in the hull; none where the first is larger.
    pub ranges: Vec<[u16; 2]>,
}

/// What these depths cost.
pub(super) struct CostVolume {
    pub layout: VolumeLayout,
    /// One less the correlation.
    pub costs: Vec<f32>,
    /// Brightness of the part.
    pub grey: Vec<f32>,
}

/// Rows and columns from the first up to but without the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    pub rows: [usize; 2],
    pub columns: [usize; 2],
}

impl Window {
    /// The pixels of each of its rows, of a picture of this width.
    pub fn rows_in(&self, width: usize) -> impl Iterator<Item = Range<usize>> + use<> {
        let [first, last] = self.columns;
        (self.rows[0]..self.rows[1]).map(move |row| row * width + first..row * width + last)
    }
}

impl Part {
    /// The pixel of the whole picture.
    pub fn pixel(&self, index: usize, picture: &Picture) -> usize {
        (self.top + index / self.width) * picture.width + self.left + index % self.width
    }
}

impl VolumeLayout {
    /// Planes through the depths between which the rays of a view lie in the hull, `depths`, so far apart that a point
    /// moves by about a pixel in the neighbour that sees it move most; `None` where no ray meets the hull, and where there are
    /// not the two neighbours that must match.
    pub fn new(pictures: &[Picture], view: usize, neighbours: &[usize], depths: &[[f32; 2]]) -> Option<Self> {
        if neighbours.len() < 2 {
            return None;
        }
        let picture = &pictures[view];
        let toward = picture.camera.center.normalize_or_zero();
        let widest = (neighbours.iter())
            .map(|&other| toward.angle_between(pictures[other].camera.center.normalize_or_zero()).sin())
            .fold(LEAST_ANGLE, f32::max);
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        let (mut near, mut far) = (f32::INFINITY, 0f32);
        for (pixel, range) in depths.iter().enumerate().filter(|(_, range)| range[0] <= range[1]) {
            let at = [pixel % picture.width, pixel / picture.width];
            (0..2).for_each(|i| (low[i], high[i]) = (low[i].min(at[i]), high[i].max(at[i] + 1)));
            (near, far) = (near.min(range[0]), far.max(range[1]));
        }
        if near.is_infinite() || near >= far {
            return None;
        }
        let part = Part { left: low[0], top: low[1], width: high[0] - low[0], height: high[1] - low[1] };
        let step = (STEP * picture.camera.footprint() / widest).max((far - near) / (MAX_PLANES - 1) as f32);
        let planes = ((far - near) / step).ceil() as usize + 1;
        let range = |i: usize| {
            let [first, last] = depths[part.pixel(i, picture)];
            if first > last {
                return [1, 0];
            }
            let plane = |depth: f32| ((depth - near) / step).clamp(0.0, (planes - 1) as f32);
            [(plane(first) - 1.0).max(0.0) as u16, (plane(last) + 1.0).min((planes - 1) as f32) as u16]
        };
        let ranges = (0..part.width * part.height).map(range).collect();
        Some(Self::of_ranges(part, [near, step], planes, ranges))
    }

    /// Of pixels with these ranges of planes, from a depth on and so far apart.
    pub fn of_ranges(part: Part, [near, step]: [f32; 2], planes: usize, ranges: Vec<[u16; 2]>) -> Self {
        let mut starts = Vec::with_capacity(ranges.len() + 1);
        let mut count = 0;
        for &[first, last] in &ranges {
            starts.push(count);
            count += (usize::from(last) + 1).saturating_sub(first.into());
        }
        starts.push(count);
        Self { part, near, step, planes, starts, ranges }
    }

    /// Pixels of the part.
    pub fn pixels(&self) -> usize {
        self.ranges.len()
    }

    /// Depths of all pixels together.
    pub fn len(&self) -> usize {
        self.starts[self.pixels()]
    }

    /// The planes that a pixel may lie at, and where their costs are; none out of the hull.
    #[inline]
    pub fn planes_of(&self, pixel: usize) -> (Range<usize>, Range<usize>) {
        let first = usize::from(self.ranges[pixel][0]);
        let costs = self.starts[pixel]..self.starts[pixel + 1];
        (first..first + costs.len(), costs)
    }

    /// Around the pixels that may lie at each plane; `None` where none does.
    pub fn windows(&self) -> Vec<Option<Window>> {
        let mut windows = vec![None; self.planes];
        for pixel in 0..self.ranges.len() {
            let (row, column) = (pixel / self.part.width, pixel % self.part.width);
            for window in &mut windows[self.planes_of(pixel).0] {
                let Window { rows, columns } =
                    window.get_or_insert(Window { rows: [row, row], columns: [column, column] });
                rows[1] = row + 1;
                *columns = [columns[0].min(column), columns[1].max(column + 1)];
            }
        }
        windows
    }
}

impl CostVolume {
    /// One whose depths cost all the same.
    pub fn unknown(layout: VolumeLayout, grey: Vec<f32>) -> Self {
        Self { costs: vec![UNKNOWN; layout.len()], layout, grey }
    }

    /// The depth of least aggregated cost, between planes, and the correlation there. Costs are laid out as those of the
    /// volume.
    pub fn best(&self, aggregated: &[f32], pixel: usize) -> Option<(f32, f32)> {
        let (planes, at) = self.layout.planes_of(pixel);
        let costs = &aggregated[at.clone()];
        let best = (0..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b]))?;
        let correlation = 1.0 - self.costs[at.start + best];
        let offset = if best > 0 && best + 1 < costs.len() {
            let (a, b, c) = (costs[best - 1], costs[best], costs[best + 1]);
            let curvature = a + c - 2.0 * b;
            if curvature > 1e-6 { (0.5 * (a - c) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
        } else {
            0.0
        };
        let depth = self.layout.near + ((planes.start + best) as f32 + offset) * self.layout.step;
        (correlation > MIN_CORRELATION).then_some((depth, correlation))
    }
}
