//! Curves or points over two axes.

use super::figure::csv_field;
use super::scale::Axis;
use super::series::{Better, Series};

/// Curves or dots over two axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// What the chart shows.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// What is drawn, in the legend's order.
    pub series: Vec<Series>,
    /// Draws the front of the points that no other point of any series beats, by what is better on `[x, y]`.
    pub pareto: Option<[Better; 2]>,
}

impl Chart {
    /// Whether there is no point to draw.
    pub fn is_empty(&self) -> bool {
        !self.series.iter().flat_map(|series| &series.points).any(|[x, y]| self.x.holds(*x) && self.y.holds(*y))
    }

    /// All points, one per line: series, x, y, and the low and high end of the band, where there is one at that x.
    pub fn to_csv(&self) -> String {
        let mut text = format!("series,{},{},low,high\n", csv_field(&self.x.title), csv_field(&self.y.title));
        for series in &self.series {
            let name = csv_field(&series.name);
            for [x, y] in &series.points {
                let band = series.band.iter().find(|band| band[0] == *x);
                let band = band.map_or(",".into(), |[_, low, high]| format!("{low},{high}"));
                text += &format!("{name},{x},{y},{band}\n");
            }
        }
        text
    }
}
