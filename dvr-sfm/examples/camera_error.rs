//! How far the cameras of one scene are from those of another, by the names of views:
//!
//! ```sh
//! cargo run --release -p dvr-sfm --example camera_error -- photos-cameras/sparse/0 TRUTH
//! ```

use std::error::Error;
use std::path::Path;

use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::{Camera, Scene};
use dvr_sfm::CameraErrors;

fn main() -> Result<(), Box<dyn Error>> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let [found, truth] = &paths[..] else { return Err("give the folders of two scenes: found, true".into()) };
    let read = |path: &str| read_scene(Path::new(path), &ReadOptions::default());
    let (found, truth) = (read(found)?, read(truth)?);
    let camera_of = |scene: &Scene, name: &str| -> Option<Camera> {
        let view = scene.views.iter().find(|view| view.name == name)?;
        Some(view.camera.into_world(&scene.object_to_world))
    };
    let names = truth.views.iter().map(|view| view.name.as_str());
    let pairs: Vec<(Camera, Camera)> =
        names.filter_map(|name| Some((camera_of(&found, name)?, camera_of(&truth, name)?))).collect();
    let (a, b): (Vec<Camera>, Vec<Camera>) = pairs.into_iter().unzip();
    let errors = CameraErrors::between(&a, &b).ok_or("the views in common determine no similarity")?;
    println!("{} of {} cameras", a.len(), truth.views.len());
    let figures = [
        ("rotation, degrees", errors.rotation_degrees, 1.0),
        ("centre, % of the distance", errors.center_share, 100.0),
    ];
    for (what, mut values, factor) in figures {
        values.sort_by(f64::total_cmp);
        let (mean, n) = (values.iter().sum::<f64>() / values.len() as f64, values.len());
        println!(
            "{what}: mean {:.4}, median {:.4}, largest {:.4}",
            factor * mean,
            factor * values[n / 2],
            factor * values[n - 1]
        );
    }
    Ok(())
}
