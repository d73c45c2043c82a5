//! A robust box of points.

use glam::DVec3;

use super::bounds::Bounds;

/// With fewer points, a box of them says nothing.
const MIN_POINTS: usize = 50;

/// Share of the points that is trimmed at either end of each axis: wrong matches lie far off.
const TRIMMED: f64 = 0.02;

/// Margin on every side, in longest edges of the trimmed points' box: points lie where there is texture, and an object goes
/// on where there is none.
const MARGIN: f64 = 0.25;

/// The box of some points without the outermost on each axis, with a generous margin. `None` for fewer than fifty points,
/// or points that fill no volume.
pub fn point_box(points: &[DVec3]) -> Option<Bounds> {
    if points.len() < MIN_POINTS {
        return None;
    }
    let trimmed = (TRIMMED * points.len() as f64) as usize;
    let range = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        values.sort_by(f64::total_cmp);
        [values[trimmed], values[values.len() - 1 - trimmed]]
    };
    let ranges = [0, 1, 2].map(range);
    let end = |i: usize| DVec3::from_array(ranges.map(|range| range[i]));
    let (low, high) = (end(0), end(1));
    let margin = MARGIN * (high - low).max_element();
    (low.is_finite() && high.is_finite() && margin > 0.0).then(|| Bounds { min: low - margin, max: high + margin })
}
