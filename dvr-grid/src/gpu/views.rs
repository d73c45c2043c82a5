//! Photographs inside a kernel: rays of pixels, projections of points, and what is seen there; the counterpart of
//! `crate::views`.

#![allow(missing_docs)]

use std::mem::offset_of;

use cubecl::prelude::*;
use dvr_core::Pinhole;
use dvr_gpu::{Buffer, Buffers, DeviceError};

use super::voxel::{Point, lerp};

/// A view in the table of views, in words. Matrices are column by column.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct ViewRecord {
    /// The camera.
    pub center: [f32; 3],
    /// Pixel coordinates (and 1) to a ray direction of unit z-depth.
    pub to_direction: [f32; 9],
    /// From a point to pixel coordinates times z-depth, and z-depth: this times the point, and `offset`.
    pub projection: [f32; 9],
    /// See `projection`.
    pub offset: [f32; 3],
    pub width: u32,
    pub height: u32,
    /// Where its pixels begin in the table of pixels.
    pub first_pixel: u32,
    /// To the mean exposure: what colours are multiplied by, and what is added then.
    pub scale: [f32; 3],
    /// See `scale`.
    pub shift: [f32; 3],
}

impl ViewRecord {
    /// A view whose colours are taken as they are.
    pub fn of_camera(camera: &Pinhole, [width, height]: [u32; 2]) -> Self {
        Self {
            center: camera.center.to_array(),
            to_direction: camera.to_direction.to_cols_array(),
            projection: camera.projection.to_cols_array(),
            offset: camera.offset.to_array(),
            width,
            height,
            first_pixel: 0,
            scale: [1.0; 3],
            shift: [0.0; 3],
        }
    }
}

/// The table of views, whose pixels follow each other in the order of views.
///
/// # Errors
/// When there is no room for it.
pub(crate) fn table(buffers: &Buffers, mut views: Vec<ViewRecord>) -> Result<Buffer, DeviceError> {
    let mut first_pixel = 0u32;
    for view in &mut views {
        view.first_pixel = first_pixel;
        first_pixel += view.width * view.height;
    }
    buffers.words("the table of views", bytemuck::cast_slice(&views).to_vec())
}

/// Words of a view.
const VIEW_WORDS: usize = size_of::<ViewRecord>() / 4;

/// A view, by its place in the table.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Photo {
    at: usize,
    pub width: u32,
    pub height: u32,
    first: u32,
}

/// What a view shows at a point, and how that changes as the point moves.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Seen {
    /// Whether the view shows the object in all four pixels around.
    pub is_object: bool,
    pub color: Point,
    pub derivative: Point,
}

#[cube]
pub(crate) fn photo(views: &[u32], view: u32) -> Photo {
    let at = view as usize * VIEW_WORDS;
    Photo {
        at,
        width: views[at + comptime!(offset_of!(ViewRecord, width) / 4)],
        height: views[at + comptime!(offset_of!(ViewRecord, height) / 4)],
        first: views[at + comptime!(offset_of!(ViewRecord, first_pixel) / 4)],
    }
}

#[cube]
fn vector(views: &[u32], at: usize) -> Point {
    Point::new(f32::reinterpret(views[at]), f32::reinterpret(views[at + 1]), f32::reinterpret(views[at + 2]))
}

/// A matrix of the table, times a vector.
#[cube]
fn transformed(views: &[u32], at: usize, v: &Point) -> Point {
    let (x, y, z) = (vector(views, at), vector(views, at + 3), vector(views, at + 6));
    x.times(v.x).plus(&y.times(v.y)).plus(&z.times(v.z))
}

/// Whether a pixel shows the object.
#[cube]
pub(crate) fn is_object(pixel: u32) -> bool {
    (pixel >> 24u32) > 0u32
}

#[cube]
fn color(pixel: u32) -> Point {
    let red = f32::cast_from(pixel & 255u32);
    let green = f32::cast_from((pixel >> 8u32) & 255u32);
    let blue = f32::cast_from((pixel >> 16u32) & 255u32);
    Point::new(red, green, blue).over(255.0f32)
}

#[cube]
impl Photo {
    /// Where the camera stands.
    pub fn center(&self, views: &[u32]) -> Point {
        vector(views, self.at + comptime!(offset_of!(ViewRecord, center) / 4))
    }

    /// Direction of unit z-depth through the centre of a pixel.
    pub fn direction(&self, views: &[u32], u: u32, v: u32) -> Point {
        let pixel = Point::new(f32::cast_from(u) + 0.5f32, f32::cast_from(v) + 0.5f32, 1.0f32);
        transformed(views, self.at + comptime!(offset_of!(ViewRecord, to_direction) / 4), &pixel)
    }

    /// Where a pixel lies in the table of pixels.
    pub fn index(&self, u: u32, v: u32) -> usize {
        (self.first + v * self.width + u) as usize
    }

    /// A pixel's colour at the mean exposure.
    pub fn color(&self, views: &[u32], pixel: u32) -> Point {
        self.scaled(views, &color(pixel)).plus(&vector(views, self.at + comptime!(offset_of!(ViewRecord, shift) / 4)))
    }

    /// Times the factors of the exposure.
    fn scaled(&self, views: &[u32], color: &Point) -> Point {
        let scale = vector(views, self.at + comptime!(offset_of!(ViewRecord, scale) / 4));
        Point::new(scale.x * color.x, scale.y * color.y, scale.z * color.z)
    }

    /// Pixel coordinates of a point times its z-depth, and its z-depth.
    pub fn projected(&self, views: &[u32], point: &Point) -> Point {
        let projection = self.at + comptime!(offset_of!(ViewRecord, projection) / 4);
        let offset = vector(views, self.at + comptime!(offset_of!(ViewRecord, offset) / 4));
        transformed(views, projection, point).plus(&offset)
    }

    /// The colour at the projection of a point, and its derivative as the point moves along `direction`.
    pub fn reproject(&self, views: &[u32], pixels: &[u32], point: &Point, direction: &Point) -> Seen {
        let projection = self.at + comptime!(offset_of!(ViewRecord, projection) / 4);
        let q = self.projected(views, point);
        let (px, py) = (q.x / q.z, q.y / q.z);
        let (x, y) = (px - 0.5f32, py - 0.5f32);
        let (last_u, last_v) = (max(self.width, 2u32) - 2u32, max(self.height, 2u32) - 2u32);
        let within = q.z > 0.0f32
            && x >= 0.0f32
            && y >= 0.0f32
            && x < f32::cast_from(last_u + 1u32)
            && y < f32::cast_from(last_v + 1u32);
        let u = select(within, min(u32::cast_from(x.max(0.0f32)), last_u), 0u32);
        let v = select(within, min(u32::cast_from(y.max(0.0f32)), last_v), 0u32);
        let (s, t) = (x - f32::cast_from(u), y - f32::cast_from(v));
        let first = pixels[self.index(u, v)];
        let second = pixels[self.index(u + 1u32, v)];
        let third = pixels[self.index(u, v + 1u32)];
        let fourth = pixels[self.index(u + 1u32, v + 1u32)];
        let all = is_object(first) && is_object(second) && is_object(third) && is_object(fourth);
        let (a, b, c, d) = (color(first), color(second), color(third), color(fourth));
        let (top_step, bottom_step) = (b.minus(&a), d.minus(&c));
        let (top, bottom) = (a.along(&top_step, s), c.along(&bottom_step, s));
        let by_x = top_step.along(&bottom_step.minus(&top_step), t);
        let by_y = bottom.minus(&top);
        let moved = transformed(views, projection, direction);
        let flow_x = (moved.x - px * moved.z) / q.z;
        let flow_y = (moved.y - py * moved.z) / q.z;
        let between = Point::new(lerp(top.x, bottom.x, t), lerp(top.y, bottom.y, t), lerp(top.z, bottom.z, t));
        let shift = vector(views, self.at + comptime!(offset_of!(ViewRecord, shift) / 4));
        Seen {
            is_object: within && all,
            color: self.scaled(views, &between).plus(&shift),
            derivative: self.scaled(views, &by_x.times(flow_x).plus(&by_y.times(flow_y))),
        }
    }
}
