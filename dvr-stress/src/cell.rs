//! Cells of the result table, and the break point of a method.

use serde::{Deserialize, Serialize};

use crate::verdict::{Figures, Verdict};

/// The result of a method at one difficulty of one axis, with one seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// The axis.
    pub axis: String,
    /// The difficulty, in the axis' unit.
    pub difficulty: f64,
    /// The method, or the slope rule.
    pub method: String,
    /// Seed of scene, faults and training.
    pub seed: u64,
    /// The verdict.
    pub verdict: Verdict,
    /// The figure that was judged: Chamfer-L1 of the seen surface in object units, or the error of a gradient; `None`
    /// without one.
    pub value: Option<f64>,
    /// All figures of a mesh.
    pub figures: Option<Figures>,
    /// The method's error message, where it failed.
    pub note: Option<String>,
}

/// How far along an axis a method works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BreakPoint {
    /// The hardest difficulty up to which every seed is solved; `None` where one of the easiest is not.
    pub holds: Option<f64>,
    /// The easiest difficulty that a seed fails; `None` where all are solved.
    pub breaks: Option<f64>,
}

/// The break point of one method's cells on one axis. `difficulties` run from easy to hard; those without cells are
/// skipped. A method holds where all seeds are solved: one that fails breaks it.
pub fn break_point<'a>(difficulties: &[f64], cells: impl IntoIterator<Item = &'a Cell> + Clone) -> BreakPoint {
    let mut point = BreakPoint { holds: None, breaks: None };
    for &difficulty in difficulties {
        let here = || cells.clone().into_iter().filter(|cell| cell.difficulty == difficulty);
        let (solved, all) = (here().filter(|cell| cell.verdict == Verdict::Solved).count(), here().count());
        match all {
            0 => {}
            _ if solved == all => point.holds = Some(difficulty),
            _ => {
                point.breaks = Some(difficulty);
                break;
            }
        }
    }
    point
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(verdicts: &[(f64, Verdict)]) -> Vec<Cell> {
        let cell = |&(difficulty, verdict): &(f64, Verdict)| Cell {
            axis: "a".into(),
            difficulty,
            method: "m".into(),
            seed: 0,
            verdict,
            value: None,
            figures: None,
            note: None,
        };
        verdicts.iter().map(cell).collect()
    }

    #[test]
    fn a_method_breaks_at_the_first_difficulty_that_one_seed_fails() {
        use Verdict::{Empty, Solved};
        let two_of_three = [(4.0, Solved), (4.0, Solved), (2.0, Empty), (2.0, Solved), (2.0, Solved), (1.0, Solved)];
        let point = break_point(&[4.0, 3.0, 2.0, 1.0], &cells(&two_of_three));
        assert_eq!((point.holds, point.breaks), (Some(4.0), Some(2.0)), "what is solved beyond does not count");
        let all = break_point(&[1.0, 2.0], &cells(&[(1.0, Solved), (2.0, Solved)]));
        assert_eq!((all.holds, all.breaks), (Some(2.0), None));
        let none = break_point(&[1.0], &cells(&[(1.0, Empty), (1.0, Solved)]));
        assert_eq!((none.holds, none.breaks), (None, Some(1.0)));
    }
}
