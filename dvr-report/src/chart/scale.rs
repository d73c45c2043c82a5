//! Axes: from values to places on paper, and where the ticks go.

use crate::html::number;

/// How values are spread along an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// Evenly.
    #[default]
    Linear,
    /// By their logarithm; values that are not positive have no place and are left out.
    Log,
}

/// An axis of a chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Axis {
    /// What is counted, with its unit: `training time, s`.
    pub title: String,
    /// How values are spread.
    pub scale: Scale,
    /// Smallest and largest value to show; `None` leaves it to the data.
    pub range: Option<[f64; 2]>,
}

impl Axis {
    /// An even axis over the range of the data.
    pub fn linear(title: impl Into<String>) -> Self {
        Self { title: title.into(), ..Self::default() }
    }

    /// A logarithmic axis over the range of the data.
    pub fn log(title: impl Into<String>) -> Self {
        Self { title: title.into(), scale: Scale::Log, range: None }
    }

    /// Whether a value has a place on this axis.
    pub(super) fn holds(&self, value: f64) -> bool {
        value.is_finite() && (self.scale == Scale::Linear || value > 0.0)
    }
}

/// An axis laid on paper.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ruler {
    scale: Scale,
    pub low: f64,
    pub high: f64,
    /// Where `low` and `high` lie, in the units of the drawing.
    from: f64,
    to: f64,
}

impl Ruler {
    /// Lays the axis from one place to another, so that it holds all `values`.
    pub fn new(axis: &Axis, values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let held = values.filter(|&value| axis.holds(value));
        let (mut low, mut high) = held.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if let Some([given_low, given_high]) = axis.range {
            (low, high) = (given_low, given_high);
        } else if low > high {
            (low, high) = if axis.scale == Scale::Log { (0.1, 1.0) } else { (0.0, 1.0) };
        } else if axis.scale == Scale::Log {
            let margin = (high / low).max(1.5).powf(0.06);
            (low, high) = (low / margin, high * margin);
        } else {
            let span = if high > low { high - low } else { high.abs().max(1e-9) };
            // Zero is where time begins: an axis of what is never negative does not go below it.
            let floor = if low >= 0.0 { 0.0 } else { f64::NEG_INFINITY };
            (low, high) = ((low - 0.06 * span).max(floor), high + 0.06 * span);
            if floor == 0.0 && low < 0.2 * span {
                low = 0.0;
            }
        }
        Self { scale: axis.scale, low, high, from, to }
    }

    /// Whether values are spread by their logarithm.
    pub fn is_log(&self) -> bool {
        self.scale == Scale::Log
    }

    /// Where a value lies.
    pub fn place(&self, value: f64) -> f64 {
        let share = match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log => (value / self.low).ln() / (self.high / self.low).ln(),
        };
        self.from + share * (self.to - self.from)
    }

    /// Values that are marked, with their text; about `wanted` of them.
    pub fn ticks(&self, wanted: usize) -> Vec<(f64, String)> {
        let inside = |value: f64| value >= self.low * (1.0 - 1e-9) && value <= self.high * (1.0 + 1e-9);
        if self.scale == Scale::Log {
            let decades = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
            let span = (self.high / self.low).log10();
            let steps: &[f64] = if span > 3.0 {
                &[1.0]
            } else if span > 1.2 {
                &[1.0, 3.0]
            } else {
                &[1.0, 2.0, 3.0, 5.0, 7.0]
            };
            let every = if span > wanted as f64 { (span / wanted as f64).ceil() as i32 } else { 1 };
            let values = decades.filter(|decade| decade.rem_euclid(every) == 0);
            let values = values.flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
            let ticks: Vec<f64> = values.filter(|&value| inside(value)).collect();
            if ticks.len() >= 2 {
                return ticks.into_iter().map(|value| (value, number(value, 2))).collect();
            }
        }
        let rough = (self.high - self.low) / wanted.max(1) as f64;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 2.5, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= rough).unwrap_or(rough);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        let decimals = (-step.log10().floor()).max(0.0) as usize + usize::from((step / power - 2.5).abs() < 1e-9);
        let text = |value: f64| {
            if value.abs() >= 1e5 || (step < 1e-4) { number(value, 3) } else { format!("{value:.decimals$}") }
        };
        (first..=last).map(|i| i as f64 * step).map(|value| (value, text(value))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_lie_on_the_axis() {
        let ruler = Ruler::new(&Axis::linear("s"), [0.0, 7.3].into_iter(), 0.0, 100.0);
        let ticks: Vec<String> = ruler.ticks(5).into_iter().map(|(_, text)| text).collect();
        assert_eq!(ticks, ["0", "2", "4", "6"]);
        let log = Ruler::new(&Axis::log("loss"), [0.002, 3.0].into_iter(), 0.0, 100.0);
        let ticks: Vec<String> = log.ticks(5).into_iter().map(|(_, text)| text).collect();
        assert_eq!(ticks, ["0.01", "0.1", "1"]);
        assert!((log.place(0.1) - log.place(0.01) - (log.place(1.0) - log.place(0.1))).abs() < 1e-9);
    }

    #[test]
    fn an_axis_without_data_or_with_a_single_value_is_still_an_axis() {
        for axis in [Axis::linear(""), Axis::log("")] {
            for values in [vec![], vec![0.5], vec![f64::NAN, -1.0]] {
                let ruler = Ruler::new(&axis, values.into_iter(), 0.0, 100.0);
                assert!(ruler.high > ruler.low && ruler.place(ruler.high).is_finite());
                assert!(ruler.ticks(5).len() < 40);
            }
        }
    }
}
