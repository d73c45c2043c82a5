//! Results as tables: medians over seeds, with their range.

use std::fmt::Write;

use anyhow::Result;
use dvr_report::chart::median;

use super::results::{Outcome, Results};
use crate::commands::points_table::significant;
use crate::commands::provenance::{KeyColumns, origin};

/// A column: its head, its value, and how it is printed.
type Column = (&'static str, fn(&Outcome) -> Option<f64>, Digits);

/// How a number is printed.
#[derive(Clone, Copy)]
enum Digits {
    /// With this many decimals.
    Decimals(usize),
    /// With four significant digits, whatever its unit.
    Significant,
}

use Digits::{Decimals, Significant};

const COLUMNS: [Column; 13] = [
    ("whole job, s", |o| o.seconds, Decimals(1)),
    ("training, s", |o| o.training_seconds, Decimals(2)),
    ("CPU, s", |o| o.cpu_seconds, Decimals(1)),
    ("MB", |o| Some(o.peak_memory? as f64 / 1e6), Decimals(0)),
    ("stored kB", |o| Some(o.bytes? as f64 / 1e3), Decimals(0)),
    ("Chamfer-L1", |o| o.chamfer_l1, Decimals(4)),
    ("floor", |o| o.floor, Decimals(4)),
    ("normals", |o| o.normals, Decimals(3)),
    ("volume IoU", |o| o.volume_iou, Decimals(3)),
    (POINTS, |o| o.points_mean, Significant),
    ("points: median", |o| o.points_median, Significant),
    ("test PSNR, dB", |o| o.psnr, Decimals(2)),
    ("silhouette IoU", |o| o.mask_iou, Decimals(4)),
];

/// Head of the mean distance of verified points.
const POINTS: &str = "points: mean";

/// Markdown, one line for each scene, supervision and method.
pub fn markdown(results: &Results) -> String {
    let origin = origin(results.outcomes.iter().map(|outcome| outcome.key.as_ref()));
    let mut text = format!(
        "{origin}. Seeds: how many of all gave a mesh. Median over seeds (range). Lengths in edges of the object cube; papers print Chamfer-L1 times 10. \
         PSNR and silhouettes are of the coloured mesh on test views."
    );
    let (heads, rows) = rows(&results.outcomes);
    if heads.contains(&POINTS) {
        text += " Points: distance from verified points to the mesh, mean and median over the points, in the units of the files.";
    }
    text += "\n\n";
    let _ = writeln!(text, "| {} |", heads.join(" | "));
    let _ = writeln!(text, "|{}", "---|".repeat(heads.len()));
    for row in rows {
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    text
}

/// Heads and rows, one row per scene, supervision and method; figures that were not measured have no column.
pub fn rows(outcomes: &[Outcome]) -> (Vec<&'static str>, Vec<Vec<String>>) {
    let is_measured = |column: &&Column| outcomes.iter().any(|outcome| column.1(outcome).is_some());
    let columns: Vec<&Column> = COLUMNS.iter().filter(is_measured).collect();
    let heads = ["scene", "from", "method", "seeds"].into_iter().chain(columns.iter().map(|column| column.0)).collect();
    let row = |group: &Vec<&Outcome>| {
        let first = group[0];
        let names = [first.scene.clone(), first.supervision.clone(), first.method.clone(), share(group)];
        let cells = columns.iter().map(|(_, value, digits)| cell(group, value, *digits));
        names.into_iter().chain(cells).collect()
    };
    (heads, grouped(outcomes).iter().map(row).collect())
}

/// How many seeds gave a mesh, of how many.
fn share(group: &[&Outcome]) -> String {
    let succeeded = group.iter().filter(|outcome| outcome.has_succeeded()).count();
    format!("{succeeded} of {}", group.len())
}

/// Outcomes that differ in their seed only, in the order in which they first appear.
pub fn grouped(outcomes: &[Outcome]) -> Vec<Vec<&Outcome>> {
    let key = |o: &Outcome| (o.scene.clone(), o.supervision.clone(), o.method.clone());
    let mut groups: Vec<Vec<&Outcome>> = Vec::new();
    for outcome in outcomes {
        match groups.iter_mut().find(|group| key(group[0]) == key(outcome)) {
            Some(group) => group.push(outcome),
            None => groups.push(vec![outcome]),
        }
    }
    groups
}

/// Median and range.
fn cell(group: &[&Outcome], value: &fn(&Outcome) -> Option<f64>, digits: Digits) -> String {
    let mut values: Vec<f64> = group.iter().filter_map(|outcome| value(outcome)).collect();
    values.sort_by(f64::total_cmp);
    let print = |value: f64| match digits {
        Decimals(count) => format!("{value:.count$}"),
        Significant => significant(value),
    };
    match values[..] {
        [] if group.iter().any(|outcome| outcome.faces == Some(0)) => "no mesh".into(),
        [] if group.iter().any(|outcome| outcome.failure.is_some()) => "failed".into(),
        [] => String::new(),
        [one] => print(one),
        [low, .., high] => {
            let (low, high, median) = (print(low), print(high), print(median(&values)));
            if low == high { median } else { format!("{median} ({low}-{high})") }
        }
    }
}

/// All figures of all runs, with what they were made of.
pub fn csv(outcomes: &[Outcome]) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for outcome in outcomes {
        let figures = Outcome { key: None, ..outcome.clone() };
        writer.serialize((figures, KeyColumns::of(outcome.key.as_ref())))?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(scene: &str, method: &str, seed: u64, seconds: f64, chamfer: Option<f64>) -> Outcome {
        let json = serde_json::json!({
            "scene": scene, "method": method, "seed": seed, "seconds": seconds, "chamfer_l1": chamfer,
            "faces": chamfer.map_or(0, |_| 8),
        });
        serde_json::from_value(json).unwrap()
    }

    #[test]
    fn seeds_become_a_median_and_a_range_and_missing_meshes_are_named() {
        let outcomes = vec![
            outcome("a", "grid", 0, 3.0, Some(0.003)),
            outcome("a", "slow", 0, 9.0, None),
            outcome("a", "grid", 1, 1.0, Some(0.004)),
            outcome("a", "grid", 2, 2.0, Some(0.0035)),
        ];
        let failed = Outcome { failure: Some("error: no".into()), seconds: None, ..outcomes[1].clone() };
        let outcomes = [outcomes, vec![Outcome { seed: 3, faces: None, ..failed }]].concat();
        let results = Results { outcomes };
        let table = markdown(&results);
        assert!(table.contains("| a |  | grid | 3 of 3 | 2.0 (1.0-3.0) | 0.0035 (0.0030-0.0040) |"), "{table}");
        assert!(table.contains("| a |  | slow | 0 of 2 | 9.0 | no mesh |"), "{table}");
        assert!(!table.contains("volume IoU") && !table.contains("points"), "not measured");
        let by_points =
            Outcome { points_mean: Some(0.00259), points_median: Some(318.24), ..outcome("a", "grid", 0, 3.0, None) };
        let table = markdown(&Results { outcomes: vec![by_points] });
        assert!(
            table.contains("| points: mean | points: median |") && table.contains("| 0.002590 | 318.2 |"),
            "{table}"
        );
        let csv = csv(&results.outcomes).unwrap();
        assert_eq!(csv.lines().count(), 6);
        assert!(csv.lines().next().unwrap().ends_with("scene_digest,settings_digest,program,machine"), "{csv}");
    }
}
