//! The depth maps of stereo, for people.

use dvr_core::metrics::depth_maps::DepthScore;
use dvr_core::metrics::points::DistanceSummary;
use dvr_train::DepthMapsEvaluation;

use super::points_table::{percent, significant};

/// Prints how far depth maps are off.
pub fn print_depth_maps(evaluation: &DepthMapsEvaluation) {
    println!(
        "depth maps of {} views, before training: {} of the object's pixels have a depth",
        evaluation.views,
        percent(evaluation.known)
    );
    if let Some(score) = &evaluation.surface {
        print_score("the true surface (unit: edge of the object cube)", score);
    }
    if let Some(score) = &evaluation.points {
        print_score("verified points (unit: that of the files)", score);
    }
}

/// The same in a line.
pub fn in_short(evaluation: &DepthMapsEvaluation) -> String {
    let of = |score: &Option<DepthScore>, truth: &str| {
        let of_score = |score: &DepthScore| {
            let [median, pixels] = [&score.distance, &score.disparity_px].map(|summary| summary.median);
            format!("; off by {} ({pixels:.2} pixels) in the median, against {truth}", significant(median))
        };
        score.as_ref().filter(|score| score.known > 0.0).map_or(String::new(), of_score)
    };
    format!(
        "depth maps before training: {} of the object's pixels have a depth{}{}",
        percent(evaluation.known),
        of(&evaluation.surface, "the true surface"),
        of(&evaluation.points, "verified points")
    )
}

fn print_score(truth: &str, score: &DepthScore) {
    println!("  against {truth}, {} lines of sight, {} with a depth", score.sights, percent(score.known));
    if score.known == 0.0 {
        return;
    }
    println!("  {:<22}{:>9}{:>9}", "off along the ray", "result", "pixels");
    let row = |name: &str, of: fn(&DistanceSummary) -> f64| {
        println!("  {name:<22}{:>9}{:>9.2}", significant(of(&score.distance)), of(&score.disparity_px));
    };
    row("mean", |summary| summary.mean);
    row("median", |summary| summary.median);
    row("90 % are below", |summary| summary.quantile_90);
    row("99 % are below", |summary| summary.quantile_99);
    let behind = score.median_behind;
    let side = if behind < 0.0 { "median, before" } else { "median, behind" };
    println!("  {side:<22}{:>9}", significant(behind.abs()));
    for below in &score.distance.below {
        println!("  {:<22}{:>9}", format!("below {}", below.threshold), percent(below.share));
    }
    for below in &score.disparity_px.below {
        println!("  {:<31}{:>9}", format!("below {} pixels", below.threshold), percent(below.share));
    }
}
