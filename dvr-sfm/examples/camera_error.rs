//! How far the cameras of a COLMAP model are from those of a scene, by the names of their pictures:
//!
//! ```sh
//! cargo run --release -p dvr-sfm --example camera_error -- photos-cameras/sparse/0 TRUTH
//! ```

use std::error::Error;
use std::path::Path;

use dvr_core::Camera;
use dvr_core::dataset::{ReadOptions, read_colmap_model, read_scene};
use dvr_sfm::CameraErrors;

fn main() -> Result<(), Box<dyn Error>> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let [found, truth] = &paths[..] else {
        return Err("give the folder of a model, and a scene with its truth".into());
    };
    let found = read_colmap_model(Path::new(found))?;
    let truth = read_scene(Path::new(truth), &ReadOptions::default())?;
    let mut pairs = Vec::new();
    for view in &truth.views {
        let stem = |name: &str| Path::new(name).file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let picture = found.pictures.iter().find(|picture| stem(&picture.name).as_deref() == Some(&view.name));
        pairs.extend(picture.map(|picture| (picture.camera.clone(), view.camera.into_world(&truth.object_to_world))));
    }
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
