//! What is drawn on a chart: curves, points, bands over seeds, and the Pareto front.

/// A named set of points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// What the legend calls it.
    pub name: String,
    /// The points, `[x, y]`; those of a curve from left to right.
    pub points: Vec<[f64; 2]>,
    /// The spread around a curve, `[x, low, high]`; empty where there is none.
    pub band: Vec<[f64; 3]>,
    /// Whether the points are joined.
    pub line: bool,
    /// Which of the palette's colours; `None` takes the series' place among the others.
    pub color: Option<usize>,
}

impl Series {
    /// A curve.
    pub fn line(name: impl Into<String>, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), points, line: true, ..Self::default() }
    }

    /// Dots that are not joined.
    pub fn dots(name: impl Into<String>, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), points, ..Self::default() }
    }

    /// The same in the palette's `color`-th colour: what belongs together looks alike on several charts.
    #[must_use]
    pub fn colored(mut self, color: usize) -> Self {
        self.color = Some(color);
        self
    }

    /// The median of curves that differ in their seed, with the range of all as its band.
    ///
    /// At each `x` of any of them, a curve counts with what it had reached by then: no value is invented between two
    /// measurements, and what is done stays done. Before its first point it does not count.
    pub fn of_seeds(name: impl Into<String>, curves: &[Vec<[f64; 2]>]) -> Self {
        let name = name.into();
        if let [curve] = curves {
            return Self::line(name, curve.clone());
        }
        let mut places: Vec<f64> = curves.iter().flatten().map(|point| point[0]).collect();
        places.sort_by(f64::total_cmp);
        places.dedup();
        let (mut points, mut band) = (Vec::new(), Vec::new());
        for x in places {
            let reached = |curve: &Vec<[f64; 2]>| -> Option<f64> {
                let behind = curve.partition_point(|point| point[0] <= x);
                behind.checked_sub(1).map(|last| curve[last][1])
            };
            let mut values: Vec<f64> = curves.iter().filter_map(reached).collect();
            values.sort_by(f64::total_cmp);
            if let (Some(&low), Some(&high)) = (values.first(), values.last()) {
                points.push([x, median(&values)]);
                band.push([x, low, high]);
            }
        }
        Self { band, ..Self::line(name, points) }
    }
}

/// The median of sorted values; NaN of none.
pub fn median(sorted: &[f64]) -> f64 {
    let middle = sorted.len() / 2;
    match sorted.len() {
        0 => f64::NAN,
        odd if odd % 2 == 1 => sorted[middle],
        _ => 0.5 * (sorted[middle - 1] + sorted[middle]),
    }
}

/// Which end of an axis is the good one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    /// Less is better: time, distance, bytes.
    Less,
    /// More is better: PSNR, IoU.
    More,
}

/// The Pareto front: points that no other point beats on both axes, from the best by x to the best by y.
pub fn pareto_front(points: &[[f64; 2]], better: [Better; 2]) -> Vec<[f64; 2]> {
    // Turned so that less is better on both axes.
    let turned = |point: &[f64; 2]| -> [f64; 2] {
        [0, 1].map(|axis| if better[axis] == Better::Less { point[axis] } else { -point[axis] })
    };
    let mut sorted: Vec<[f64; 2]> = points.iter().copied().filter(|p| p.iter().all(|v| v.is_finite())).collect();
    sorted.sort_by(|a, b| {
        let (a, b) = (turned(a), turned(b));
        a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
    });
    let mut best = f64::INFINITY;
    sorted.retain(|point| {
        let height = turned(point)[1];
        let is_better = height < best;
        best = best.min(height);
        is_better
    });
    sorted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_beats_on_both_axes() {
        let points = [[1.0, 5.0], [2.0, 6.0], [3.0, 2.0], [4.0, 3.0], [9.0, 1.0], [f64::NAN, 0.0]];
        let front = pareto_front(&points, [Better::Less, Better::Less]);
        assert_eq!(front, [[1.0, 5.0], [3.0, 2.0], [9.0, 1.0]]);
        let front = pareto_front(&points, [Better::Less, Better::More]);
        assert_eq!(front, [[1.0, 5.0], [2.0, 6.0]]);
    }

    #[test]
    fn seeds_become_their_median_and_their_range_without_inventing_values() {
        let curves = vec![
            vec![[0.0, 1.0], [1.0, 2.0], [2.0, 3.0]],
            vec![[0.5, 10.0], [2.0, 20.0]],
            vec![[0.0, 4.0], [1.0, 5.0]],
        ];
        let series = Series::of_seeds("grid", &curves);
        assert_eq!(series.band, [[0.0, 1.0, 4.0], [0.5, 1.0, 10.0], [1.0, 2.0, 10.0], [2.0, 3.0, 20.0]]);
        assert_eq!(series.points, [[0.0, 2.5], [0.5, 4.0], [1.0, 5.0], [2.0, 5.0]]);
        assert!(Series::of_seeds("one", &curves[..1]).band.is_empty());
        assert!(Series::of_seeds("none", &[]).points.is_empty());
    }
}
