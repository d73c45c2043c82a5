//! What must hold for every drawing.

use super::*;

/// Whether tags are balanced and what stands between them is escaped: well-formed, as far as our own output goes.
fn assert_well_formed(svg: &str) {
    let mut open = Vec::new();
    let mut rest = svg;
    while let Some(at) = rest.find('<') {
        let text = &rest[..at];
        assert!(!text.contains('>'), "a stray `>` in {text:?}");
        text.match_indices('&').for_each(|(i, _)| assert!(text[i..].find(';').is_some_and(|end| end < 8), "{text:?}"));
        let end = at + rest[at..].find('>').expect("a tag that does not end");
        let tag = &rest[at + 1..end];
        assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
        match tag.strip_prefix('/') {
            Some(name) => assert_eq!(open.pop().as_deref(), Some(name)),
            None if tag.ends_with('/') => {}
            None => open.push(tag.split(' ').next().unwrap_or_default().to_owned()),
        }
        rest = &rest[end + 1..];
    }
    assert!(open.is_empty() && rest.trim().is_empty(), "{open:?} {rest:?}");
}

fn chart() -> Chart {
    let curve = Series::of_seeds("grid <&>", &[vec![[1.0, 20.0], [3.0, 24.0]], vec![[1.0, 22.0], [3.0, 25.0]]]);
    Chart {
        title: "Quality \"against\" time & <seeds>".into(),
        x: Axis::log("time, s"),
        y: Axis::linear("PSNR, dB"),
        series: vec![curve, Series::dots("hull, as is", vec![[0.5, 18.0], [f64::NAN, 1.0], [-1.0, 2.0]])],
        pareto: Some([Better::Less, Better::More]),
    }
}

#[test]
fn a_chart_is_well_formed_and_shows_everything_that_has_a_place() {
    let svg = chart().to_svg();
    assert_well_formed(&svg);
    assert!(svg.contains("class=\"band\"") && svg.contains("class=\"front\""));
    assert_eq!(
        svg.matches("<circle class=\"dot\"").count(),
        2 + 1 + 1,
        "two of the curve, one of the hull, one in the legend"
    );
    assert!(svg.contains("time, s") && svg.contains("PSNR, dB"), "axes have titles with units");
    assert!(!svg.contains("NaN") && svg.len() < 12_000, "{}", svg.len());
    assert_well_formed(&chart().to_figure());
}

#[test]
fn a_chart_without_points_says_so() {
    let empty = Chart { series: vec![Series::line("x", vec![[f64::NAN, 1.0]])], ..chart() };
    assert!(empty.is_empty() && !chart().is_empty());
    let svg = empty.to_svg();
    assert_well_formed(&svg);
    assert!(svg.contains("nothing was measured"));
    assert_well_formed(&Chart::default().to_svg());
}

#[test]
fn the_numbers_of_a_chart_are_a_csv_file() {
    let csv = chart().to_csv();
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines[0], "series,\"time, s\",\"PSNR, dB\",low,high");
    assert_eq!(lines[1], "grid <&>,1,21,20,22");
    assert_eq!(lines[3], "\"hull, as is\",0.5,18,,");
}

#[test]
fn a_grid_shows_numbers_failures_and_holes() {
    let grid = HeatGrid {
        title: "Where it breaks".into(),
        value: Axis::log("Chamfer-L1"),
        row_title: "method".into(),
        column_title: "radius, px".into(),
        rows: vec!["grid".into(), "a & b".into()],
        columns: ["2", "1", "0.5"].map(String::from).to_vec(),
        cells: vec![
            vec![0.002.into(), 0.02.into(), Cell { value: None, failed: Some("empty".into()) }],
            vec![0.004.into()],
        ],
    };
    let svg = grid.to_svg();
    assert_well_formed(&svg);
    assert_eq!(svg.matches("class=\"cell").count(), 6);
    assert!(svg.contains("class=\"cell s0\"") && svg.contains("class=\"cell failed\"") && svg.contains(">empty<"));
    assert_eq!(grid.to_csv().lines().count(), 5);
    assert_well_formed(&HeatGrid::default().to_svg());
}

#[test]
fn titles_become_names_of_files() {
    assert_eq!(file_name("Test-view PSNR, dB (bunny)"), "test-view-psnr-db-bunny");
    assert_eq!(file_name("???"), "chart");
}
