//! The figures of a shape, for people.

use dvr_core::metrics::seen::SeenScore;
use dvr_train::ShapeEvaluation;

/// Prints the shape's figures, each Chamfer beside its floor.
pub fn print_shape(shape: &ShapeEvaluation) {
    if let Some(score) = &shape.surface {
        println!("shape (unit: edge of the object cube; papers print ten times the Chamfer distance)");
        println!("  {:<22}{:>9}{:>9}", "", "result", "floor");
        let floor = shape.floor.as_ref();
        let row = |name: &str, value: f64, floor: Option<f64>| {
            let floor = floor.map_or(String::new(), |f| format!("{f:.4}"));
            println!("  {name:<22}{value:>9.4}{floor:>9}");
        };
        row("Chamfer-L1", score.chamfer_l1, floor.map(|f| f.chamfer_l1));
        row("accuracy", score.accuracy, floor.map(|f| f.accuracy));
        row("completeness", score.completeness, floor.map(|f| f.completeness));
        if let Some(normals) = &score.normal_consistency {
            let floor = floor.and_then(|f| f.normal_consistency.as_ref()).map(|n| n.mean);
            row("normal consistency", normals.mean, floor);
        }
        for (i, f_score) in score.f_scores.iter().enumerate() {
            let floor = floor.and_then(|f| f.f_scores.get(i)).map(|f| f.f_score);
            row(&format!("F-score at {}", f_score.threshold), f_score.f_score, floor);
        }
    }
    if let Some(seen) = &shape.seen {
        print_seen(seen);
    }
    if let Some(iou) = shape.volume_iou {
        println!("  {:<22}{iou:>9.4}", "volume IoU");
    }
}

/// Prints the figures of what enough views see.
fn print_seen(seen: &SeenScore) {
    let SeenScore { views, true_share, predicted_share, score } = seen;
    println!(
        "  where {views} views see it: {:.0} % of the true surface, {:.0} % of the result",
        100.0 * true_share,
        100.0 * predicted_share
    );
    let row = |name: &str, value: f64| println!("    {name:<20}{value:>9.4}");
    row("Chamfer-L1", score.chamfer_l1);
    row("accuracy", score.accuracy);
    row("completeness", score.completeness);
    if let Some(normals) = &score.normal_consistency {
        row("normal consistency", normals.mean);
    }
    for f_score in &score.f_scores {
        row(&format!("F-score at {}", f_score.threshold), f_score.f_score);
    }
}
