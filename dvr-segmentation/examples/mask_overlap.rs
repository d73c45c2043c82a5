//! How well masks that were found overlap with those that a scene has: `mask_overlap SCENE MASKS [TRUE]`, where `MASKS` is a
//! folder of `dvr masks` or the `masks` of a run, and `TRUE` one of true masks for a scene that has none.

use std::error::Error;
use std::path::PathBuf;

use dvr_core::Mask;
use dvr_core::dataset::{ReadOptions, read_scene};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(scene), Some(found)) = (arguments.next(), arguments.next()) else {
        return Err(
            "give a scene, a folder of masks that were found, and one of true masks where the scene has none".into()
        );
    };
    let with_masks = |masks| read_scene(&scene, &ReadOptions { masks, ..ReadOptions::default() });
    let (given, found) = (with_masks(arguments.next())?, with_masks(Some(found))?);
    let pairs = given.views.iter().zip(&found.views);
    let mut overlaps: Vec<(f64, &str)> = pairs
        .filter_map(|(given, found)| Some((overlap(given.mask.as_ref()?, found.mask.as_ref()?), given.name.as_str())))
        .collect();
    overlaps.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(worst, view)) = overlaps.first() else { return Err("no view has both masks".into()) };
    let mean = overlaps.iter().map(|(overlap, _)| overlap).sum::<f64>() / overlaps.len() as f64;
    println!(
        "{} views: intersection over union {mean:.3} in the mean, {worst:.3} in the worst ({view})",
        overlaps.len()
    );
    Ok(())
}

/// Intersection over union.
fn overlap(a: &Mask, b: &Mask) -> f64 {
    let (width, height) = a.size();
    let pixels = || (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
    let both = pixels().filter(|&(u, v)| a.is_object(u, v) && b.is_object(u, v)).count();
    let either = pixels().filter(|&(u, v)| a.is_object(u, v) || b.is_object(u, v)).count();
    both as f64 / either.max(1) as f64
}
