//! What finding cameras anew brings: `cargo bench -p dvr-train --bench camera_refinement -- SCENE... [--seeds N]`.
//!
//! Every camera of a scene whose true surface is known is turned and moved in a direction of its own; then the fast
//! method is run on the true cameras, on the wrong ones, and on the wrong ones after they were refined. Chamfer-L1
//! after the similarity that cannot be known from photographs is taken out; recovered is the share of what the errors
//! cost. Exact cameras, refined, must cost nothing.

use std::path::PathBuf;
use std::time::Instant;

use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::metrics::alignment::align_to_surface;
use dvr_core::metrics::shape::score_surface;
use dvr_core::sampling::sample_surface;
use dvr_core::{PointCloud, Scene, Similarity, Split};
use dvr_render::extract::{ExtractSettings, extract_mesh};
use dvr_stress::displace_camera;
use dvr_train::{GridConfig, GridTrainer, refine_cameras};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Errors of each camera: degrees, and shares of its distance.
const ERRORS: [(f64, f64); 4] = [(0.0, 0.0), (0.25, 0.005), (0.5, 0.01), (1.0, 0.02)];

/// Rounds of refinement.
const ROUNDS: usize = 10;

fn main() {
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    let (mut scenes, mut seeds) = (Vec::new(), 1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--seeds" => seeds = arguments.next().and_then(|n| n.parse().ok()).expect("--seeds takes a number"),
            _ => scenes.push(PathBuf::from(argument)),
        }
    }
    println!(
        "| scene | seed | degrees | % | exact | wrong | refined | recovered | cameras off, px | after | rounds | seconds |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    for path in &scenes {
        let scene = read_scene(path, &ReadOptions::default()).expect("the scene is readable");
        for seed in 0..seeds {
            let exact = chamfer(&scene, seed);
            ERRORS.iter().for_each(|&(degrees, share)| compare(&scene, seed, exact, degrees, share));
        }
    }
}

fn compare(scene: &Scene, seed: u64, exact: f64, degrees: f64, share: f64) {
    let mut wrong = scene.clone();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    wrong.views.iter_mut().for_each(|view| displace_camera(&mut view.camera, degrees, share, &mut rng));
    let lost = chamfer(&wrong, seed);
    let off = distance(scene, &wrong);
    let start = Instant::now();
    let config = GridConfig { seed, ..GridConfig::default() };
    let refined = refine_cameras(&mut wrong, &config, ROUNDS, &dvr_core::Cancellation::default(), &mut ());
    let rounds = refined.expect("the views can be trained on").rounds;
    let seconds = start.elapsed().as_secs_f64();
    let found = chamfer(&wrong, seed);
    let recovered =
        if degrees > 0.0 { format!("{:.0} %", 100.0 * (lost - found) / (lost - exact)) } else { String::new() };
    println!(
        "| {} | {seed} | {degrees} | {} | {exact:.4} | {lost:.4} | {found:.4} | {recovered} | {off:.2} | {:.2} | {rounds} | {seconds:.1} |",
        scene.name,
        100.0 * share,
        distance(scene, &wrong),
    );
}

/// Root mean square of how far the true surface's points are apart in the pictures of two scenes, after the second is
/// brought to where its cameras are nearest to the first's.
fn distance(exact: &Scene, other: &Scene) -> f64 {
    let cameras = |scene: &'_ Scene| scene.views.iter().map(|view| view.camera.clone()).collect::<Vec<_>>();
    let gauge = Similarity::between_cameras(&cameras(other), &cameras(exact)).unwrap_or_default();
    let points = &exact.ground_truth.surface.as_ref().expect("the true surface is known").points;
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in exact.views.iter().zip(&other.views) {
        let b = b.camera.into_world(&gauge);
        for point in points.iter().step_by(points.len() / 200 + 1) {
            sum += (a.camera.project(point.as_dvec3()).0 - b.project(point.as_dvec3()).0).length_squared();
            count += 1.0;
        }
    }
    f64::sqrt(sum / count)
}

/// Chamfer-L1 of what the fast method makes of a scene, aligned.
fn chamfer(scene: &Scene, seed: u64) -> f64 {
    let config = GridConfig { seed, ..GridConfig::default() };
    let mut trainer = GridTrainer::new(scene.views_of(Split::Train).collect(), Vec::new(), config)
        .expect("the masks show the object");
    while trainer.steps_done() < trainer.total_steps() {
        trainer.step().expect("the loss is finite");
    }
    let truth = scene.ground_truth.surface.as_ref().expect("the true surface is known");
    let mesh = extract_mesh(&trainer.field().expect("the field is readable"), &ExtractSettings::default(), &[])
        .expect("there is a surface")
        .mesh;
    let mut found = PointCloud::from(sample_surface(&mesh, 100_000, seed));
    let alignment = align_to_surface(&found, truth, f64::INFINITY).expect("both surfaces have points");
    found.points.iter_mut().for_each(|point| *point = alignment.transform_point_f32(*point));
    score_surface(&found, truth, &[]).expect("both surfaces have points").chamfer_l1
}
