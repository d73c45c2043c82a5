//! `dvr info`: a scene's views, masks and bounds, with warnings.

use std::process::ExitCode;

use anyhow::Result;
use dvr_core::Cancellation;
use dvr_core::hull::{Bounds, HullSettings, VisualHull, silhouette_consistency};
use dvr_core::{HOLD_OUT_EVERY, Scene, Split, UnitCube, View};
use serde::Serialize;

use super::{SceneReading, print_notes, refinement_notes};
use crate::args::InfoArgs;

/// Voxels per edge of the hull that masks are tested with.
const HULL_RESOLUTION: usize = 96;

/// Share of a mask that the hull may leave unexplained without a warning.
const UNEXPLAINED_WARNING: f64 = 0.02;

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
    /// `None` without masks.
    hull_share_of_cube: Option<f64>,
    hull_box: Option<[[f64; 3]; 2]>,
    sparse_points: usize,
    has_surface_truth: bool,
    has_occupancy_truth: bool,
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct ViewInfo {
    name: String,
    split: Split,
    width: u32,
    height: u32,
    focal_pixels: f64,
    distance: f64,
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
    if let Err(error) = scene.require_masks() {
        info.warnings
            .push(format!("training needs masks: {error} (--background COLOR makes masks from a plain background)"));
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
    let (hull, unexplained) = hull_of_masks(scene, &mut warnings)?;
    for (view, &share) in scene.views.iter().zip(&unexplained) {
        if let Some(share) = share.filter(|&share| share > UNEXPLAINED_WARNING) {
            warnings.push(format!(
                "view {:?}: no visual hull explains {:.1} % of its mask; check its mask and camera, or leave it out with --ignore {}",
                view.name,
                100.0 * share,
                view.name
            ));
        }
    }
    let views = scene.views.iter().zip(&unexplained).map(|(view, &unexplained_share)| {
        let (width, height) = view.image.dimensions();
        ViewInfo {
            name: view.name.clone(),
            split: view.split,
            width,
            height,
            focal_pixels: view.camera.intrinsics.x_axis.x,
            distance: view.camera.center().length() * scene.object_to_world.scale,
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
        hull_share_of_cube: hull.as_ref().map(VisualHull::volume),
        hull_box: (hull.as_ref())
            .and_then(VisualHull::bounding_box)
            .map(|b| [b.min, b.max].map(|p| scene.object_to_world.transform_point(p).to_array())),
        sparse_points: scene.sparse_points.as_ref().map_or(0, |points| points.cloud.points.len()),
        has_surface_truth: scene.ground_truth.surface.is_some(),
        has_occupancy_truth: scene.ground_truth.occupancy.is_some(),
        warnings,
    })
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
    match (info.hull_box, info.hull_share_of_cube) {
        (Some([low, high]), Some(share)) => println!(
            "  hull        ({:.5}, {:.5}, {:.5}) to ({:.5}, {:.5}, {:.5}), {:.1} % of the unit cube",
            low[0],
            low[1],
            low[2],
            high[0],
            high[1],
            high[2],
            100.0 * share
        ),
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
}
