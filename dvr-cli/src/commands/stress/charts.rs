//! Results as charts: one grid per axis, one row per method, one column per difficulty.

use std::path::Path;

use anyhow::Result;
use dvr_report::chart::{self, HeatGrid};
use dvr_stress::{Axis, Cell, Kind};

use super::results::{Results, group_name};
use super::table::{cells, methods, summary, tested};
use crate::commands::benchmark_page::BenchmarkPage;

/// Writes `charts/*.svg`, `charts/*.csv` and `report.html` into the folder of a stress test.
pub fn write(results: &Results, axes: &[Axis], folder: &Path) -> Result<()> {
    let mut page = BenchmarkPage::new(folder)?;
    let words = "<p>Each scene is hard in one way. A number is the median Chamfer-L1 of the surface that at least two views see, above its \
                 floor, in pixels' footprints; for gradients it is a relative error. A word says why a cell is not \
                 solved, after how many seeds of all are.</p>";
    page.push("", words.to_owned());
    for axis in axes {
        let grid = grid(results, axis);
        if grid.rows.is_empty() {
            continue;
        }
        page.save_chart(axis.name, &grid.to_svg(), &grid.to_csv())?;
        let what = format!("<p>{}.</p><div class=\"charts\">{}</div>", axis.what, grid.to_figure());
        page.push(axis.name, what);
    }
    page.save("dvr stress", &results.origin())
}

/// One axis.
fn grid(results: &Results, axis: &Axis) -> HeatGrid {
    let methods = methods(results, &[axis]);
    let difficulties = tested(results, axis);
    let value = match axis.kind {
        Kind::Scene(_) => "Chamfer-L1 above its floor, pixels' footprints",
        Kind::Gradient(_) => "relative error",
    };
    let cell = |method: &str, difficulty: f64| {
        let own: Vec<&Cell> = cells(results, axis, method).filter(|cell| cell.difficulty == difficulty).collect();
        let summary = summary(&own, axis.case(difficulty).as_ref());
        // A logarithmic axis has no values below the floor.
        let value = (!summary.values.is_empty()).then(|| chart::median(&summary.values).max(1e-3));
        chart::Cell { value, failed: summary.failure() }
    };
    HeatGrid {
        title: format!("{} ({})", axis.name, group_name(axis.group)),
        value: chart::Axis::log(value),
        row_title: "method".into(),
        column_title: axis.unit.into(),
        rows: methods.iter().map(|&method| method.to_owned()).collect(),
        columns: difficulties.iter().map(|&difficulty| Axis::label(difficulty)).collect(),
        cells: methods.iter().map(|method| difficulties.iter().map(|&d| cell(method, d)).collect()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use dvr_stress::{Figures, Verdict, axes};

    use super::*;
    use crate::commands::stress::results::Row;

    #[test]
    fn an_axis_becomes_a_grid_on_a_page() {
        let cell = |method: &str, difficulty: f64, verdict: Verdict| Cell {
            axis: "views".into(),
            difficulty,
            method: method.into(),
            seed: 0,
            verdict,
            value: Some(0.004),
            figures: Some(Figures { floor: 0.002, ..Figures::default() }),
            note: None,
        };
        let cells = vec![cell("grid", 12.0, Verdict::Solved), cell("grid", 3.0, Verdict::Open)];
        let folder = tempfile::tempdir().unwrap();
        write(&Results { cells: cells.into_iter().map(Row::of_this_program).collect() }, &axes(), folder.path())
            .unwrap();
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        let csv = read("charts/views.csv");
        assert!(csv.contains("grid,12,0.0") && csv.contains("not watertight"), "{csv}");
        assert!(read("charts/views.svg").contains("not watertight"));
        let page = read("report.html");
        assert!(page.contains("views (views)") && !page.contains("rod-radius"), "axes without cells have no section");
    }
}
