//! What the systems make of the same pictures, side by side.

use std::path::Path;

use anyhow::{Context, Result};
use dvr_core::Split;
use dvr_core::dataset::{ObjectDataset, ObjectOptions};
use dvr_core::files::write_rgb_png;
use dvr_core::mesh::read_mesh;
use dvr_render::{MeshShader, Shader, render_view};
use dvr_train::Observer;
use dvr_train::preview::{normal_picture, orbit_camera, sheet};
use glam::DVec3;
use image::{Rgb, RgbImage};

use super::row::{Place, Row};
use super::table::Line;
use crate::progress::Progress;

/// Objects that are shown.
const OBJECTS: usize = 8;

/// Width and height of a picture, pixels.
const SIZE: u32 = 128;

/// Where meshes are looked at from, degrees around the object and above it.
const SIDE: (f64, f64) = (30.0, 20.0);

/// Pictures of objects that were not trained on, and below them, as normals, what each system makes of them with its first
/// seed; `None` where there is nothing to show.
///
/// # Errors
/// When a picture cannot be read or written.
pub fn of_rows(
    rows: &[Row<'_>],
    lines: &[Line],
    place: &Place<'_>,
    progress: &mut Progress,
) -> Result<Option<RgbImage>> {
    let is_shown = |row: &&Row<'_>| {
        let line = lines.iter().find(|line| line.system.row == row.system.row);
        let is_whole = line.is_some_and(|line| line.failures.is_empty());
        row.seed == 0 && row.system.maker.training().is_some() && is_whole
    };
    let shown: Vec<&Row<'_>> = rows.iter().filter(is_shown).collect();
    if shown.is_empty() {
        return Ok(None);
    }
    let folder = place.out.join("pictures");
    let (names, inputs) = inputs(place, &folder)?;
    if names.is_empty() {
        return Ok(None);
    }
    progress.phase("pictures", shown.len());
    let mut all = vec![inputs];
    for (i, row) in shown.iter().enumerate() {
        // Where a system sees nothing in a picture, none of its files are there.
        let made = row.predict(&folder, &mut |said| progress.progress(i, said));
        place.cancellation.check()?;
        if let Err(problem) = &made {
            progress.note(&format!("{problem:#}"));
        }
        let meshes = place.out.join("predictions").join(row.name());
        all.push(names.iter().map(|name| normals(&meshes.join(format!("{name}.glb")))).collect::<Result<_>>()?);
        progress.progress(i + 1, row.system.title);
    }
    Ok(Some(sheet(&all)))
}

/// A mesh as normals; white where there is no file.
fn normals(path: &Path) -> Result<RgbImage> {
    if !path.is_file() {
        return Ok(RgbImage::from_pixel(SIZE, SIZE, Rgb([255; 3])));
    }
    let mesh = read_mesh(path)?.mesh;
    let camera = orbit_camera(SIZE, SIDE.0, SIDE.1, DVec3::Y);
    let shader = MeshShader::new(&mesh);
    Ok(normal_picture(&render_view(&shader as &dyn Shader, &camera), &camera))
}

/// One picture of each of some objects of the test split, spread over the categories: names and pictures, which are written
/// to a folder.
fn inputs(place: &Place<'_>, folder: &Path) -> Result<(Vec<String>, Vec<RgbImage>)> {
    let dataset = ObjectDataset::open(place.data, ObjectOptions::default())?;
    let test = dataset.of_split(Split::Test);
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let count = test.len().min(OBJECTS);
    let (mut names, mut pictures) = (Vec::new(), Vec::new());
    for i in 0..count {
        let index = test[i * test.len() / count];
        let object = &dataset.objects()[index];
        let name = format!("{}_{}", object.category, object.name);
        let picture = dataset.read_input(index, 0, SIZE)?.image;
        let file = folder.join(format!("{name}.png"));
        if !file.is_file() {
            write_rgb_png(&file, &picture)?;
        }
        names.push(name);
        pictures.push(picture);
    }
    Ok((names, pictures))
}
