//! The curves of runs, from their `metrics.csv`.

use std::path::Path;

use crate::chart::{Axis, Chart, Scale, Series};
use crate::error::{Error, Result};

/// Columns that are no terms of the loss.
const NO_TERMS: [&str; 9] = [
    "step",
    "seconds",
    "loss",
    "mask_iou",
    "learning_rate",
    "samples",
    "held_out_psnr",
    "held_out_mask_iou",
    "cpu_seconds",
];

/// The columns of a `metrics.csv`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curves {
    names: Vec<String>,
    /// Row by row; what was not measured is `None`.
    rows: Vec<Vec<Option<f64>>>,
}

impl Curves {
    /// Reads them; none where the file is not there, as in a run without steps.
    ///
    /// # Errors
    /// When the file is no CSV.
    pub fn read(path: &Path) -> Result<Self> {
        if !path.exists() {
            return Ok(Self::default());
        }
        let broken = |e: csv::Error| Error::NotARun {
            path: path.to_owned(),
            problem: format!("the file cannot be read ({e})"),
            remedy: "Move it away, and the report is made without curves.".into(),
        };
        let mut reader = csv::ReaderBuilder::new().flexible(true).from_path(path).map_err(broken)?;
        let names = reader.headers().map_err(broken)?.iter().map(str::to_owned).collect();
        let number = |text: &str| text.parse().ok().filter(|value: &f64| value.is_finite());
        let rows = reader.records().map(|record| Ok(record.map_err(broken)?.iter().map(number).collect()));
        Ok(Self { names, rows: rows.collect::<Result<_>>()? })
    }

    /// Pairs of two columns where both were measured.
    pub fn pairs(&self, x: &str, y: &str) -> Vec<[f64; 2]> {
        let place = |name: &str| self.names.iter().position(|other| other == name);
        let (Some(x), Some(y)) = (place(x), place(y)) else { return Vec::new() };
        let value = |row: &[Option<f64>], column: usize| row.get(column).copied().flatten();
        self.rows.iter().filter_map(|row| Some([value(row, x)?, value(row, y)?])).collect()
    }

    /// Names of the terms of the loss that were ever other than zero.
    fn terms(&self) -> Vec<&str> {
        let names = self.names.iter().map(String::as_str).filter(|name| !NO_TERMS.contains(name));
        names.filter(|name| self.pairs("step", name).iter().any(|[_, value]| *value != 0.0)).collect()
    }
}

/// The time axis of all curves over a run.
fn time() -> Axis {
    Axis::linear("training time, s")
}

/// The charts of some runs, each with its name: loss, held-out PSNR, silhouettes; of a single run also the terms of its
/// loss.
pub fn charts(runs: &[(&str, &Curves)]) -> Vec<Chart> {
    let of = |column: &str| -> Vec<Series> {
        let series = runs
            .iter()
            .enumerate()
            .map(|(i, (name, curves))| Series::line(*name, curves.pairs("seconds", column)).colored(i));
        series.filter(|series| !series.points.is_empty()).collect()
    };
    let chart = |title: &str, y: Axis, series| Chart { title: title.into(), x: time(), y, series, pareto: None };
    let mut charts = vec![chart("Loss in training", Axis::log("loss (weighted sum)"), of("loss"))];
    charts.push(chart("Views that were held out", Axis::linear("PSNR, dB"), of("held_out_psnr")));
    let iou = Axis { title: "intersection over union".into(), scale: Scale::Linear, range: None };
    if let [(_, curves)] = runs {
        let of_run = |name: &str, column, color| Series::line(name, curves.pairs("seconds", column)).colored(color);
        let series = vec![of_run("held-out views", "held_out_mask_iou", 0), of_run("rays of the step", "mask_iou", 7)];
        charts.push(chart("Silhouettes", iou, series));
        let terms = curves.terms();
        let series = terms.iter().map(|term| Series::line(term.replace('_', " "), curves.pairs("seconds", term)));
        charts.push(chart("Terms of the loss", Axis::log("weighted value"), series.collect()));
    } else {
        charts.push(chart("Silhouettes of held-out views", iou, of("held_out_mask_iou")));
    }
    charts.retain(|chart| !chart.is_empty());
    charts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_columns_of_a_run_become_charts_and_holes_stay_holes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        let text =
            "step,seconds,loss,mask_iou,color,depth,held_out_psnr\n10,0.5,2.0,0.8,1.5,0,\n20,1.0,1.0,0.9,0.7,0,21.5\n";
        std::fs::write(&path, text).unwrap();
        let curves = Curves::read(&path).unwrap();
        assert_eq!(curves.pairs("seconds", "held_out_psnr"), [[1.0, 21.5]]);
        assert_eq!(curves.terms(), ["color"]);
        let titles: Vec<String> = charts(&[("a", &curves)]).into_iter().map(|chart| chart.title).collect();
        assert_eq!(titles, ["Loss in training", "Views that were held out", "Silhouettes", "Terms of the loss"]);
        let both = charts(&[("a", &curves), ("b", &curves)]);
        assert!(both.iter().all(|chart| chart.series.len() == 2) && both.len() == 2);
        assert!(charts(&[("none", &Curves::read(&folder.path().join("nowhere.csv")).unwrap())]).is_empty());
    }
}
