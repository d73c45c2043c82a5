//! The camera arithmetic of DVR's reference code, by its own numbers (`tests/fixtures/cameras.npz`).

use glam::Vec2;

use super::*;
use crate::dataset::layouts::dvr;

fn cameras() -> NpzFile {
    NpzFile::open(&dvr_test_support::fixture("cameras.npz")).unwrap()
}

fn rows<const N: usize>(npz: &mut NpzFile, name: &str) -> Vec<[f64; N]> {
    let values = npz.read(name).unwrap().to_f64();
    values.chunks_exact(N).map(|row| row.try_into().unwrap()).collect()
}

/// Each view's camera for an image of 200x100 pixels, and its depth units.
fn read_cameras(npz: &mut NpzFile) -> Vec<(Camera, f64)> {
    let mut matrices = |name: &str| -> Vec<DMat4> {
        rows::<16>(npz, name).iter().map(|m| DMat4::from_cols_array(m).transpose()).collect()
    };
    let (camera, world, scale) = (matrices("camera_mat"), matrices("world_mat"), matrices("scale_mat"));
    (0..3)
        .map(|i| {
            let projection = dvr::compose_projection(&camera[i], &world[i], &scale[i]);
            (projection.camera(200, 100).unwrap(), projection.depth_units())
        })
        .collect()
}

/// Pixel coordinates of normalised ones.
fn to_pixel([x, y]: [f64; 2]) -> DVec2 {
    DVec2::new(100.0 * (x + 1.0), 50.0 * (y + 1.0))
}

#[track_caller]
fn assert_close(found: DVec3, expected: [f64; 3]) {
    let expected = DVec3::from(expected);
    assert!((found - expected).length() < 2e-5 * (1.0 + expected.length()), "{found} is not {expected}");
}

#[test]
fn pixels_depths_and_origins_are_where_the_original_has_them() {
    let mut npz = cameras();
    let cameras = read_cameras(&mut npz);
    let pixels = rows::<2>(&mut npz, "pixels");
    let depths = rows::<1>(&mut npz, "depth");
    let points = rows::<3>(&mut npz, "points");
    let at_depth_one = rows::<3>(&mut npz, "image_points_to_world");
    let origins = rows::<3>(&mut npz, "origin_to_world");
    let at_depth = rows::<3>(&mut npz, "transform_to_world");
    let in_camera = rows::<3>(&mut npz, "transform_to_camera_space");
    let directions = rows::<3>(&mut npz, "ray_direction");
    assert_eq!(pixels.len(), 3 * 64);
    for i in 0..pixels.len() {
        let (camera, depth_units) = &cameras[i / 64];
        let ray = camera.ray(to_pixel(pixels[i]));
        assert_close(ray.origin, origins[i]);
        assert_close(ray.at(1.0 / depth_units), at_depth_one[i]);
        assert_close(ray.direction / *depth_units, directions[i]);
        assert_close(ray.at(depths[i][0] / depth_units), at_depth[i]);
        // Its camera space is ours with normalised coordinates multiplied by depth.
        let (pixel, z) = camera.project(points[i].into());
        let z = z * depth_units;
        assert_close(DVec3::new((pixel.x / 100.0 - 1.0) * z, (pixel.y / 50.0 - 1.0) * z, z), in_camera[i]);
    }
}

/// Where the reference code places pixel `(u, v)` of an image for its rays: corner pixels on the corners of the image.
fn original_ray_position(u: usize, v: usize, width: usize, height: usize) -> Vec2 {
    let place = |i: usize, n: usize| 2.0 * i as f32 / (n - 1) as f32 - 1.0;
    Vec2::new(place(u, width), place(v, height))
}

#[test]
fn rays_of_the_original_go_through_other_points_than_pixel_centres() {
    let mut npz = cameras();
    let (width, height) = (6, 4);
    let locations = rows::<2>(&mut npz, "arange_pixels_4x6.loc");
    let scaled = rows::<2>(&mut npz, "arange_pixels_4x6.scaled");
    let mut largest = 0.0f64;
    for (location, scaled) in locations.iter().zip(&scaled) {
        let (u, v) = (location[0] as usize, location[1] as usize);
        let original = original_ray_position(u, v, width, height).as_dvec2();
        assert!((original - DVec2::from(*scaled)).length() < 1e-6, "its grid spans the corners of the image");
        let ours = DVec2::new((2 * u + 1) as f64 / 6.0 - 1.0, (2 * v + 1) as f64 / 4.0 - 1.0);
        let off = (original - ours) * DVec2::new(3.0, 2.0);
        largest = largest.max(off.abs().max_element());
    }
    assert!((largest - 0.5).abs() < 1e-6, "its rays are up to half a pixel off, at the border");
}

/// The pixel that the reference code reads for normalised coordinates: nearest, ties to even; 0 out of the image.
fn original_lookup([x, y]: [f64; 2], width: usize, height: usize) -> usize {
    // In single precision, as it was run: ties depend on it.
    let index = |x: f64, n: usize| ((((x as f32 + 1.0) * n as f32) - 1.0) / 2.0).round_ties_even();
    let (u, v) = (index(x, width), index(y, height));
    let inside = u >= 0.0 && v >= 0.0 && u < width as f32 && v < height as f32;
    if inside { 1 + v as usize * width + u as usize } else { 0 }
}

#[test]
fn the_original_reads_its_last_row_and_column_out_of_the_image_and_we_read_every_pixel() {
    let mut npz = cameras();
    let scaled = rows::<2>(&mut npz, "arange_pixels_4x6.scaled");
    let locations = rows::<2>(&mut npz, "arange_pixels_4x6.loc");
    let values = npz.read("nearest.values_at_arange_pixels").unwrap().to_i64();
    let image = npz.read("nearest.image").unwrap().to_i64();
    let mut outside = 0;
    for ((scaled, location), &value) in scaled.iter().zip(&locations).zip(&values) {
        assert_eq!(original_lookup(*scaled, 6, 4) as i64, value, "at {scaled:?}");
        // Our pixel centre lies in the pixel that is meant, everywhere.
        let center = DVec2::new(location[0], location[1]) + 0.5;
        assert_eq!(image[center.y as usize * 6 + center.x as usize], 1 + (location[1] * 6.0 + location[0]) as i64);
        outside += usize::from(value == 0);
    }
    assert_eq!(outside, 9, "the last row (6) and column (4), less their common pixel");

    let values = npz.read("nearest64.values_at_arange_pixels").unwrap().to_i64();
    let outside = values.iter().filter(|&&value| value == 0).count();
    assert_eq!(outside, 127, "3.1 % of 64x64");
}

#[test]
fn neighbours_in_the_original_are_one_pixel_twice_or_two_apart() {
    let mut npz = cameras();
    let places = rows::<2>(&mut npz, "sample_patch_points.ps2");
    let values = npz.read("nearest64.values_at_patch.ps2").unwrap().to_i64();
    let mut steps = [0usize; 3];
    for (patch, places) in values.chunks_exact(4).zip(places.chunks_exact(4)) {
        // The four of a patch are one apart in the grid of its rays.
        let apart = DVec2::from(places[0]).distance(places[3].into()) * 31.5;
        assert!((apart - 2.0f64.sqrt()).abs() < 0.1, "patch {places:?}");
        if patch.iter().all(|&value| value > 0) {
            let column = |value: i64| (value - 1) % 64;
            let other = patch.iter().map(|&value| (column(value) - column(patch[0])).unsigned_abs()).max().unwrap_or(0);
            steps[other.min(2) as usize] += 1;
        }
    }
    println!("distance of neighbours: none {}, one {}, two {}", steps[0], steps[1], steps[2]);
    assert!(steps[0] > 50 && steps[2] > 50 && steps[1] < steps[0] / 10);
}
