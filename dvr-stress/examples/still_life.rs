//! Renders photographs of objects on a table before several kinds of background, with cameras and without masks, and measures
//! what was made of them. The true masks are in `truth/masks` of each folder:
//!
//! ```sh
//! cargo run --release -p dvr-stress --example still_life -- render scenes/ 24 480
//! dvr masks scenes/stone-cloth --out masks/
//! cargo run --release -p dvr-segmentation --example mask_overlap -- scenes/stone-cloth masks/ scenes/stone-cloth/truth/masks
//! dvr train scenes/stone-cloth --masks masks/ --out run/
//! cargo run --release -p dvr-stress --example still_life -- measure scenes/stone-cloth run/mesh.ply
//! ```

use std::error::Error;
use std::path::Path;

use dvr_core::PointCloud;
use dvr_core::mesh::read_mesh;
use dvr_core::metrics::shape::score_surface;
use dvr_core::sampling::sample_surface;
use dvr_stress::{Body, Coat, StillLife, Surroundings};

/// What is photographed: a name, a shape and its coat.
const OBJECTS: [(&str, Body, Coat); 3] = [
    ("stone", Body::Stone, Coat::Stone),
    ("stool", Body::Stool, Coat::Stone),
    ("plain-stool", Body::Stool, Coat::Plain),
];

/// Points on each surface.
const SAMPLES: usize = 100_000;

/// What is nearer to the table than this, in units of the scene, is the object's foot, which nobody sees.
const FOOT: f32 = 0.004;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    match args[..] {
        ["render", out, views, width] => render(Path::new(out), views.parse()?, width.parse()?),
        ["measure", scene, mesh] => measure(Path::new(scene), Path::new(mesh)),
        _ => Err("give `render OUT VIEWS WIDTH`, or `measure SCENE MESH`".into()),
    }
}

fn render(out: &Path, views: usize, width: u32) -> Result<(), Box<dyn Error>> {
    for (name, body, coat) in OBJECTS {
        for surroundings in Surroundings::ALL {
            let scene = StillLife { body, coat, surroundings, views, width, samples: 3 };
            scene.write(&out.join(format!("{name}-{}", surroundings.name())))?;
        }
    }
    Ok(())
}

fn measure(scene: &Path, mesh: &Path) -> Result<(), Box<dyn Error>> {
    let above_table = |path: &Path, seed: u64| -> Result<PointCloud, Box<dyn Error>> {
        let samples = sample_surface(&read_mesh(path)?.mesh, SAMPLES, seed);
        let above = samples.points.into_iter().zip(samples.normals).filter(|(point, _)| point.y > FOOT);
        let (points, normals) = above.unzip();
        Ok(PointCloud { points, normals: Some(normals), colors: None })
    };
    let truth = above_table(&scene.join("truth/mesh.ply"), 0)?;
    let score = score_surface(&above_table(mesh, 1)?, &truth, &[])?;
    println!(
        "above the table, in units of the scene: Chamfer-L1 {:.5} (accuracy {:.5}, completeness {:.5})",
        score.chamfer_l1, score.accuracy, score.completeness
    );
    Ok(())
}
