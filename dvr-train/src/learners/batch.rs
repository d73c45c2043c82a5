//! Pixel batches: which pixels of which views a step looks at, and what they show.

use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::{Ray, UnitCube, View};
use dvr_render::{Rays, SkipGrid};
use rand::Rng;

/// The pixels of one step. Patches stand one after the other, each row by row.
#[derive(Clone, Debug)]
pub struct PixelBatch {
    /// Rays through the pixel centres, with directions of unit camera z: ray depth is z-depth. Their intervals are the
    /// parts in which a surface is searched for.
    pub rays: Rays,
    /// Which rays are searched at all. The others pass where there can be nothing.
    pub searched: Vec<i64>,
    /// Depths at which each ray enters and leaves the cube, `[n]` each.
    pub cube_interval: [Tensor<1>; 2],
    /// Colours of the pixels, `[n, 3]`, sRGB in `[0, 1]`.
    pub color: Tensor<2>,
    /// Whether each pixel shows the object.
    pub object: Vec<bool>,
    /// Measured z-depth of each pixel, object units; not finite where nothing was measured.
    pub z_depth: Vec<f32>,
    /// Whether each ray passes through the cube; those that do not are left out of all losses.
    pub in_cube: Vec<bool>,
    /// Pixels a patch.
    pub patch_pixels: usize,
}

/// Which pixels of a view; `(u, v)` is the top left one of a patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Patch {
    view: usize,
    u: u32,
    v: u32,
}

/// How pixels are drawn.
#[derive(Clone, Copy, Debug)]
pub struct PixelSampling {
    /// Rays a batch; rounded down to whole patches.
    pub rays: usize,
    /// Edge of a patch in pixels.
    pub patch_size: usize,
    /// Share of the patches that start at an object pixel.
    pub object_share: f64,
}

impl PixelSampling {
    /// Pixels a patch.
    pub fn patch_pixels(&self) -> usize {
        self.patch_size * self.patch_size
    }
}

/// The interval of a ray that meets nothing.
const NOWHERE: (f64, f64) = (0.0, -1.0);

/// Tries to find an object pixel before a patch is taken anywhere: views may show the object in few pixels or none.
const OBJECT_TRIES: usize = 256;

/// What some pixels show, before it goes to a device. Patches stand one after the other, each row by row.
#[derive(Clone, Debug, Default)]
pub struct Pixels {
    /// Rays through the pixel centres.
    pub rays: Vec<Ray>,
    /// sRGB colours in `[0, 1]`, three numbers a pixel.
    pub color: Vec<f32>,
    /// Whether each pixel shows the object.
    pub object: Vec<bool>,
    /// Measured z-depth of each pixel, object units; not finite where nothing was measured.
    pub z_depth: Vec<f32>,
}

impl Pixels {
    /// The first `count` pixels; the others stay.
    pub(crate) fn take_first(&mut self, count: usize) -> Self {
        Self {
            rays: self.rays.drain(..count).collect(),
            color: self.color.drain(..3 * count).collect(),
            object: self.object.drain(..count).collect(),
            z_depth: self.z_depth.drain(..count).collect(),
        }
    }

    /// Draws patches from views, every view equally often, and adds them to those that are there.
    pub fn draw(&mut self, views: &[&View], sampling: PixelSampling, rng: &mut impl Rng) {
        let size = sampling.patch_size as u32;
        let patches: Vec<_> = (0..(sampling.rays / sampling.patch_pixels()).max(1))
            .map(|_| {
                let on_object = rng.random_bool(sampling.object_share);
                draw_patch(views, size, on_object, rng)
            })
            .collect();
        for patch in patches {
            let view = views[patch.view];
            for (dv, du) in (0..size).flat_map(|dv| (0..size).map(move |du| (dv, du))) {
                let (u, v) = (patch.u + du, patch.v + dv);
                self.rays.push(view.camera.pixel_ray(u, v));
                self.color.extend(view.image.get_pixel(u, v).0.map(|c| f32::from(c) / 255.0));
                self.object.push(view.is_training_object(u, v));
                self.z_depth.push(view.depth.as_ref().map_or(f32::INFINITY, |depth| depth.get(u, v)));
            }
        }
    }

    /// How many pixels there are.
    pub fn len(&self) -> usize {
        self.object.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.object.is_empty()
    }
}

impl PixelBatch {
    /// Moves pixels to a device; `patch_pixels` of them make a patch.
    ///
    /// `bound` says where the object can be; without it, the whole cube is searched. A pixel that shows the object is
    /// searched along its whole ray where the bound leaves nothing of it: masks may contradict each other.
    pub fn of_pixels(pixels: Pixels, patch_pixels: usize, bound: Option<&SkipGrid>, device: &Device) -> Self {
        let color = Tensor::from_data(TensorData::new(pixels.color, [pixels.object.len(), 3]), device);
        Self::new(&pixels.rays, color, pixels.object, pixels.z_depth, patch_pixels, bound, device)
    }

    /// Says which object each ray looks at: the row of its latent code.
    #[must_use]
    pub fn with_objects(mut self, objects: Vec<i64>) -> Self {
        let device = self.color.device();
        let count = objects.len();
        self.rays.object = Some(Tensor::from_data(TensorData::new(objects, [count]), &device));
        self
    }

    /// Puts a batch together from its rays and what their pixels show; see the fields.
    pub fn new(
        rays: &[Ray],
        color: Tensor<2>,
        object: Vec<bool>,
        z_depth: Vec<f32>,
        patch_pixels: usize,
        bound: Option<&SkipGrid>,
        device: &Device,
    ) -> Self {
        let cube = UnitCube::default();
        let in_cube: Vec<_> = rays.iter().map(|ray| cube.intersect(ray)).collect();
        let search = |i: usize| match bound {
            Some(bound) => bound.interval(&rays[i]).or(in_cube[i].filter(|_| object[i])),
            None => in_cube[i],
        };
        let mut searched = Vec::new();
        let mut within = Vec::with_capacity(rays.len());
        for (i, ray) in rays.iter().enumerate() {
            let (entry, exit) = search(i).inspect(|_| searched.push(i as i64)).unwrap_or(NOWHERE);
            within.push((*ray, entry, exit));
        }
        let depths = |part: fn((f64, f64)) -> f64| -> Tensor<1> {
            let values: Vec<f64> = in_cube.iter().map(|interval| part(interval.unwrap_or(NOWHERE))).collect();
            Tensor::from_data(TensorData::new(values, [rays.len()]), device)
        };
        Self {
            rays: Rays::within(&within, device),
            searched,
            cube_interval: [depths(|(entry, _)| entry), depths(|(_, exit)| exit)],
            color,
            object,
            z_depth,
            in_cube: in_cube.iter().map(Option::is_some).collect(),
            patch_pixels,
        }
    }

    /// How many pixels there are.
    pub fn len(&self) -> usize {
        self.object.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.object.is_empty()
    }
}

/// A patch that lies wholly in its image; starting at an object pixel where that is asked for and found.
fn draw_patch(views: &[&View], size: u32, on_object: bool, rng: &mut impl Rng) -> Patch {
    let mut patch = Patch { view: 0, u: 0, v: 0 };
    for _ in 0..if on_object { OBJECT_TRIES } else { 1 } {
        let view = rng.random_range(0..views.len());
        let (width, height) = views[view].image.dimensions();
        let u = rng.random_range(0..width.saturating_sub(size - 1).max(1));
        let v = rng.random_range(0..height.saturating_sub(size - 1).max(1));
        patch = Patch { view, u, v };
        if on_object && views[view].is_training_object(u, v) {
            break;
        }
    }
    patch
}
