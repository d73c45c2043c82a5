//! What each depth of each pixel of a view costs.

use super::picture::Picture;

/// Pixels that a point moves in a neighbour from plane to plane.
const STEP: f32 = 1.0;

/// Most planes of a view.
const MAX_PLANES: usize = 256;

/// Correlation below which the best depth is none.
const MIN_CORRELATION: f32 = 0.2;

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

/// What each depth of each pixel costs, in the part of a view that shows the object.
pub(super) struct CostVolume {
    pub width: usize,
    pub height: usize,
    /// The depths.
    pub near: f32,
    pub step: f32,
    pub planes: usize,
    /// One less the correlation, of all depths of the first pixel, then of the second.
    pub costs: Vec<f32>,
    /// First and last depth of each pixel that lies in the hull; none where the first is larger.
    pub ranges: Vec<[u16; 2]>,
    /// Brightness.
    pub grey: Vec<f32>,
}

impl Part {
    /// The pixel of the whole picture.
    pub fn pixel(&self, index: usize, picture: &Picture) -> usize {
        (self.top + index / self.width) * picture.width + self.left + index % self.width
    }
}

impl CostVolume {
    /// Planes through the depths between which the rays of a picture lie in the hull, `depths`; `None` where none does.
    /// `widest` is the sine of the largest angle at which a neighbour looks.
    pub fn new(picture: &Picture, depths: &[[f32; 2]], widest: f32) -> Option<(Self, Part)> {
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
        let pixels = part.width * part.height;
        let range = |i: usize| {
            let [first, last] = depths[part.pixel(i, picture)];
            if first > last {
                return [1, 0];
            }
            let plane = |depth: f32| ((depth - near) / step).clamp(0.0, (planes - 1) as f32);
            [(plane(first) - 1.0).max(0.0) as u16, (plane(last) + 1.0).min((planes - 1) as f32) as u16]
        };
        let volume = Self {
            width: part.width,
            height: part.height,
            near,
            step,
            planes,
            costs: vec![UNKNOWN; pixels * planes],
            ranges: (0..pixels).map(range).collect(),
            grey: (0..pixels).map(|i| picture.grey[part.pixel(i, picture)]).collect(),
        };
        Some((volume, part))
    }

    /// Whether a pixel may lie at a plane.
    pub fn may_lie(&self, pixel: usize, plane: usize) -> bool {
        let [first, last] = self.ranges[pixel].map(usize::from);
        (first..=last).contains(&plane)
    }

    /// The first row with a pixel that may lie at a plane, and the one after the last.
    pub fn rows_at(&self, plane: usize) -> Option<[usize; 2]> {
        let may = |row: &usize| (row * self.width..(row + 1) * self.width).any(|pixel| self.may_lie(pixel, plane));
        let first = (0..self.height).find(may)?;
        let last = (0..self.height).rfind(may)?;
        Some([first, last + 1])
    }

    /// The depth of least aggregated cost, between planes, and the correlation there.
    pub fn best(&self, aggregated: &[f32], pixel: usize) -> Option<(f32, f32)> {
        let [first, last] = self.ranges[pixel].map(usize::from);
        if first > last {
            return None;
        }
        let costs = &aggregated[pixel * self.planes..(pixel + 1) * self.planes];
        let best = (first..=last).min_by(|&a, &b| costs[a].total_cmp(&costs[b]))?;
        let correlation = 1.0 - self.costs[pixel * self.planes + best];
        let offset = if best > first && best < last {
            let (a, b, c) = (costs[best - 1], costs[best], costs[best + 1]);
            let curvature = a + c - 2.0 * b;
            if curvature > 1e-6 { (0.5 * (a - c) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
        } else {
            0.0
        };
        (correlation > MIN_CORRELATION).then_some((self.near + (best as f32 + offset) * self.step, correlation))
    }
}
