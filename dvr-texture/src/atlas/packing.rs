//! Charts laid side by side on a square, as the pieces of Tetris (Lévy, Petitjean, Ray and Maillot, Least Squares Conformal
//! Maps for Automatic Texture Atlas Generation, SIGGRAPH 2002, section 4).

use glam::Vec2;

use super::charts::Chart;

/// Columns that the square is divided in: charts begin at their borders.
const COLUMNS: usize = 512;

/// Times that the scale is tried.
const TRIALS: usize = 12;

/// Where charts lie: a scale, and the place of each chart's origin, in texels.
pub(super) struct Packing {
    /// Texels per unit of the mesh.
    pub scale: f32,
    pub places: Vec<Vec2>,
}

/// Packs charts into a square of `size` texels, with at least `padding` free texels around each: the largest scale that
/// was found to fit. `None` where the charts' padding alone is too much, or their sizes are
/// beyond numbers.
pub(super) fn pack(charts: &[Chart], size: u32, padding: u32) -> Option<Packing> {
    let area: f32 = charts.iter().map(|chart| chart.extent.element_product()).sum();
    let widest = charts.iter().map(|chart| chart.extent.max_element()).fold(f32::MIN_POSITIVE, f32::max);
    // Single precision ends at absurd sizes.
    if !area.is_finite() || !widest.is_finite() {
        return None;
    }
    let largest = (size as f32 - 2.0 * padding as f32 - 2.0).max(1.0) / widest;
    let mut scale = (size as f32 / area.max(f32::MIN_POSITIVE).sqrt()).min(largest);
    let mut best: Option<Packing> = None;
    let (mut fits, mut fails) = (0.0f32, f32::INFINITY);
    for trial in 0.. {
        let (height, places) = drop_all(charts, scale, size, padding);
        if height <= size as f32 {
            fits = scale;
            best = Some(Packing { scale, places });
        } else {
            fails = scale;
        }
        let is_known = fits >= largest || fails - fits < 0.005 * fits;
        if best.is_some() && (is_known || trial >= TRIALS) {
            break;
        }
        scale = match () {
            () if fits == 0.0 => scale * (size as f32 / height).sqrt().min(0.95),
            () if fails.is_finite() => 0.5 * (fits + fails),
            () => (1.1 * fits).min(largest),
        };
        if scale * widest < 1e-3 {
            return None;
        }
    }
    best
}

/// Drops all charts, tall ones first, where they come to lie lowest; returns the height that they reach.
fn drop_all(charts: &[Chart], scale: f32, size: u32, padding: u32) -> (f32, Vec<Vec2>) {
    let column = size as f32 / COLUMNS as f32;
    let padding = padding as f32;
    let mut order: Vec<usize> = (0..charts.len()).collect();
    order.sort_by(|&a, &b| charts[b].extent.y.total_cmp(&charts[a].extent.y).then(a.cmp(&b)));
    let mut horizon = vec![0.0f32; COLUMNS];
    let mut places = vec![Vec2::ZERO; charts.len()];
    for index in order {
        let profile = Profile::of(&charts[index], scale, column, padding);
        let columns = profile.bottom.len();
        let start_at = |first: usize| (0..columns).map(|k| horizon[first + k] - profile.bottom[k]).fold(0.0, f32::max);
        // Lowest top; of equal ones the leftmost.
        let starts = (0..=COLUMNS.saturating_sub(columns)).map(|first| (first, start_at(first)));
        let Some((first, height)) = starts.min_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
        for k in 0..columns.min(COLUMNS) {
            horizon[first + k] = height + profile.top[k];
        }
        // Whole texels: charts of equal shape get equal textures.
        places[index] = Vec2::new(first as f32 * column + padding, (height + padding).ceil());
    }
    (horizon.into_iter().fold(0.0, f32::max), places)
}

/// The lower and the upper outline of a chart with its padding, per column.
struct Profile {
    bottom: Vec<f32>,
    top: Vec<f32>,
}

impl Profile {
    fn of(chart: &Chart, scale: f32, column: f32, padding: f32) -> Self {
        let columns = (((scale * chart.extent.x + 2.0 * padding) / column).ceil() as usize).clamp(1, COLUMNS);
        let (mut bottom, mut top) = (vec![f32::INFINITY; columns], vec![0.0f32; columns]);
        for corners in &chart.corners {
            let low = scale * corners[0].min(corners[1]).min(corners[2]);
            let high = scale * corners[0].max(corners[1]).max(corners[2]) + 2.0 * padding;
            let first = ((low.x / column) as usize).min(columns - 1);
            let last = ((high.x / column) as usize).min(columns - 1);
            for (bottom, top) in bottom[first..=last].iter_mut().zip(&mut top[first..=last]) {
                *bottom = bottom.min(low.y);
                // Places are rounded up to whole texels.
                *top = top.max(high.y + 1.0);
            }
        }
        Self { bottom, top }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle(width: f32, height: f32) -> Chart {
        let extent = Vec2::new(width, height);
        let corners = vec![[Vec2::ZERO, Vec2::new(width, 0.0), extent], [Vec2::ZERO, extent, Vec2::new(0.0, height)]];
        Chart { faces: vec![0, 1], corners, extent }
    }

    #[test]
    fn boxes_fill_most_of_the_square_and_keep_their_distance() {
        let charts: Vec<Chart> = (0..60).map(|i| rectangle(1.0 + (i % 7) as f32, 0.5 + (i % 5) as f32)).collect();
        let Packing { scale, places } = pack(&charts, 1024, 4).unwrap();
        let boxes: Vec<(Vec2, Vec2)> =
            charts.iter().zip(&places).map(|(chart, &place)| (place, place + scale * chart.extent)).collect();
        for (i, (low, high)) in boxes.iter().enumerate() {
            assert!(low.min_element() >= 4.0 && high.max_element() <= 1020.0, "{low} {high}");
            for (other_low, other_high) in &boxes[..i] {
                let gap = (*low - *other_high).max(*other_low - *high).max_element();
                assert!(gap >= 8.0 - 1e-2, "{gap}");
            }
        }
        let area: f32 = charts.iter().map(|chart| (scale * chart.extent).element_product()).sum();
        assert!(area / 1024.0f32.powi(2) > 0.6, "{}", area / 1024.0f32.powi(2));
    }

    #[test]
    fn a_square_that_padding_alone_fills_has_no_packing() {
        let charts = vec![rectangle(1.0, 1.0); 400];
        assert!(pack(&charts, 64, 4).is_none());
        assert!(pack(&charts, 256, 4).is_some());
        assert!(pack(&[rectangle(f32::INFINITY, 1.0)], 256, 4).is_none());
    }
}
