//! The curves of runs, from their `metrics.csv`.

use std::path::Path;

use dvr_train::is_loss_term;

use crate::chart::{Axis, Chart, Scale, Series};
use crate::error::{Error, Result};

/// The columns of a `metrics.csv`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curves {
    names: Vec<String>,
    /// Row by row; what was not measured is `None`.
    rows: Vec<Vec<Option<f64>>>,
}

impl Curves {
    /// Reads the file; empty where there is none, as in a run without steps.
    ///
    /// # Errors
    /// [`Error::Curves`] when the file is not CSV.
    pub fn read(path: &Path) -> Result<Self> {
        if !path.exists() {
            return Ok(Self::default());
        }
        let broken = |source| Error::Curves { path: path.to_owned(), source };
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
        let names = self.names.iter().map(String::as_str).filter(|name| is_loss_term(name));
        names.filter(|name| self.pairs("step", name).iter().any(|[_, value]| *value != 0.0)).collect()
    }
}

/// The time axis of all curves over a run.
fn time() -> Axis {
    Axis::linear("training time, s")
}

/// The charts of some runs, each with its name: loss, validation PSNR, Chamfer-L1, silhouettes; of a single run also the
/// terms of its loss.
pub(crate) fn charts(runs: &[(&str, &Curves)]) -> Vec<Chart> {
    let of = |column: &str| -> Vec<Series> {
        let series = runs
            .iter()
            .enumerate()
            .map(|(i, (name, curves))| Series::line(*name, curves.pairs("seconds", column)).colored(i));
        series.filter(|series| !series.points.is_empty()).collect()
    };
    let chart = |title: &str, y: Axis, series| Chart { title: title.into(), x: time(), y, series, pareto: None };
    let mut charts = vec![chart("Loss in training", Axis::log("loss (weighted sum)"), of("loss"))];
    charts.push(chart("Validation views", Axis::linear("PSNR, dB"), of("validation_psnr")));
    charts.push(chart("Chamfer-L1", Axis::log("edges of the object cube"), of("chamfer_l1")));
    let iou = Axis { title: "intersection over union".into(), scale: Scale::Linear, range: None };
    if let [(_, curves)] = runs {
        let of_run = |name: &str, column, color| Series::line(name, curves.pairs("seconds", column)).colored(color);
        let series =
            vec![of_run("validation views", "validation_mask_iou", 0), of_run("rays of the step", "mask_iou", 7)];
        charts.push(chart("Silhouettes", iou, series));
        let terms = curves.terms();
        let series = terms.iter().map(|term| Series::line(term.replace('_', " "), curves.pairs("seconds", term)));
        charts.push(chart("Terms of the loss", Axis::log("weighted value"), series.collect()));
    } else {
        charts.push(chart("Silhouettes of validation views", iou, of("validation_mask_iou")));
    }
    charts.retain(|chart| !chart.is_empty());
    charts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_become_charts_and_missing_values_stay_missing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        let text = "step,seconds,loss,mask_iou,color,depth,validation_psnr,chamfer_l1\n10,0.5,2.0,0.8,1.5,0,,\n20,1.0,1.0,0.9,0.7,0,21.5,0.01\n";
        std::fs::write(&path, text).unwrap();
        let curves = Curves::read(&path).unwrap();
        assert_eq!(curves.pairs("seconds", "validation_psnr"), [[1.0, 21.5]]);
        assert_eq!(curves.terms(), ["color"]);
        let titles: Vec<String> = charts(&[("a", &curves)]).into_iter().map(|chart| chart.title).collect();
        assert_eq!(titles, ["Loss in training", "Validation views", "Chamfer-L1", "Silhouettes", "Terms of the loss"]);
        let both = charts(&[("a", &curves), ("b", &curves)]);
        assert!(both.iter().all(|chart| chart.series.len() == 2) && both.len() == 3);
        assert!(charts(&[("none", &Curves::read(&folder.path().join("nowhere.csv")).unwrap())]).is_empty());
    }
}
