//! Renders cases to scenes on disk.

use std::path::{Path, PathBuf};

use dvr_core::synth::{MeshRenderer, Shot, SynthConfig, place_cameras, write_shots};
use dvr_core::{Camera, Result};
use rayon::prelude::*;

use crate::axis::Case;

/// The category of all scenes, which the layout needs.
const CATEGORY: &str = "scenes";

/// The cameras from which a case is rendered, without the errors of the stated ones.
pub(crate) fn true_cameras(case: &Case, seed: u64) -> Vec<Camera> {
    let mut cameras = place_cameras(&seeded(case, seed));
    case.faults.aim(&mut cameras, seed);
    cameras
}

/// Renders a case, applies its faults, and writes it to `<out>/scenes/<name>`; returns that folder. The same seed gives
/// the same files.
///
/// # Errors
/// When the name is unusable or something cannot be written.
pub fn write_scene(case: &Case, name: &str, seed: u64, out: &Path) -> Result<PathBuf> {
    let config = seeded(case, seed);
    let renderer = MeshRenderer::new(&case.object, &config);
    let mut shots: Vec<Shot> = true_cameras(case, seed)
        .into_par_iter()
        .enumerate()
        .map(|(view, camera)| Shot { picture: renderer.render(&camera, view as u64), camera })
        .collect();
    case.faults.spoil(&mut shots, seed);
    write_shots(shots, &case.object.mesh, name, CATEGORY, out, &config)?;
    Ok(out.join(CATEGORY).join(name))
}

fn seeded(case: &Case, seed: u64) -> SynthConfig {
    SynthConfig { seed, ..case.config.clone() }
}

#[cfg(test)]
mod tests {
    use dvr_core::dataset::{ReadOptions, read_scene};

    use super::*;
    use crate::catalogue::axes;

    #[test]
    fn a_scene_is_the_same_for_a_seed_and_in_object_space() {
        let axis = axes().into_iter().find(|axis| axis.name == "camera-rotation").unwrap();
        let case = axis.case(2.0).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let read = |name: &str, seed: u64| {
            let path = write_scene(&case, name, seed, folder.path()).unwrap();
            read_scene(&path, &ReadOptions::default()).unwrap()
        };
        let (first, again, other) = (read("a", 0), read("b", 0), read("c", 1));
        assert_eq!(first.object_to_world, dvr_core::Similarity::default());
        assert!(first.ground_truth.surface.is_none(), "the ground truth is not written");
        let pixels = |scene: &dvr_core::Scene| scene.views[3].image.as_raw().to_vec();
        assert_eq!(pixels(&first), pixels(&again));
        assert_ne!(pixels(&first), pixels(&other));
        // The stated cameras are off by two degrees.
        for (stated, real) in first.views.iter().zip(true_cameras(&case, 0)) {
            let cosine = stated.camera.forward().dot(real.forward()).clamp(-1.0, 1.0);
            assert!(cosine.acos().to_degrees() < 2.01);
            assert!((stated.camera.center() - real.center()).length() < 1e-5);
        }
    }
}
