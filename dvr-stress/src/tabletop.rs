//! Photographs of an object on a table, with what is around it.

use std::path::Path;

use dvr_core::files::{write_gray_png, write_jpeg};
use dvr_core::mesh::Mesh;
use dvr_core::{Bvh, Camera, Ray, RayHit, Result, Similarity};
use glam::{DQuat, DVec2, DVec3};
use image::{GrayImage, Luma, Rgb, RgbImage};
use rayon::prelude::*;

use crate::solid_texture::{blotches, stone};

/// Where the light comes from, and how much comes from everywhere.
const LIGHT: DVec3 = DVec3::new(0.4, 0.85, 0.3);
const AMBIENT: f64 = 0.62;

/// How far a table reaches, and a turntable.
const TABLE: f64 = 3.5;
const TURNTABLE: f64 = 0.85;

/// Half the edge of a room, and where its floor is below the table.
const ROOM: f64 = 5.0;
const FLOOR: f64 = -1.5;

/// A plain wall, and a plain table or object.
const WALL: DVec3 = DVec3::new(0.62, 0.64, 0.66);
const PLAIN: DVec3 = DVec3::new(0.8, 0.8, 0.82);

/// What cameras look at, `y` up from the table, and how far from it they are.
const TARGET: DVec3 = DVec3::new(0.0, 0.27, 0.0);
const DISTANCE: f64 = 2.4;

/// Focal length in widths of a picture.
const FOCAL: f64 = 1.35;

/// What an object is painted with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coat {
    /// Red and yellow blotches of many sizes.
    Stone,
    /// One light grey.
    Plain,
}

/// What is around an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surroundings {
    /// A table with blue blotches before a plain wall.
    Cloth,
    /// A table with green tiles before a plain wall.
    Tiles,
    /// A table with blue blotches in a room with pictures on all walls.
    Room,
    /// A plain light grey table before a plain wall.
    Plain,
    /// A table with the object's own red and yellow blotches before a plain wall.
    Alike,
    /// A small table with blue blotches that turns before a camera which stands still, in a room with pictures on all walls.
    Turntable,
}

impl Surroundings {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Cloth, Self::Tiles, Self::Room, Self::Plain, Self::Alike, Self::Turntable];

    /// In one word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cloth => "cloth",
            Self::Tiles => "tiles",
            Self::Room => "room",
            Self::Plain => "plain",
            Self::Alike => "alike",
            Self::Turntable => "turntable",
        }
    }

    fn table_radius(self) -> f64 {
        if self == Self::Turntable { TURNTABLE } else { TABLE }
    }

    /// The table, `y` up, without light.
    fn table(self, at: DVec3) -> DVec3 {
        let blue = |value| DVec3::new(0.12, 0.25, 0.5).lerp(DVec3::new(0.55, 0.75, 0.9), value);
        match self {
            Self::Cloth | Self::Room | Self::Turntable => blue(blotches(5.0 * at, 10)),
            Self::Tiles => {
                let tile = ((2.5 * at.x).floor() + (2.5 * at.z).floor()).rem_euclid(2.0);
                let value = 0.7 * blotches(5.0 * at, 11) + 0.3 * tile;
                DVec3::new(0.2, 0.4, 0.25).lerp(DVec3::new(0.75, 0.85, 0.7), value)
            }
            Self::Plain => PLAIN,
            Self::Alike => stone(at + 3.0),
        }
    }

    /// What a ray shows that passes object and table; `turn` is how far a turntable has turned.
    fn behind(self, ray: &Ray, turn: f64) -> DVec3 {
        match self {
            Self::Room => room(ray),
            Self::Turntable => {
                let back = DQuat::from_rotation_y(turn);
                room(&Ray { origin: back * ray.origin, direction: back * ray.direction })
            }
            _ => WALL,
        }
    }
}

/// The walls of a room, its floor and its ceiling, from inside: pictures of several colours.
fn room(ray: &Ray) -> DVec3 {
    let [low, high] = [DVec3::new(-ROOM, FLOOR, -ROOM), DVec3::splat(ROOM)];
    let depths = (0..3).map(|axis| {
        let to = if ray.direction[axis] > 0.0 { high[axis] } else { low[axis] };
        (to - ray.origin[axis]) / ray.direction[axis]
    });
    let at = ray.at(depths.filter(|depth| depth.is_finite() && *depth > 0.0).fold(f64::INFINITY, f64::min));
    let [hue, value] = [blotches(0.35 * at, 20), blotches(2.1 * at, 21)];
    let warm = DVec3::new(0.7, 0.45, 0.3).lerp(DVec3::new(0.25, 0.4, 0.35), (3.0 * hue - 1.0).clamp(0.0, 1.0));
    warm * (0.3 + 0.9 * value)
}

/// Cameras all around a table, each on one of several rings in turn: `elevations` in degrees above what they look at, `start`
/// in radians. Pictures are `width` pixels wide, and three quarters as high.
pub(crate) fn orbit(views: usize, width: u32, elevations: &[f64], start: f64) -> Vec<Camera> {
    let height = width * 3 / 4;
    let eye = |i: usize| {
        let turn = std::f64::consts::TAU * (i as f64 / views as f64) + start;
        let elevation = elevations[i % elevations.len()].to_radians();
        let across = elevation.cos();
        TARGET + DISTANCE * DVec3::new(across * turn.cos(), elevation.sin(), across * turn.sin())
    };
    let camera = |i| Camera::look_at(width, height, FOCAL * f64::from(width), eye(i), TARGET, DVec3::Y);
    (0..views).map(camera).collect()
}

/// An object on a table that is to be photographed.
pub(crate) struct Tabletop<'a> {
    pub mesh: &'a Mesh,
    pub bvh: &'a Bvh,
    /// Takes the object to the table, which is the plane `y = 0`.
    pub pose: Similarity,
    pub coat: Coat,
    pub surroundings: Surroundings,
}

impl Tabletop<'_> {
    /// What a camera in the object's coordinates sees, and where it sees the object; `samples` along each axis of a pixel.
    fn photograph(&self, camera: &Camera, samples: u32) -> (RgbImage, GrayImage) {
        let place = |i: u32| (f64::from(i) + 0.5) / f64::from(samples);
        let byte = |sum: f64| (255.0 * (sum / f64::from(samples * samples)).clamp(0.0, 1.0)).round() as u8;
        let center = self.pose.transform_point(camera.center());
        let turn = center.z.atan2(center.x);
        let mut coverage = GrayImage::new(camera.width, camera.height);
        let picture = RgbImage::from_fn(camera.width, camera.height, |u, v| {
            let (mut sum, mut of_object) = (DVec3::ZERO, 0.0);
            for (s, t) in (0..samples * samples).map(|i| (place(i % samples), place(i / samples))) {
                let ray = camera.ray(DVec2::new(f64::from(u) + s, f64::from(v) + t));
                match self.bvh.closest_hit(&ray, 0.0, f64::INFINITY) {
                    Some(hit) => {
                        sum += self.object(&ray, &hit);
                        of_object += 1.0;
                    }
                    None => sum += self.around(&ray, turn),
                }
            }
            coverage.put_pixel(u, v, Luma([byte(of_object)]));
            Rgb(sum.to_array().map(byte))
        });
        (picture, coverage)
    }

    /// Writes what cameras see, `0000.jpg` and so on, and where they see the object, `0000.png`, to folders that are there.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, cameras: &[Camera], samples: u32, pictures: &Path, masks: Option<&Path>) -> Result<()> {
        let one = |(i, camera): (usize, &Camera)| {
            let (picture, mask) = self.photograph(camera, samples);
            if let Some(masks) = masks {
                write_gray_png(&masks.join(format!("{i:04}.png")), &mask)?;
            }
            write_jpeg(&pictures.join(format!("{i:04}.jpg")), &picture, 95, None)
        };
        cameras.par_iter().enumerate().map(one).collect()
    }

    /// Where the light comes from in the object's coordinates.
    fn to_light(&self) -> DVec3 {
        self.pose.rotation.inverse() * LIGHT.normalize()
    }

    /// What a ray, in the object's coordinates, sees of the object.
    fn object(&self, ray: &Ray, hit: &RayHit) -> DVec3 {
        let normals = self.mesh.normals.as_deref().unwrap_or_default();
        let corners = self.mesh.faces[hit.face as usize].map(|i| normals[i as usize].as_dvec3());
        let normal: DVec3 = corners.iter().zip(hit.barycentric).map(|(n, w)| *n * w).sum();
        let color = match self.coat {
            Coat::Stone => stone(ray.at(hit.ray_depth)),
            Coat::Plain => PLAIN,
        };
        color * lit(normal.normalize_or_zero().dot(self.to_light()))
    }

    /// What a ray that passes the object sees: the table, with the object's shadow, or what is behind.
    fn around(&self, ray: &Ray, turn: f64) -> DVec3 {
        let pose = &self.pose;
        let ray = Ray { origin: pose.transform_point(ray.origin), direction: pose.rotation * ray.direction };
        let depth = -ray.origin.y / ray.direction.y;
        let at = ray.at(depth);
        if depth <= 0.0 || at.length() > self.surroundings.table_radius() {
            return self.surroundings.behind(&ray, turn);
        }
        let start = pose.inverse().transform_point(at + 1e-4 * DVec3::Y);
        let is_dark = self.bvh.any_hit(&Ray { origin: start, direction: self.to_light() }, 0.0, f64::INFINITY);
        self.surroundings.table(at) * if is_dark { AMBIENT } else { lit(LIGHT.normalize().y) }
    }
}

/// How bright a surface is, by the cosine between its normal and the light.
fn lit(cosine: f64) -> f64 {
    AMBIENT + (1.0 - AMBIENT) * cosine.max(0.0)
}
