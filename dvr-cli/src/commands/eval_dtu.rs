//! A surface by the protocol of DTU: measured, and printed for people.

use std::path::Path;

use anyhow::{Result, bail};
use dvr_core::mesh::Mesh;
use dvr_core::metrics::dtu::{DtuDistances, DtuReference, DtuScore, DtuSettings, FARTHEST, cull, score_dtu};
use dvr_core::{Scene, View};
use serde::Serialize;

use super::points_table::{percent, significant};
use crate::args::EvalArgs;

/// The figures, and what was done to the surface before it was measured.
#[derive(Serialize)]
pub struct DtuEvaluation {
    /// The scan.
    scan: u32,
    /// By how many pixels the masks were dilated that the surface was culled by; `None` where it was not.
    culled_by_masks_dilated_px: Option<f64>,
    #[serde(flatten)]
    score: DtuScore,
}

/// Measures a mesh in the coordinates of the scene's files, where the arguments ask for it.
pub fn score_by_dtu(args: &EvalArgs, mesh: &Mesh, scene: Option<&Scene>) -> Result<Option<DtuEvaluation>> {
    let protocol = &args.protocol;
    let (Some(_), Some(folder)) = (protocol.protocol, &protocol.reference) else { return Ok(None) };
    let scan = match protocol.scan {
        Some(scan) => scan,
        None => scan_of(folder, [scene.map(|scene| scene.source.as_path()), args.subject.as_deref()])?,
    };
    let reference = DtuReference::read(folder, scan)?;
    let culled = match (protocol.cull, scene) {
        (Some(_), None) => bail!("--cull leaves out what masks do not show: give the scene with --data"),
        (Some(dilation), Some(scene)) => Some(culled(mesh, scene, dilation)?),
        (None, _) => None,
    };
    let settings = DtuSettings { align: protocol.align, seed: args.seed };
    let score = score_dtu(culled.as_ref().unwrap_or(mesh), &reference, &settings)?;
    Ok(Some(DtuEvaluation { scan, culled_by_masks_dilated_px: protocol.cull, score }))
}

/// The only scan of a folder, or else the one that the paths of scene or mesh name.
fn scan_of(folder: &Path, paths: [Option<&Path>; 2]) -> Result<u32> {
    let scans = DtuReference::scans(folder);
    if let [scan] = scans[..] {
        return Ok(scan);
    }
    if scans.is_empty() {
        bail!(
            "{}: no scan has its files here. Give the folder that holds DTU's ObsMask (ObsMask24_10.mat, Plane24.mat) and Points \
             (stl/stl024_total.ply)",
            folder.display()
        );
    }
    if let Some(scan) = paths.into_iter().flatten().find_map(named_scan) {
        return Ok(scan);
    }
    let some: Vec<String> = scans.iter().take(8).map(u32::to_string).collect();
    let more = if scans.len() > some.len() { ", ..." } else { "" };
    bail!("{} has {} scans ({}{more}): say with --scan which one it is", folder.display(), scans.len(), some.join(", "))
}

/// The number behind `scan` in the last part of a path that has one.
pub fn named_scan(path: &Path) -> Option<u32> {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned()).to_string_lossy().to_lowercase();
    path.rmatch_indices("scan").find_map(|(at, word)| {
        let digits = &path[at + word.len()..];
        let end = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
        digits[..end].parse().ok()
    })
}

/// The mesh without what the masks of the scene's views do not show.
fn culled(mesh: &Mesh, scene: &Scene, dilation: f64) -> Result<Mesh> {
    scene.require_masks()?;
    let in_world = |view: &View| view.camera.into_world(&scene.object_to_world);
    let views = scene.views.iter().filter_map(|view| Some((in_world(view), view.mask.as_ref()?)));
    Ok(cull(mesh, &views.collect::<Vec<_>>(), dilation))
}

/// Prints what a surface scores.
pub fn print_dtu(evaluation: &DtuEvaluation) {
    let score = &evaluation.score;
    println!("DTU protocol, scan {} (mm)", evaluation.scan);
    println!("  {:<26}{:>9}{:>9}{:>12}{:>18}", "", "mean", "median", "points", format!("{FARTHEST} mm or more"));
    let row = |name: &str, distances: &DtuDistances| {
        let beyond = percent(distances.beyond as f64 / distances.points.max(1) as f64);
        let (mean, median) = (significant(distances.mean), significant(distances.median));
        println!("  {name:<26}{mean:>9}{median:>9}{:>12}{beyond:>18}", distances.points);
    };
    row("accuracy", &score.accuracy);
    row("completeness", &score.completeness);
    println!("  {:<26}{:>9}", "overall", significant(score.overall));
    match evaluation.culled_by_masks_dilated_px {
        Some(dilation) => println!("  culled by the masks of all views, dilated by {dilation} pixels"),
        None => println!("  not culled by masks"),
    }
    match &score.alignment {
        Some(moved) => println!(
            "  aligned to the scan (ICP): scaled by {:.5}, turned by {:.3} degrees, then moved by {:.3} mm",
            moved.scale,
            moved.rotation.to_scaled_axis().length().to_degrees(),
            moved.translation.length()
        ),
        None => println!("  not aligned to the scan"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_number_behind_scan_in_a_path_is_that_of_the_scan() {
        assert_eq!(named_scan(Path::new("/nowhere/dtu_scan24/mesh.ply")), Some(24));
        assert_eq!(named_scan(Path::new("/nowhere/scan1/SCAN065-b.ply")), Some(65));
        assert_eq!(named_scan(Path::new("/nowhere/scanner/mesh.ply")), None);
    }
}
