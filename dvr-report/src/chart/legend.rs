//! The legend above a chart, in as many lines as it takes.

use std::fmt::Write;

use super::series::Series;
use crate::html::escape;

/// Number of colours of the palette, after which it begins again.
const PALETTE: usize = 8;

/// Height of a line of the legend.
pub(super) const LINE_HEIGHT: f64 = 18.0;

/// Approximate width of a character of the legend.
const CHARACTER: f64 = 6.7;

/// Room for the key of an entry and the gap behind it.
const KEY: f64 = 34.0;

/// Which colour of the palette the series at a place has.
pub(super) fn color_of(series: &Series, place: usize) -> usize {
    series.color.unwrap_or(place) % PALETTE
}

/// The entries, `(x, line)`, that fit into a width. One entry alone needs no legend: the title says what it is.
pub(super) fn layout(names: &[&str], width: f64) -> Vec<(f64, usize)> {
    let (mut x, mut line) = (0.0, 0);
    let mut places = Vec::with_capacity(names.len());
    for name in names {
        let needed = KEY + CHARACTER * name.chars().count() as f64;
        if x > 0.0 && x + needed > width {
            (x, line) = (0.0, line + 1);
        }
        places.push((x, line));
        x += needed;
    }
    places
}

/// Draws the entries with their upper left corner at a place.
pub(super) fn draw(svg: &mut String, series: &[&Series], left: f64, top: f64, width: f64) {
    let names: Vec<&str> = series.iter().map(|series| series.name.as_str()).collect();
    for (i, (x, line)) in layout(&names, width).into_iter().enumerate() {
        let (x, y) = (left + x, top + LINE_HEIGHT * line as f64 + 9.0);
        let color = color_of(series[i], i);
        let key = if series[i].line {
            format!("<path class=\"line\" d=\"M{x:.1} {y:.1}h16\"/>")
        } else {
            format!("<circle class=\"dot\" cx=\"{:.1}\" cy=\"{y:.1}\" r=\"4.5\"/>", x + 8.0)
        };
        let _ = write!(
            svg,
            "<g class=\"c{color}\">{key}<text class=\"legend\" x=\"{:.1}\" y=\"{:.1}\">{}</text></g>",
            x + 21.0,
            y + 4.0,
            escape(names[i])
        );
    }
}
