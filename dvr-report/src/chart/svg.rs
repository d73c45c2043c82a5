//! A chart as SVG.

use std::fmt::Write;

use super::figure::{CHART_STYLE, figure};
use super::legend::{self, LINE_HEIGHT, color_of};
use super::plot::Chart;
use super::scale::Ruler;
use super::series::{Series, pareto_front};
use crate::html::{escape, number};

/// Size of the drawing, in its own units.
const WIDTH: f64 = 600.0;
const HEIGHT: f64 = 340.0;

/// Room beside the plot: left for the ticks and the title of the y axis, right for half a tick's text, below for the x
/// axis.
const LEFT: f64 = 66.0;
const RIGHT: f64 = 16.0;
const BELOW: f64 = 50.0;

/// Curves of at most this many points show them as dots too.
const FEW_POINTS: usize = 12;

impl Chart {
    /// A complete SVG file, light or dark as its viewer is.
    pub fn to_svg(&self) -> String {
        svg(self, Some(CHART_STYLE))
    }

    /// The chart for a page that has [`CHART_STYLE`]: a `<figure>` with the SVG, its numbers as CSV, and buttons to
    /// save both.
    pub fn to_figure(&self) -> String {
        figure(&self.title, &svg(self, None), &self.to_csv())
    }
}

/// The drawing; with its own style where it stands alone.
fn svg(chart: &Chart, style: Option<&str>) -> String {
    let named: Vec<&Series> = chart.series.iter().filter(|series| !series.name.is_empty()).collect();
    let has_legend = named.len() > 1;
    let names: Vec<&str> = named.iter().map(|series| series.name.as_str()).collect();
    let lines =
        if has_legend { legend::layout(&names, WIDTH - LEFT - RIGHT).last().map_or(0, |last| last.1 + 1) } else { 0 };
    let top = 34.0 + LINE_HEIGHT * lines as f64 + if has_legend { 6.0 } else { 0.0 };
    let height = HEIGHT + LINE_HEIGHT * lines.saturating_sub(1) as f64;
    let all = || chart.series.iter().flat_map(|series| &series.points);
    let spread = || chart.series.iter().flat_map(|series| &series.band);
    let x = Ruler::new(&chart.x, all().map(|point| point[0]), LEFT, WIDTH - RIGHT);
    let heights = all().map(|point| point[1]).chain(spread().flat_map(|band| [band[1], band[2]]));
    let y = Ruler::new(&chart.y, heights, height - BELOW, top);

    let mut svg = String::new();
    let kind = |ruler: &Ruler| if ruler.is_log() { "log" } else { "linear" };
    let _ = write!(
        svg,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"dvr-chart\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" \
         aria-label=\"{title}\" data-plot=\"{LEFT} {top} {right} {bottom}\" data-x=\"{} {} {}\" data-y=\"{} {} {}\">",
        x.low,
        x.high,
        kind(&x),
        y.low,
        y.high,
        kind(&y),
        title = escape(&chart.title),
        right = WIDTH - RIGHT,
        bottom = height - BELOW,
    );
    if let Some(style) = style {
        let _ = write!(svg, "<style>{}</style><rect class=\"paper\" width=\"100%\" height=\"100%\"/>", escape(style));
    }
    let _ = write!(svg, "<text class=\"title\" x=\"{LEFT}\" y=\"20\">{}</text>", escape(&chart.title));
    axes(&mut svg, chart, &x, &y, top, height);
    if has_legend {
        legend::draw(&mut svg, &named, LEFT, 31.0, WIDTH - LEFT - RIGHT);
    }
    if let Some(better) = chart.pareto {
        let points: Vec<[f64; 2]> = all().copied().filter(|p| chart.x.holds(p[0]) && chart.y.holds(p[1])).collect();
        let front = pareto_front(&points, better);
        let _ = write!(svg, "<path class=\"front\" d=\"{}\"/>", stairs(&front, &x, &y));
    }
    for (i, series) in chart.series.iter().enumerate() {
        draw_series(&mut svg, chart, series, color_of(series, i), &x, &y);
    }
    if chart.is_empty() {
        let (middle, across) = (0.5 * (LEFT + WIDTH - RIGHT), 0.5 * (top + height - BELOW));
        let _ = write!(
            svg,
            "<text class=\"tick\" text-anchor=\"middle\" x=\"{middle}\" y=\"{across}\">nothing was measured</text>"
        );
    }
    svg.push_str("</svg>");
    svg
}

/// Grid, ticks and titles.
fn axes(svg: &mut String, chart: &Chart, x: &Ruler, y: &Ruler, top: f64, height: f64) {
    let (right, bottom) = (WIDTH - RIGHT, height - BELOW);
    for (value, text) in y.ticks(5) {
        let at = y.place(value);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{right}\"/><text class=\"tick\" text-anchor=\"end\" x=\"{}\" \
             y=\"{:.1}\">{}</text>",
            LEFT - 7.0,
            at + 4.0,
            escape(&text)
        );
    }
    for (value, text) in x.ticks(7) {
        let at = x.place(value);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{at:.1} {top}V{bottom}\"/><text class=\"tick\" text-anchor=\"middle\" \
             x=\"{at:.1}\" y=\"{}\">{}</text>",
            bottom + 18.0,
            escape(&text)
        );
    }
    let _ = write!(
        svg,
        "<path class=\"axis\" d=\"M{LEFT} {top}V{bottom}H{right}\"/>\
         <text class=\"label\" text-anchor=\"middle\" x=\"{}\" y=\"{}\">{}</text>\
         <text class=\"label\" text-anchor=\"middle\" transform=\"translate(15 {}) rotate(-90)\">{}</text>",
        0.5 * (LEFT + right),
        bottom + 40.0,
        escape(&chart.x.title),
        0.5 * (top + bottom),
        escape(&chart.y.title),
    );
}

/// Band, curve and dots of one series.
fn draw_series(svg: &mut String, chart: &Chart, series: &Series, color: usize, x: &Ruler, y: &Ruler) {
    let holds = |a: f64, b: f64| chart.x.holds(a) && chart.y.holds(b);
    let _ = write!(svg, "<g class=\"c{color}\">");
    let band: Vec<&[f64; 3]> = series.band.iter().filter(|b| holds(b[0], b[1]) && holds(b[0], b[2])).collect();
    if band.len() > 1 {
        let corner = |at: f64, value: f64| format!("{:.1} {:.1}", x.place(at), y.place(value));
        let there = band.iter().map(|b| corner(b[0], b[2]));
        let back = band.iter().rev().map(|b| corner(b[0], b[1]));
        let _ = write!(svg, "<path class=\"band\" d=\"M{}Z\"/>", there.chain(back).collect::<Vec<_>>().join("L"));
    }
    let points: Vec<[f64; 2]> = series.points.iter().copied().filter(|p| holds(p[0], p[1])).collect();
    if series.line && points.len() > 1 {
        let path: Vec<String> = points.iter().map(|p| format!("{:.1} {:.1}", x.place(p[0]), y.place(p[1]))).collect();
        let _ = write!(svg, "<path class=\"line\" d=\"M{}\"/>", path.join("L"));
    }
    if !series.line || points.len() <= FEW_POINTS {
        for [at, value] in &points {
            let name = if series.name.is_empty() { String::new() } else { format!("{}: ", series.name) };
            let _ = write!(
                svg,
                "<circle class=\"dot\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"{}\"><title>{}{}, {}</title></circle>",
                x.place(*at),
                y.place(*value),
                if series.line { 3.0 } else { 4.5 },
                escape(&name),
                number(*at, 4),
                number(*value, 4)
            );
        }
    }
    svg.push_str("</g>");
}

/// The front as stairs: between two of its points, the earlier one is the best there is.
fn stairs(front: &[[f64; 2]], x: &Ruler, y: &Ruler) -> String {
    let mut path = String::new();
    for (i, [at, value]) in front.iter().enumerate() {
        let (at, value) = (x.place(*at), y.place(*value));
        let _ = if i == 0 { write!(path, "M{at:.1} {value:.1}") } else { write!(path, "H{at:.1}V{value:.1}") };
    }
    path
}
