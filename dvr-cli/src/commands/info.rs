//! `dvr info`: a scene's views, masks and bounds, with warnings and what to photograph again.

use std::process::ExitCode;

use anyhow::Result;
use dvr_core::Cancellation;
use dvr_core::hull::{Bounds, HullSettings, MaskDistance, OutlineContradictions, VisualHull, silhouette_consistency};
use dvr_core::{Advice, HOLD_OUT_EVERY, Orbit, Scene, Side, Split, UnitCube, View, abbreviated};
use serde::Serialize;

use super::masks::are_missing;
use super::{SceneReading, print_notes, refinement_notes};
use crate::args::InfoArgs;

/// Voxels per edge of the hull that masks are tested with.
const HULL_RESOLUTION: usize = 96;

/// Share of a mask that the hull may leave unexplained without a warning.
const UNEXPLAINED_WARNING: f64 = 0.02;

/// Share of the hull that may lie beyond the region of interest without a warning.
const BEYOND_WARNING: f64 = 0.05;

/// What is printed with `--json`.
#[derive(Serialize)]
struct Info {
    name: String,
    format: &'static str,
    train: usize,
    val: usize,
    test: usize,
    /// How the views are divided by a run with the default settings.
    rule: String,
    views: Vec<ViewInfo>,
    object_center_world: [f64; 3],
    object_edge_world: f64,
    /// The region of interest, in the units of the scene.
    region_box: [[f64; 3]; 2],
    /// What decided the region.
    region_by: String,
    /// `None` without masks.
    hull_share_of_cube: Option<f64>,
    hull_box: Option<[[f64; 3]; 2]>,
    sparse_points: usize,
    has_surface_truth: bool,
    has_occupancy_truth: bool,
    warnings: Vec<String>,
    /// What to photograph again.
    advice: Vec<Advice>,
}

#[derive(Serialize)]
struct ViewInfo {
    name: String,
    split: Split,
    width: u32,
    height: u32,
    focal_pixels: f64,
    distance: f64,
    /// The side of the object that the camera looks at.
    #[serde(flatten)]
    side: Side,
    /// `None` without a mask.
    object_share: Option<f64>,
    has_depth: bool,
    /// `None` without a mask.
    unexplained_share: Option<f64>,
}

/// Reads, looks, prints.
pub fn run(args: &InfoArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let divide = |scene: &mut Scene| Ok(scene.hold_out(HOLD_OUT_EVERY));
    let reading = SceneReading::of_arguments(&args.reading);
    let (scene, views, refined) = reading.read(&args.scene, divide, cancellation)?;
    let mut info = look(&scene, views.rule)?;
    info.warnings.extend(refinement_notes(&refined));
    info.warnings.extend(contradictions(&scene, cancellation)?);
    info.advice = scene.advice(cancellation)?;
    if let Err(error) = scene.require_masks() {
        info.warnings
            .push(if are_missing(&scene, args.reading.masks.as_ref()) {
                "no view has a mask: `dvr train` finds them from all views together, and `dvr masks` alone does so; --background \
                 COLOR makes masks from a plain background"
                    .to_owned()
            } else {
                format!("training needs masks: {error} (--background COLOR makes masks from a plain background)")
            });
    }
    if args.json {
        println!("{}", serde_json::to_string_pretty(&info)?);
    } else {
        print(&info);
    }
    Ok(ExitCode::SUCCESS)
}

fn look(scene: &Scene, rule: String) -> Result<Info> {
    let mut warnings = scene.warnings.clone();
    warnings.extend(scene.region_notes());
    let to_world = |b: Bounds| [b.min, b.max].map(|point| scene.object_to_world.transform_point(point).to_array());
    let (hull, unexplained) = hull_of_masks(scene, &mut warnings)?;
    let beyond = hull.as_ref().map_or(0.0, |hull| share_beyond(hull, &scene.region.bounds));
    if beyond > BEYOND_WARNING {
        warnings.push(format!(
            "{:.0} % of the masks' visual hull in the unit cube lies beyond the region of interest: few views look there",
            100.0 * beyond
        ));
    }
    let shares = scene.views.iter().zip(&unexplained).filter_map(|(view, share)| Some((view.name.as_str(), (*share)?)));
    warnings.extend(unexplained_warning(shares.filter(|(_, share)| *share > UNEXPLAINED_WARNING).collect()));
    let orbit = Orbit::of(scene);
    let views = scene.views.iter().zip(&orbit.sides).zip(&unexplained).map(|((view, &side), &unexplained_share)| {
        let (width, height) = view.image.dimensions();
        ViewInfo {
            name: view.name.clone(),
            split: view.split,
            width,
            height,
            focal_pixels: view.camera.intrinsics.x_axis.x,
            distance: view.camera.center().length() * scene.object_to_world.scale,
            side,
            object_share: (view.training_mask())
                .map(|mask| mask.object_pixels() as f64 / (f64::from(width) * f64::from(height))),
            has_depth: view.depth.is_some(),
            unexplained_share,
        }
    });
    let count = |split| scene.views_of(split).count();
    Ok(Info {
        name: scene.name.clone(),
        format: scene.format,
        train: count(Split::Train),
        val: count(Split::Val),
        test: count(Split::Test),
        rule,
        views: views.collect(),
        object_center_world: scene.object_to_world.translation.to_array(),
        object_edge_world: scene.object_to_world.scale,
        region_box: to_world(scene.region.bounds),
        region_by: scene.region.to_string(),
        hull_share_of_cube: hull.as_ref().map(VisualHull::volume),
        hull_box: (hull.as_ref()).and_then(VisualHull::bounding_box).map(to_world),
        sparse_points: scene.sparse_points.as_ref().map_or(0, |points| points.cloud.points.len()),
        has_surface_truth: scene.ground_truth.surface.is_some(),
        has_occupancy_truth: scene.ground_truth.occupancy.is_some(),
        warnings,
        advice: Vec::new(),
    })
}

/// What to say of views whose masks no visual hull explains, each with the share that it leaves: the worst by name.
fn unexplained_warning(mut views: Vec<(&str, f64)>) -> Option<String> {
    views.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    let (worst, _) = views.first()?;
    let named: Vec<String> = views.iter().map(|(name, share)| format!("{name:?} ({:.1} %)", 100.0 * share)).collect();
    Some(format!(
        "no visual hull explains a part of the mask of {}; check mask and camera of these views, or leave them out, as with \
         --ignore {worst}",
        abbreviated(&named)
    ))
}

/// What the masks' outlines say against each other.
fn contradictions(scene: &Scene, cancellation: &Cancellation) -> Result<Option<String>> {
    let seen: Vec<_> = scene.views.iter().filter_map(|view| Some((view, view.training_pair()?))).collect();
    let names: Vec<&str> = seen.iter().map(|(view, _)| view.name.as_str()).collect();
    let cameras: Vec<_> = seen.iter().map(|(_, (camera, _))| *camera).collect();
    let masks: Vec<MaskDistance> = seen.iter().map(|(_, (camera, mask))| MaskDistance::new(camera, mask)).collect();
    Ok(OutlineContradictions::find(&cameras, &masks, cancellation)?.note(&names))
}

/// The hull of the masks that training uses, without masks `None`, and for each view the share of its mask that the hull
/// leaves unexplained.
fn hull_of_masks(scene: &Scene, warnings: &mut Vec<String>) -> Result<(Option<VisualHull>, Vec<Option<f64>>)> {
    let pairs: Vec<_> = scene.views.iter().filter_map(View::training_pair).collect();
    if pairs.is_empty() {
        return Ok((None, vec![None; scene.views.len()]));
    }
    let bounds = Bounds::from(UnitCube::default());
    let hull = VisualHull::carve(&pairs, bounds, HULL_RESOLUTION, &HullSettings::default())?;
    // Without a strict hull, views are measured against the hull of what all but a few agree on.
    let (reference, tolerated) = if hull.is_empty() { robust_hull(&pairs, bounds)? } else { (hull.clone(), 0) };
    if hull.is_empty() {
        warnings.push(if tolerated == 0 {
            "no visual hull explains these masks: cameras, masks or scale are wrong".to_owned()
        } else {
            format!(
                "the masks have no common visual hull; one appears when {tolerated} of them may be wrong at each point"
            )
        });
    }
    let mut shares = silhouette_consistency(&pairs, &reference)?.into_iter();
    let unexplained = scene.views.iter().map(|view| view.training_mask().and_then(|_| shares.next()));
    Ok((Some(hull), unexplained.collect()))
}

/// The share of a hull's voxels whose centres lie more than a voxel beyond a box.
fn share_beyond(hull: &VisualHull, bounds: &Bounds) -> f64 {
    let voxel = hull.voxel_size();
    let (low, high) = (bounds.min - voxel, bounds.max + voxel);
    let beyond = hull.centers().filter(|center| center.cmplt(low).any() || center.cmpgt(high).any()).count();
    beyond as f64 / hull.occupied_voxels().max(1) as f64
}

/// The hull with the fewest views allowed to disagree that is not empty, up to half of them; 0 where there is none.
fn robust_hull(pairs: &[(&dvr_core::Camera, &dvr_core::Mask)], bounds: Bounds) -> Result<(VisualHull, usize)> {
    let mut hull = VisualHull::carve(pairs, bounds, HULL_RESOLUTION, &HullSettings::default())?;
    for max_disagreeing in 1..=pairs.len() / 2 {
        let settings = HullSettings { max_disagreeing, ..HullSettings::default() };
        hull = VisualHull::carve(pairs, bounds, HULL_RESOLUTION, &settings)?;
        if !hull.is_empty() {
            return Ok((hull, max_disagreeing));
        }
    }
    Ok((hull, 0))
}

fn print(info: &Info) {
    println!("{}: {}", info.name, info.format);
    println!("  views       {} to train on, {} for validation, {} for testing", info.train, info.val, info.test);
    println!("              {}", info.rule);
    let range = |part: fn(&ViewInfo) -> f64| {
        let values = || info.views.iter().map(part);
        (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
    };
    let sizes: std::collections::BTreeSet<_> = info.views.iter().map(|v| (v.width, v.height)).collect();
    let sizes: Vec<_> = sizes.iter().map(|(w, h)| format!("{w}x{h}")).collect();
    println!("  images      {} pixels", sizes.join(", "));
    let (near, far) = range(|v| v.focal_pixels);
    println!("  focal       {near:.1} to {far:.1} pixels");
    let (near, far) = range(|v| v.distance);
    println!("  cameras     {near:.4} to {far:.4} from the object's middle (scene units)");
    let (low, high) = range(|v| v.side.elevation);
    let first = info.views.first().map_or("", |view| &view.name);
    println!("  elevation   {low:.0} to {high:.0} degrees; azimuth 0 is `{first}`, counter-clockwise seen from above");
    let shares: Vec<f64> = info.views.iter().filter_map(|view| view.object_share).collect();
    if shares.is_empty() {
        println!("  masks       none");
    } else {
        let (least, most) = shares.iter().fold((f64::INFINITY, 0f64), |(a, b), &share| (a.min(share), b.max(share)));
        println!("  masks       the object fills {:.1} to {:.1} % of a picture", 100.0 * least, 100.0 * most);
    }
    let with_depth = info.views.iter().filter(|v| v.has_depth).count();
    println!("  depth maps  {with_depth}");
    if info.sparse_points > 0 {
        println!("  sparse      {} points", info.sparse_points);
    }
    let [x, y, z] = info.object_center_world;
    println!("  unit cube   centre ({x:.5}, {y:.5}, {z:.5}), edge {:.5} scene units", info.object_edge_world);
    println!("  region      {}, by {}", box_text(info.region_box), info.region_by);
    match (info.hull_box, info.hull_share_of_cube) {
        (Some(hull), Some(share)) => {
            println!("  hull        {}, {:.1} % of the unit cube", box_text(hull), 100.0 * share);
        }
        (None, Some(_)) => println!("  hull        empty"),
        (_, None) => println!("  hull        unknown without masks"),
    }
    let truth = match (info.has_surface_truth, info.has_occupancy_truth) {
        (true, true) => "surface points and occupancies",
        (true, false) => "surface points",
        (false, true) => "occupancies",
        (false, false) => "none",
    };
    println!("  truth       {truth}");
    print_notes(&info.warnings);
    print_notes(&info.advice.iter().map(Advice::to_string).collect::<Vec<_>>());
}

/// The corners of a box.
fn box_text([low, high]: [[f64; 3]; 2]) -> String {
    let corner = |[x, y, z]: [f64; 3]| format!("({x:.5}, {y:.5}, {z:.5})");
    format!("{} to {}", corner(low), corner(high))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_views_that_no_hull_explains_the_worst_are_named() {
        assert_eq!(unexplained_warning(Vec::new()), None);
        let said = unexplained_warning(vec![("a", 0.031)]).unwrap();
        assert!(said.contains("of \"a\" (3.1 %); check") && said.contains("--ignore a"), "{said}");
        let said =
            unexplained_warning([("a", 0.03), ("b", 0.5)].into_iter().chain([("c", 0.02); 8]).collect()).unwrap();
        assert!(
            said.contains("of \"b\" (50.0 %), \"a\" (3.0 %), \"c\"") && said.contains(" and 2 more; check"),
            "{said}"
        );
    }
}
