//! A mesh against verified points: measured, and printed for people.

use anyhow::Result;
use dvr_core::mesh::Mesh;
use dvr_core::metrics::points::{DistanceSummary, HiddenPoints, PointsFloor, PointsSettings, Witnesses};
use dvr_core::{Scene, VerifiedPoints};
use dvr_train::PointsEvaluation;

use crate::args::EvalPointsArgs;

/// Measures a mesh, in the coordinates of the scene's files, by the points that the arguments name, else by those that
/// come with the scene. `None` where there are none, or no mesh.
pub fn score_by_points(
    args: &EvalPointsArgs,
    mesh: &Mesh,
    scene: Option<&Scene>,
    trained_on_points: bool,
) -> Result<Option<PointsEvaluation>> {
    let settings = settings(args);
    if mesh.is_empty() {
        return Ok(None);
    }
    Ok(match (&args.points, scene) {
        (Some(file), _) => Some(PointsEvaluation::of_file(mesh, file, scene, trained_on_points, &settings)?),
        (None, Some(scene)) => PointsEvaluation::of_scene(mesh, scene, trained_on_points, &settings)?,
        (None, None) => None,
    })
}

/// The points that the arguments name, else those that come with the scene.
pub fn verified_points(args: &EvalPointsArgs, scene: &Scene) -> Result<Option<VerifiedPoints>> {
    Ok(match &args.points {
        Some(file) => Some(VerifiedPoints::read(file)?),
        None => VerifiedPoints::of_scene(scene),
    })
}

/// How points measure, as the arguments say.
pub fn settings(args: &EvalPointsArgs) -> PointsSettings {
    PointsSettings { thresholds: args.thresholds.clone(), margin: args.margin }
}

/// Prints what a mesh scores.
pub fn print_points(evaluation: &PointsEvaluation) {
    let score = &evaluation.score;
    println!("{} verified points: {} (unit: that of the files)", score.points, evaluation.source);
    if let Some(reason) = &evaluation.not_independent {
        println!("  not independent: {reason}");
    }
    print_distances(&score.distances, score.floor.as_ref());
    if let Some(floor) = &score.floor {
        println!(
            "  (floor: {} tracks of four views or more, split in two; features off by {:.2} pixels; exact cameras assumed)",
            floor.points, floor.feature_px
        );
    }
    if let Some(hidden) = &score.hidden {
        print_hidden(hidden);
    }
}

fn print_distances(distances: &DistanceSummary, floor: Option<&PointsFloor>) {
    let head = if floor.is_some() { "floor" } else { "" };
    let print = |line: String| println!("{}", line.trim_end());
    print(format!("  {:<22}{:>9}{head:>9}", "distance to the mesh", "result"));
    let row = |name: &str, value: f64, floor: Option<f64>| {
        print(format!("  {name:<22}{:>9}{:>9}", significant(value), floor.map_or(String::new(), significant)));
    };
    row("mean", distances.mean, floor.map(|floor| floor.mean));
    row("median", distances.median, floor.map(|floor| floor.median));
    row("90 % are below", distances.quantile_90, floor.map(|floor| floor.quantile_90));
    row("95 % are below", distances.quantile_95, None);
    row("99 % are below", distances.quantile_99, None);
    row("largest", distances.max, None);
    for below in &distances.below {
        println!("  {:<22}{:>9}", format!("below {}", below.threshold), percent(below.share));
    }
}

fn print_hidden(hidden: &HiddenPoints) {
    let row = |name: &str, value: String| println!("  {name:<40}{value:>9}");
    println!("  hidden: the mesh stands more than {} in front of a point", hidden.margin);
    match hidden.witnesses {
        Witnesses::Tracks => {
            if let Some(share) = hidden.blocked_sights {
                row("lines of sight of tracks, blocked", percent(share));
            }
            if let Some(share) = hidden.hidden_from_half {
                row("points, from half of their track or more", percent(share));
            }
            row("points, from their whole track", percent(hidden.hidden_from_all));
        }
        Witnesses::Frames => {
            println!("  (the points have no tracks: any view with the point in its frame may be the one that sees it)");
            row("points, from every view", percent(hidden.hidden_from_all));
            if let Some(share) = hidden.blocked_sights {
                row("lines of sight that must be blocked", percent(share));
            }
        }
    }
    if hidden.gap.max > 0.0 {
        row("how far in front, median", significant(hidden.gap.median));
        row("how far in front, 90 % are below", significant(hidden.gap.quantile_90));
        row("mesh area that stands in front, at least", percent(hidden.lump_share));
    }
}

pub fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// A length in four significant digits, whatever its unit.
pub fn significant(value: f64) -> String {
    let magnitude = if value > 0.0 { value.log10().floor() as i32 } else { 0 };
    format!("{value:.*}", (3 - magnitude).clamp(0, 12) as usize)
}

#[cfg(test)]
mod tests {
    use super::significant;

    #[test]
    fn lengths_have_four_significant_digits_in_any_unit() {
        assert_eq!(significant(0.39438), "0.3944");
        assert_eq!(significant(318.24), "318.2");
        assert_eq!(significant(0.0025919), "0.002592");
        assert_eq!(significant(123_456.0), "123456");
        assert_eq!(significant(0.0), "0.000");
    }
}
