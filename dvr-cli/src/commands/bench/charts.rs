//! Results as charts: quality against time with the range of seeds, Pareto fronts, quality against size, what
//! finer grids cost.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::Result;
use dvr_report::chart::{Axis, Better, Chart, Series};
use dvr_report::{Curves, table};

use super::plan::folder_name;
use super::results::{Outcome, Results};
use super::table::{grouped, rows};
use crate::commands::benchmark_page::BenchmarkPage;
use crate::commands::provenance::origin;

/// A figure on an axis of a chart.
type Figure = fn(&Outcome) -> Option<f64>;

/// Chamfer-L1 above its floor, or as it is where no floor was measured.
fn chamfer_above_floor(outcome: &Outcome) -> Option<f64> {
    Some(outcome.chamfer_l1? - outcome.floor.unwrap_or(0.0))
}

/// The column of `metrics.csv` with Chamfer-L1.
const CHAMFER: &str = "chamfer_l1";

/// Its title on charts.
const CHAMFER_TITLE: &str = "Chamfer-L1 above its floor, cube edges";

/// Writes `charts/*.svg`, `charts/*.csv` and `report.html` into the folder of a bench.
pub fn write(results: &Results, folder: &Path) -> Result<()> {
    let mut page = BenchmarkPage::new(folder)?;
    let (heads, rows) = rows(&results.outcomes);
    let words = "<p>Medians over seeds, with their range. Lengths are in edges of the object cube (papers print \
                 Chamfer-L1 times ten). PSNR and silhouettes are of the coloured mesh on test views; curves over time are of validation views.</p>";
    page.push("Figures", format!("{words}<div class=\"wide\">{}</div>", table(&heads, &rows)));
    let mut scenes: Vec<&str> = results.outcomes.iter().map(|outcome| outcome.scene.as_str()).collect();
    scenes.sort_unstable();
    scenes.dedup();
    for scene in scenes {
        let outcomes: Vec<Outcome> =
            results.outcomes.iter().filter(|outcome| outcome.scene == scene).cloned().collect();
        let mut figures = String::new();
        for chart in of_scene(&outcomes, &folder.join("runs")) {
            page.save_chart(&format!("{scene} {}", chart.title), &chart.to_svg(), &chart.to_csv())?;
            figures += &chart.to_figure();
        }
        if !figures.is_empty() {
            page.push(scene, format!("<div class=\"charts\">{figures}</div>"));
        }
    }
    page.save("dvr bench", &origin(results.outcomes.iter().map(|outcome| outcome.key.as_ref())))
}

/// The charts of one scene that have something to show.
fn of_scene(outcomes: &[Outcome], runs: &Path) -> Vec<Chart> {
    let groups = grouped(outcomes);
    let over_time =
        |title: &str, (x, clock, spent): (&str, &str, Figure), (y, column, reached): (&str, &str, Figure)| Chart {
            title: title.into(),
            x: Axis::log(x),
            y: Axis::linear(y),
            series: groups
                .iter()
                .enumerate()
                .map(|(i, group)| curve(group, runs, [clock, column], [spent, reached]).colored(i))
                .collect(),
            pareto: None,
        };
    let ends = |title: &str, (x, spent): (&str, Figure), y: Axis, reached: Figure, better: Better| Chart {
        title: title.into(),
        x: Axis::log(x),
        y,
        series: groups.iter().enumerate().map(|(i, group)| dots(group, spent, reached).colored(i)).collect(),
        pareto: Some([Better::Less, better]),
    };
    let wall: (&str, &str, Figure) = ("training, wall seconds", "seconds", |o| o.training_seconds.or(o.seconds));
    let cpu: (&str, &str, Figure) = ("CPU seconds", "cpu_seconds", |o| o.cpu_seconds);
    // What a run measures on its way is of validation views; where a method recorded nothing, the end stands there.
    let psnr: (&str, &str, Figure) =
        ("PSNR, dB: curves of validation views, points of test views", "validation_psnr", |o| o.psnr);
    let chamfer: (&str, &str, Figure) = (CHAMFER_TITLE, CHAMFER, chamfer_above_floor);
    let iou: (&str, &str, Figure) =
        ("silhouette IoU: curves of validation views, points of test views", "validation_mask_iou", |o| o.mask_iou);
    let job: (&str, Figure) = ("whole job, wall seconds", |o| o.seconds);
    let stored: (&str, Figure) = ("stored, kB", |o| Some(o.bytes? as f64 / 1e3));
    let above = || Axis::log(CHAMFER_TITLE);
    let mut charts = vec![
        over_time("PSNR against wall time", wall, psnr),
        over_time("PSNR against CPU time", cpu, psnr),
        over_time("Silhouettes against wall time", wall, iou),
        Chart { y: above(), ..over_time("Chamfer-L1 during training", wall, chamfer) },
        Chart { y: above(), ..over_time("Chamfer-L1 during training, CPU time", cpu, chamfer) },
        ends("Chamfer-L1 against wall time", job, above(), chamfer_above_floor, Better::Less),
        ends("Chamfer-L1 against CPU time", (cpu.0, cpu.2), above(), chamfer_above_floor, Better::Less),
        ends("PSNR of the whole job", job, Axis::linear("test PSNR, dB"), psnr.2, Better::More),
        ends("Chamfer-L1 against size", stored, above(), chamfer_above_floor, Better::Less),
        ends("PSNR against size", stored, Axis::linear("test PSNR, dB"), psnr.2, Better::More),
    ];
    charts.extend(against_cells(&groups));
    charts.retain(|chart| !chart.is_empty());
    charts
}

/// What finer grids cost, where some have more cells than others.
fn against_cells(groups: &[Vec<&Outcome>]) -> Vec<Chart> {
    let sizes: BTreeSet<usize> = groups.iter().flatten().filter_map(|outcome| outcome.cells).collect();
    if sizes.len() < 2 {
        return Vec::new();
    }
    let cells: Figure = |o| Some(o.cells? as f64);
    let chart = |title: &str, y: &str, cost: Figure| Chart {
        title: title.into(),
        x: Axis::log("cells along an edge"),
        y: Axis::log(y),
        series: groups.iter().enumerate().map(|(i, group)| dots(group, cells, cost).colored(i)).collect(),
        pareto: None,
    };
    vec![
        chart("CPU time against cells", "CPU seconds of the whole job", |o| o.cpu_seconds),
        chart("Memory against cells", "peak of the whole job, MB", |o| Some(o.peak_memory? as f64 / 1e6)),
    ]
}

/// A method's name on charts, with its supervision where it is known.
fn name(outcome: &Outcome) -> String {
    match outcome.supervision.as_str() {
        "" => outcome.method.clone(),
        supervision => format!("{}, {supervision}", outcome.method),
    }
}

/// The curve of a method over its seeds; without recorded curves, the final points.
fn curve(group: &[&Outcome], runs: &Path, [clock, column]: [&str; 2], [spent, reached]: [Figure; 2]) -> Series {
    let curve = |outcome: &&Outcome| {
        let folder = folder_name(&outcome.scene, &outcome.method, &outcome.supervision, outcome.seed);
        let curves = Curves::read(&runs.join(folder).join("metrics.csv")).ok()?;
        // Charts show Chamfer-L1 above its floor.
        let floor = if column == CHAMFER { outcome.floor.unwrap_or(0.0) } else { 0.0 };
        let points = curves.pairs(clock, column).into_iter().map(|[x, y]| [x, y - floor]);
        Some(points.collect()).filter(|points: &Vec<[f64; 2]>| !points.is_empty())
    };
    let curves: Vec<Vec<[f64; 2]>> = group.iter().filter_map(curve).collect();
    if curves.is_empty() { dots(group, spent, reached) } else { Series::of_seeds(name(group[0]), &curves) }
}

/// The final points of a method's seeds.
fn dots(group: &[&Outcome], x: Figure, y: Figure) -> Series {
    Series::dots(name(group[0]), group.iter().filter_map(|outcome| Some([x(outcome)?, y(outcome)?])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(method: &str, seed: u64, seconds: f64, chamfer: f64) -> Outcome {
        let json = serde_json::json!({
            "scene": "ball", "method": method, "supervision": "rgb", "seed": seed, "seconds": seconds, "bytes": 1000 * (seed + 1),
            "chamfer_l1": chamfer, "floor": 0.002, "psnr": 20.0 + seconds, "cpu_seconds": 2.0 * seconds,
            "cells": if method == "grid" { Some(64 << seed) } else { None },
        });
        serde_json::from_value(json).unwrap()
    }

    #[test]
    fn outcomes_become_charts_and_a_page() {
        let folder = tempfile::tempdir().unwrap();
        let outcomes =
            vec![outcome("grid", 0, 3.0, 0.003), outcome("grid", 1, 4.0, 0.0035), outcome("slow", 0, 9.0, 0.004)];
        for seed in 0..2 {
            let run = folder.path().join("runs").join(folder_name("ball", "grid", "rgb", seed));
            std::fs::create_dir_all(&run).unwrap();
            let rows = format!("seconds,validation_psnr\n0.5,2{seed}\n1.0,25\n");
            std::fs::write(run.join("metrics.csv"), rows).unwrap();
        }
        write(&Results { outcomes }, folder.path()).unwrap();
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        let curve = read("charts/ball-psnr-against-wall-time.csv");
        assert!(curve.contains("\"grid, rgb\",0.5,20.5,20,21") && curve.contains("\"slow, rgb\",9,29,,"), "{curve}");
        assert!(read("charts/ball-chamfer-l1-against-wall-time.svg").contains("class=\"front\""));
        let cost = read("charts/ball-cpu-time-against-cells.csv");
        assert!(cost.contains("64,6") && cost.contains("128,8") && !cost.contains("18"), "a network has none: {cost}");
        assert!(!folder.path().join("charts/ball-memory-against-cells.svg").exists(), "not measured");
        let page = read("report.html");
        assert!(page.contains("Chamfer-L1 against size") && !page.contains("Silhouettes against"), "not measured");
    }
}
