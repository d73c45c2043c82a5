//! Renders photographs of objects on a table before several kinds of background, with cameras and without masks. The true
//! masks are in `truth/masks` of each folder:
//!
//! ```sh
//! cargo run --release -p dvr-stress --example still_life -- scenes/ 24 480
//! dvr masks scenes/stone-cloth --out masks/
//! cargo run --release -p dvr-segmentation --example mask_overlap -- scenes/stone-cloth masks/ scenes/stone-cloth/truth/masks
//! ```

use std::error::Error;
use std::path::Path;

use dvr_stress::{Body, Coat, StillLife, Surroundings};

/// What is photographed: a name, a shape and its coat.
const OBJECTS: [(&str, Body, Coat); 3] = [
    ("stone", Body::Stone, Coat::Stone),
    ("stool", Body::Stool, Coat::Stone),
    ("plain-stool", Body::Stool, Coat::Plain),
];

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [out, views, width] = args.as_slice() else { return Err("give `OUT VIEWS WIDTH`".into()) };
    let (views, width) = (views.parse()?, width.parse()?);
    for (name, body, coat) in OBJECTS {
        for surroundings in Surroundings::ALL {
            let scene = StillLife { body, coat, surroundings, views, width, samples: 3 };
            scene.write(&Path::new(out).join(format!("{name}-{}", surroundings.name())))?;
        }
    }
    Ok(())
}
