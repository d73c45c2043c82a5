//! Makes masks wrong on purpose, to see what becomes of it.
//!
//! ```sh
//! cargo run --release -p dvr-core --example spoil_masks -- SCENE/mask COPY/mask 3 none   # three pixels too wide
//! cargo run --release -p dvr-core --example spoil_masks -- SCENE/mask COPY/mask -3 none  # too tight
//! cargo run --release -p dvr-core --example spoil_masks -- SCENE/mask COPY/mask 0 holes  # holes on a grid
//! ```

use std::error::Error;
use std::path::Path;

use image::{GrayImage, Luma};

/// Pixels from one hole to the next, and the radius of each.
const GRID: u32 = 60;
const RADIUS: u32 = 8;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [from, to, pixels, holes] = arguments.as_slice() else {
        return Err("usage: spoil_masks FROM TO PIXELS none|holes".into());
    };
    let pixels: i64 = pixels.parse()?;
    for entry in std::fs::read_dir(from)? {
        let path = entry?.path();
        let Some(name) = path.file_name().filter(|_| path.extension().is_some_and(|ending| ending == "png")) else {
            continue;
        };
        // Another place for the holes in each mask.
        let shift = name.to_string_lossy().bytes().fold(0u32, |sum, byte| sum * 31 % 97 + u32::from(byte));
        let mask = image::open(&path)?.into_luma8();
        let spoilt = GrayImage::from_fn(mask.width(), mask.height(), |u, v| {
            let is_hole = holes == "holes" && is_hole(u + 7 * shift, v + 13 * shift);
            Luma([if grown(&mask, u, v, pixels) && !is_hole { 255 } else { 0 }])
        });
        spoilt.save(Path::new(to).join(name))?;
    }
    Ok(())
}

/// Whether a pixel is of the object in the mask that is `pixels` wider, or narrower where that is negative.
fn grown(mask: &GrayImage, u: u32, v: u32, pixels: i64) -> bool {
    let looks_for = pixels >= 0;
    let found = (-pixels.abs()..=pixels.abs()).flat_map(|y| (-pixels.abs()..=pixels.abs()).map(move |x| (x, y))).any(
        |(x, y)| {
            let (u, v) = (i64::from(u) + x, i64::from(v) + y);
            let is_within = x * x + y * y <= pixels * pixels
                && (0..i64::from(mask.width())).contains(&u)
                && (0..i64::from(mask.height())).contains(&v);
            is_within && (mask.get_pixel(u as u32, v as u32).0[0] >= 128) == looks_for
        },
    );
    found == looks_for
}

/// Whether a place lies in a hole of the grid.
fn is_hole(u: u32, v: u32) -> bool {
    let off = |place: u32| (place % GRID).min(GRID - place % GRID).pow(2);
    off(u) + off(v) < RADIUS.pow(2)
}
