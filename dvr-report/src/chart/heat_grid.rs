//! A grid of coloured cells: one number for each pair of a row and a column.

use std::fmt::Write;

use super::figure::{CHART_STYLE, csv_field, figure};
use super::scale::{Axis, Ruler};
use crate::html::{escape, number};

/// Width of the drawing, in its own units.
const WIDTH: f64 = 600.0;

/// Height of a row.
const ROW: f64 = 30.0;

/// Shades from the lowest to the highest value.
const SHADES: usize = 8;

/// One cell of a [`HeatGrid`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cell {
    /// The number that colours the cell; `None` where nothing was measured.
    pub value: Option<f64>,
    /// Why the cell counts as failed, in a word or two (`empty`, `exploded`), shown in place of the number; `None`
    /// where it does not.
    pub failed: Option<String>,
}

impl From<f64> for Cell {
    fn from(value: f64) -> Self {
        Self { value: Some(value), failed: None }
    }
}

/// Cells in rows and columns, coloured by their number.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeatGrid {
    /// What the grid shows.
    pub title: String,
    /// What a number is, with its unit, and how numbers spread over the shades.
    pub value: Axis,
    /// What the rows are.
    pub row_title: String,
    /// What the columns are.
    pub column_title: String,
    /// Names of the rows, from above.
    pub rows: Vec<String>,
    /// Names of the columns, from the left.
    pub columns: Vec<String>,
    /// The cells, row by row; what is missing at the end of a row is empty.
    pub cells: Vec<Vec<Cell>>,
}

impl HeatGrid {
    /// A complete SVG file, light or dark as its viewer is.
    pub fn to_svg(&self) -> String {
        self.svg(Some(CHART_STYLE))
    }

    /// The grid for a page that has [`CHART_STYLE`]: a `<figure>` with the SVG, its numbers as CSV, and buttons to save
    /// both.
    pub fn to_figure(&self) -> String {
        figure(&self.title, &self.svg(None), &self.to_csv())
    }

    /// One line per cell: row, column, number, failure.
    pub fn to_csv(&self) -> String {
        let titles = [&self.row_title, &self.column_title, &self.value.title].map(|title| csv_field(title));
        let mut text = format!("{},failed\n", titles.join(","));
        for (row, cells) in self.rows.iter().zip(&self.cells) {
            for (column, cell) in self.columns.iter().zip(cells) {
                let value = cell.value.map_or(String::new(), |value| value.to_string());
                let failed = csv_field(cell.failed.as_deref().unwrap_or_default());
                text += &format!("{},{},{value},{failed}\n", csv_field(row), csv_field(column));
            }
        }
        text
    }

    fn svg(&self, style: Option<&str>) -> String {
        let longest = self.rows.iter().map(|row| row.chars().count()).max().unwrap_or(0);
        let left = (20.0 + 6.7 * longest as f64).clamp(60.0, 0.4 * WIDTH);
        let top = 66.0;
        let height = top + ROW * self.rows.len() as f64 + 14.0;
        let width = (WIDTH - left - 12.0) / self.columns.len().max(1) as f64;
        let values = self.cells.iter().flatten().filter_map(|cell| cell.value);
        let ruler = Ruler::new(&self.value, values, 0.0, SHADES as f64);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"dvr-chart\" viewBox=\"0 0 {WIDTH} {height}\" \
             role=\"img\" aria-label=\"{}\">",
            escape(&self.title)
        );
        if let Some(style) = style {
            let _ =
                write!(svg, "<style>{}</style><rect class=\"paper\" width=\"100%\" height=\"100%\"/>", escape(style));
        }
        let _ = write!(
            svg,
            "<text class=\"title\" x=\"12\" y=\"20\">{}</text><text class=\"label\" x=\"12\" y=\"58\">{}</text>\
             <text class=\"label\" text-anchor=\"middle\" x=\"{}\" y=\"40\">{}</text>",
            escape(&self.title),
            escape(&self.row_title),
            left + 0.5 * (WIDTH - left - 12.0),
            escape(&self.column_title),
        );
        for (i, column) in self.columns.iter().enumerate() {
            let x = left + width * (i as f64 + 0.5);
            let _ = write!(
                svg,
                "<text class=\"tick\" text-anchor=\"middle\" x=\"{x:.1}\" y=\"58\">{}</text>",
                escape(column)
            );
        }
        for (i, row) in self.rows.iter().enumerate() {
            let y = top + ROW * i as f64;
            let _ =
                write!(svg, "<text class=\"tick\" x=\"12\" y=\"{:.1}\">{}</text>", y + 0.5 * ROW + 4.0, escape(row));
            for (j, column) in self.columns.iter().enumerate() {
                let cell = self.cells.get(i).and_then(|cells| cells.get(j)).cloned().unwrap_or_default();
                draw_cell(&mut svg, &cell, &ruler, [left + width * j as f64, y, width], &format!("{row}, {column}"));
            }
        }
        svg.push_str("</svg>");
        svg
    }
}

/// One cell with its upper left corner and its width.
fn draw_cell(svg: &mut String, cell: &Cell, ruler: &Ruler, [x, y, width]: [f64; 3], place: &str) {
    let shade = cell.value.map(|value| (ruler.place(value).max(0.0) as usize).min(SHADES - 1));
    let text = match (&cell.failed, cell.value) {
        (Some(reason), _) => reason.clone(),
        (None, Some(value)) => number(value, 3),
        (None, None) => String::new(),
    };
    let class = match (&cell.failed, shade) {
        (Some(_), _) => "cell failed".to_owned(),
        (None, Some(shade)) => format!("cell s{shade}"),
        (None, None) => "cell".to_owned(),
    };
    let value = cell.value.map_or(String::new(), |value| format!(" {}", number(value, 4)));
    let _ = write!(
        svg,
        "<g class=\"{class}\"><rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" rx=\"3\"/>\
         <text text-anchor=\"middle\" x=\"{:.1}\" y=\"{:.1}\">{}</text><title>{}:{value} {}</title></g>",
        x + 1.0,
        y + 1.0,
        width - 2.0,
        ROW - 2.0,
        x + 0.5 * width,
        y + 0.5 * ROW + 4.0,
        escape(&text),
        escape(place),
        escape(cell.failed.as_deref().unwrap_or_default()),
    );
}
