//! The cells of a stress test, and how long missing ones take.

use std::fmt;
use std::path::Path;

use anyhow::Result;
use dvr_stress::Axis;

use super::task::Task;
use crate::args::{StressArgs, Variant};
use crate::commands::kept_row::{Kept, Standing};

/// All cells: for each scene the hull first, so that the other methods can be compared with it.
pub fn plan<'a>(args: &StressArgs, axes: &'a [Axis], out: &'a Path) -> Vec<Task<'a>> {
    let mut variants = args.variants();
    variants.sort_by_key(|variant| variant.name != "hull");
    let mut tasks = Vec::new();
    for axis in axes {
        let difficulties = if args.full { axis.difficulties } else { axis.quick };
        for &difficulty in difficulties {
            let rules =
                Task::rules().map(|name| Variant { name: name.into(), method: String::new(), settings: vec![] });
            let tried = if axis.case(difficulty).is_some() { &variants[..] } else { &rules[..] };
            for seed in 0..args.seeds() {
                tasks.extend(tried.iter().map(|variant| Task {
                    axis,
                    difficulty,
                    seed,
                    variant: variant.clone(),
                    out,
                }));
            }
        }
    }
    tasks
}

/// Seconds that a cell of a method usually takes on two cores.
fn usual_seconds(method: &str) -> f64 {
    match method {
        "hull" => 3.0,
        "grid" => 6.0,
        "network" => 110.0,
        "classic" => 140.0,
        _ => 0.0,
    }
}

/// How long it will take.
pub struct Estimate {
    standing: Standing,
    seconds: f64,
}

impl Estimate {
    /// By the times of stored cells of the same method, or else by usual times.
    pub fn of(tasks: &[Task]) -> Result<Self> {
        let mut measured: Vec<(&str, f64)> = Vec::new();
        let mut missing = Vec::new();
        let mut standing = Standing::default();
        for task in tasks {
            let kept = task.kept()?;
            standing.count(&task.name(), &kept);
            match kept {
                Kept::Row(stored) => measured.push((&task.variant.name, stored.seconds)),
                _ => missing.push(task),
            }
        }
        let expected = |variant: &Variant| {
            let own = measured.iter().filter(|(name, _)| *name == variant.name).map(|(_, seconds)| seconds);
            let (sum, count) = own.fold((0.0, 0), |(sum, count), seconds| (sum + seconds, count + 1));
            if count > 0 { sum / f64::from(count) } else { usual_seconds(&variant.method) }
        };
        let seconds = missing.iter().map(|task| expected(&task.variant)).sum();
        Ok(Self { standing, seconds })
    }
}

impl fmt::Display for Estimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { standing, seconds } = self;
        write!(f, "cells: {standing}")?;
        if standing.kept == standing.all {
            return Ok(());
        }
        let time = match seconds {
            s if *s < 90.0 => format!("{s:.0} seconds"),
            s if *s < 5400.0 => format!("{:.0} minutes", s / 60.0),
            s => format!("{:.1} hours", s / 3600.0),
        };
        write!(f, "; what is missing takes about {time}")
    }
}

#[cfg(test)]
mod tests {
    use dvr_stress::axes;

    use super::*;

    fn args(full: bool) -> StressArgs {
        StressArgs {
            out: None,
            axis: vec![],
            methods: vec![],
            variant: vec![],
            against: None,
            seeds: None,
            full,
            list: false,
        }
    }

    #[test]
    fn the_quick_set_takes_minutes_and_the_full_set_hours() {
        let folder = tempfile::tempdir().unwrap();
        let axes = axes();
        let estimate = |full: bool| Estimate::of(&plan(&args(full), &axes, folder.path())).unwrap();
        let (quick, full) = (estimate(false), estimate(true));
        assert!(quick.seconds < 3600.0 && quick.to_string().contains("minutes"), "{quick}");
        assert!(full.seconds > 10.0 * quick.seconds && full.to_string().contains("hours"), "{full}");
    }

    #[test]
    fn the_hull_comes_before_the_methods_that_are_compared_with_it() {
        let axes = axes();
        let args = StressArgs {
            methods: vec![crate::args::MethodName("grid"), crate::args::MethodName("hull")],
            ..args(false)
        };
        let tasks = plan(&args, &axes[..1], Path::new("nowhere"));
        assert_eq!([&tasks[0], &tasks[1]].map(|task| task.variant.name.as_str()), ["hull", "grid"]);
    }
}
