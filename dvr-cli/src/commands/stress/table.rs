//! Results as a table: break points first, then axis by axis.

use std::fmt::Write;

use dvr_report::chart::median;
use dvr_stress::{Axis, BreakPoint, Case, Cell, Kind, Verdict, break_point};

use super::results::{Results, group_name};

/// Markdown.
pub fn markdown(results: &Results, axes: &[Axis]) -> String {
    let origin = results.origin();
    let mut text = format!(
        "{origin}. Each cell: Chamfer-L1 of the surface that at least two views see, above its floor, in pixels' footprints: \
         median over seeds (range); **bold**, with how many seeds are solved and why the others are not, where one is \
         not. A method holds where all seeds are solved.\n"
    );
    let (scenes, gradients): (Vec<&Axis>, Vec<&Axis>) =
        axes.iter().partition(|axis| matches!(axis.kind, Kind::Scene(_)));
    for axes in [scenes, gradients].into_iter().filter(|axes| !axes.is_empty()) {
        let methods = methods(results, &axes);
        break_points(&mut text, results, &axes, &methods);
        for axis in axes {
            one_axis(&mut text, results, axis, &methods);
        }
    }
    text
}

/// The methods on these axes, in the order in which they first appear.
pub fn methods<'a>(results: &'a Results, axes: &[&Axis]) -> Vec<&'a str> {
    let mut methods: Vec<&str> = Vec::new();
    for cell in results.cells().filter(|cell| axes.iter().any(|axis| axis.name == cell.axis)) {
        if !methods.contains(&cell.method.as_str()) {
            methods.push(&cell.method);
        }
    }
    methods
}

fn break_points(text: &mut String, results: &Results, axes: &[&Axis], methods: &[&str]) {
    let _ = writeln!(text, "\n| breaks at | unit | tested | {} |", methods.join(" | "));
    let _ = writeln!(text, "|{}", "---|".repeat(3 + methods.len()));
    for axis in axes {
        let tested = tested(results, axis);
        let point = |method: &&str| {
            let own: Vec<&Cell> = cells(results, axis, method).collect();
            if own.is_empty() { String::new() } else { point(&own, axis, &tested) }
        };
        let points: Vec<String> = methods.iter().map(point).collect();
        let tested: Vec<String> = tested.into_iter().map(Axis::label).collect();
        let _ = writeln!(text, "| {} | {} | {} | {} |", axis.name, axis.unit, tested.join(", "), points.join(" | "));
    }
}

/// A method's break point in words, with how many seeds are solved where there are several; `tested` are the
/// difficulties that any method was tested on.
fn point(own: &[&Cell], axis: &Axis, tested: &[f64]) -> String {
    let at = |difficulty: f64| own.iter().filter(move |cell| cell.difficulty == difficulty).copied();
    let is_own = |difficulty: &f64| at(*difficulty).next().is_some();
    let BreakPoint { holds, breaks } = break_point(axis.difficulties, own.iter().copied());
    let label = |difficulty: Option<f64>| difficulty.map(Axis::label).unwrap_or_default();
    let words = match (holds, breaks) {
        (_, None) if !tested.iter().all(is_own) => format!("holds {}", label(holds)),
        (_, None) => "holds".into(),
        (None, Some(_)) if !tested.first().is_some_and(is_own) => format!("{} or before", label(breaks)),
        (None, Some(_)) => "at once".into(),
        (Some(_), Some(_)) => format!("{} (holds {})", label(breaks), label(holds)),
    };
    let cells: Vec<&Cell> = breaks.or(holds).into_iter().flat_map(at).collect();
    let solved = cells.iter().filter(|cell| cell.verdict == Verdict::Solved).count();
    if cells.len() > 1 { format!("{words}: {solved} of {}", cells.len()) } else { words }
}

/// Difficulties of which there are cells.
pub fn tested(results: &Results, axis: &Axis) -> Vec<f64> {
    let has = |d: &f64| results.cells().any(|cell| cell.axis == axis.name && cell.difficulty == *d);
    axis.difficulties.iter().copied().filter(has).collect()
}

/// The cells of one method on one axis.
pub fn cells<'a>(results: &'a Results, axis: &Axis, method: &str) -> impl Iterator<Item = &'a Cell> {
    results.cells().filter(move |cell| cell.axis == axis.name && cell.method == method)
}

fn one_axis(text: &mut String, results: &Results, axis: &Axis, methods: &[&str]) {
    let _ = writeln!(text, "\n### {} ({})\n\n{}.\n", axis.name, group_name(axis.group), axis.what);
    let _ = writeln!(text, "| {} | {} |", axis.unit, methods.join(" | "));
    let _ = writeln!(text, "|{}", "---|".repeat(1 + methods.len()));
    for difficulty in tested(results, axis) {
        let case = axis.case(difficulty);
        let columns: Vec<String> = methods
            .iter()
            .map(|method| {
                let own: Vec<&Cell> = cells(results, axis, method).filter(|c| c.difficulty == difficulty).collect();
                entry(&own, case.as_ref())
            })
            .collect();
        let _ = writeln!(text, "| {} | {} |", Axis::label(difficulty), columns.join(" | "));
    }
}

/// Results of a method at one difficulty, over all seeds.
pub struct Summary<'a> {
    /// The figures of all seeds that have one, ascending; for scenes in pixels' footprints above the floor.
    pub values: Vec<f64>,
    /// Why seeds failed, each reason once.
    reasons: Vec<&'a str>,
    /// How many are solved.
    solved: usize,
    /// How many there are.
    all: usize,
}

/// Summarises the cells of one method and one difficulty.
pub fn summary<'a>(cells: &[&'a Cell], case: Option<&Case>) -> Summary<'a> {
    let figure = |cell: &&Cell| match (&cell.figures, case) {
        (Some(figures), Some(case)) => Some((cell.value? - figures.floor) / case.footprint()),
        _ => cell.value,
    };
    let mut values: Vec<f64> = cells.iter().filter_map(figure).collect();
    values.sort_by(f64::total_cmp);
    let mut reasons: Vec<&str> =
        cells.iter().filter(|cell| cell.verdict != Verdict::Solved).map(|cell| cell.verdict.name()).collect();
    let solved = cells.len() - reasons.len();
    reasons.sort_unstable();
    reasons.dedup();
    Summary { values, reasons, solved, all: cells.len() }
}

impl Summary<'_> {
    /// How many seeds are solved, where there are several, and why the others are not; `None` where all are solved.
    pub fn failure(&self) -> Option<String> {
        let reasons = self.reasons.join(", ");
        match self.all {
            _ if self.solved == self.all => None,
            1 => Some(reasons),
            all => Some(format!("{} of {all}: {reasons}", self.solved)),
        }
    }

    /// Median and range.
    fn figure(&self) -> Option<String> {
        let print = |value: f64| format!("{value:.3}");
        let (low, high) = (print(*self.values.first()?), print(*self.values.last()?));
        let median = print(median(&self.values));
        Some(if low == high { median } else { format!("{median} ({low}-{high})") })
    }
}

/// A summary in a table.
fn entry(cells: &[&Cell], case: Option<&Case>) -> String {
    let summary = summary(cells, case);
    match (summary.figure(), summary.failure()) {
        (Some(figure), None) => figure,
        (Some(figure), Some(failure)) => format!("**{figure}** {failure}"),
        (None, Some(failure)) => format!("**{failure}**"),
        (None, None) => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use dvr_stress::{Figures, axes};

    use super::*;
    use crate::commands::stress::results::Row;

    fn cell(method: &str, difficulty: f64, verdict: Verdict, value: Option<f64>) -> Cell {
        let figures = value.map(|_| Figures { floor: 0.002, ..Figures::default() });
        Cell { axis: "views".into(), difficulty, method: method.into(), seed: 0, verdict, value, figures, note: None }
    }

    /// The cells as if this program had made them.
    fn results(cells: impl IntoIterator<Item = Cell>) -> Results {
        Results { cells: cells.into_iter().map(Row::of_this_program).collect() }
    }

    #[test]
    fn one_seed_that_fails_is_no_longer_holding() {
        let seeds = |difficulty: f64, verdicts: [Verdict; 3]| {
            let cells = [0.002, 0.004, 0.006].into_iter().zip(verdicts).enumerate();
            cells.map(move |(seed, (value, verdict))| Cell {
                seed: seed as u64,
                ..cell("grid", difficulty, verdict, Some(value))
            })
        };
        let axes: Vec<Axis> = axes().into_iter().filter(|axis| axis.name == "views").collect();
        let all = [Verdict::Solved; 3];
        let text = markdown(&results(seeds(24.0, all)), &axes);
        assert!(text.contains("| views | views | 24 | holds: 3 of 3 |"), "{text}");
        let one_fails = [Verdict::Solved, Verdict::Inaccurate, Verdict::Solved];
        let text = markdown(&results(seeds(24.0, all).chain(seeds(6.0, one_fails))), &axes);
        assert!(text.contains("| 24, 6 | 6 (holds 24): 2 of 3 |"), "{text}");
        let cells = text.lines().find(|line| line.starts_with("| 6 |")).unwrap();
        assert!(cells.contains("(0.000-") && cells.contains("** 2 of 3: inaccurate |"), "{cells}");
        let text = markdown(&results(seeds(24.0, one_fails)), &axes);
        assert!(text.contains("| at once: 2 of 3 |"), "{text}");
    }

    #[test]
    fn the_table_says_what_failed_and_where_it_breaks() {
        let cells = vec![
            cell("grid", 24.0, Verdict::Solved, Some(0.002)),
            cell("grid", 6.0, Verdict::Inaccurate, Some(0.1)),
            cell("hull", 24.0, Verdict::Empty, None),
        ];
        let results = results(cells);
        let axes: Vec<Axis> = axes().into_iter().filter(|axis| axis.name == "views").collect();
        let text = markdown(&results, &axes);
        assert!(text.contains("| views | views | 24, 6 | 6 (holds 24) | at once |"), "{text}");
        assert!(text.contains("| 24 | 0.000 | **empty** |"), "{text}");
        assert!(text.contains("inaccurate |  |"), "{text}");

        // A rival that was tested only where the other fails.
        let rival = |verdict| {
            let cells = [cell("grid", 24.0, Verdict::Solved, None), cell("grid", 6.0, Verdict::Empty, None)];
            markdown(&self::results(cells.into_iter().chain([cell("rival", 6.0, verdict, None)])), &axes)
        };
        assert!(rival(Verdict::Empty).contains("| 6 (holds 24) | 6 or before |"));
        assert!(rival(Verdict::Solved).contains("| 6 (holds 24) | holds 6 |"));
    }
}
