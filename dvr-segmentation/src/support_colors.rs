//! What the support plane looks like where nothing stands on it, by all photographs that see each of its places. Object and plane
//! stand still, and shadows and patterns stay where they are: what looks otherwise stands before the plane.

use dvr_core::{Cancellation, Cancelled, Pinhole};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::HALF;
use crate::shrunk::Shrunk;
use crate::support_plane::SupportPlane;

/// How far around the foot of the origin the plane is looked at, and cells along twice that.
const REACH: f32 = 3.0 * HALF;
const CELLS: usize = 384;
const CELL: f32 = 2.0 * REACH / CELLS as f32;

/// What is seen at a smaller sine above the plane is smeared.
const LEAST_SINE: f32 = 0.12;

/// A pixel that belongs to the object by more than this is no picture of the plane.
const CLEAR: f32 = 0.2;

/// Views that must see a place of the plane; and of those that have it in their frames the share, since below the object only
/// wrong outlines show the plane.
const LEAST_VIEWS: usize = 3;
const LEAST_SHARE: f32 = 0.15;

/// The share of them that must agree about its colour, and the largest difference of a channel, of 255, at which they do: beyond
/// the edge of a table, or of a turntable, there is no plane.
const MOST: f32 = 0.85;
const AGREEING: f32 = 24.0;

/// Least standard deviation of a channel: noise, and sampling.
const NOISE: f32 = 8.0;

/// The share of the plane's pixels that look like anything: reflections, and what is wrong about cells.
const OTHERWISE: f32 = 0.1;

/// From the median absolute deviation to the standard deviation.
const SPREAD: f32 = 1.48;

/// The colours of a cell and those beside it, from the lowest channels to the highest, and how far samples stray from these.
struct Cell {
    low: Vec3,
    high: Vec3,
    spread: Vec3,
}

impl Cell {
    /// How far a colour is out of the range.
    fn off(&self, color: Vec3) -> Vec3 {
        (self.low - color).max(color - self.high).max(Vec3::ZERO)
    }
}

/// The colours of the plane, of 255.
pub(crate) struct SupportColors {
    plane: SupportPlane,
    axes: [Vec3; 2],
    /// `None` where too few views see the plane, or do not agree.
    cells: Vec<Option<Cell>>,
}

impl SupportColors {
    /// By views, and how much each of their pixels belongs to the object.
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn new(
        plane: SupportPlane,
        views: &[(&Shrunk, &[f32])],
        cancellation: &Cancellation,
    ) -> Result<Self, Cancelled> {
        let axis = plane.normal.any_orthonormal_vector();
        let axes = [axis, plane.normal.cross(axis)];
        let samples = |index: usize| {
            let [x, y] = [index % CELLS, index / CELLS].map(|at| (at as f32 + 0.5) * CELL - REACH);
            samples(plane.offset * plane.normal + x * axes[0] + y * axes[1], plane.normal, views)
        };
        let middle = |index| samples(index).map(|samples| median(&samples));
        let middles: Vec<Option<Vec3>> = (0..CELLS * CELLS).into_par_iter().map(middle).collect();
        cancellation.check()?;
        let cell = |index: usize| {
            let color = middles[index]?;
            let mut cell = Cell { low: color, high: color, spread: Vec3::ZERO };
            let beside = |at: usize| at.saturating_sub(1)..(at + 2).min(CELLS);
            for y in beside(index / CELLS) {
                for color in beside(index % CELLS).filter_map(|x| middles[y * CELLS + x]) {
                    (cell.low, cell.high) = (cell.low.min(color), cell.high.max(color));
                }
            }
            let off: Vec<Vec3> = samples(index)?.iter().map(|sample| cell.off(*sample)).collect();
            let agreeing = off.iter().filter(|off| off.max_element() < AGREEING).count();
            cell.spread = SPREAD * median(&off);
            (agreeing as f32 >= MOST * off.len() as f32).then_some(cell)
        };
        let cells = (0..CELLS * CELLS).into_par_iter().map(cell).collect();
        cancellation.check()?;
        Ok(Self { plane, axes, cells })
    }

    /// How dense a colour is at a place of a view if that shows the plane, relative to all colours being as frequent. `None` where
    /// the plane is not seen, or not known.
    pub fn density(&self, camera: &Pinhole, place: Vec2, color: [u8; 3]) -> Option<f32> {
        let direction = camera.direction_through(place);
        let sine = -direction.dot(self.plane.normal);
        if sine < LEAST_SINE * direction.length() {
            return None;
        }
        let met = camera.center + self.plane.distance(camera.center) / sine * direction;
        let [x, y] = self.axes.map(|axis| (met.dot(axis) + REACH) / CELL);
        let inside = x >= 0.0 && y >= 0.0 && x < CELLS as f32 && y < CELLS as f32;
        let cell = self.cells[inside.then(|| y as usize * CELLS + x as usize)?].as_ref()?;
        // A normal distribution about the range, as high as that is narrow.
        let deviation = (cell.spread * cell.spread + NOISE * NOISE).map(f32::sqrt);
        let width = deviation * (2.0 * std::f32::consts::PI).sqrt() + (cell.high - cell.low);
        let off = cell.off(Vec3::from(color.map(f32::from))) / deviation;
        let height = (Vec3::splat(256.0) / width).element_product();
        Some((1.0 - OTHERWISE) * height * (-0.5 * off.length_squared()).exp() + OTHERWISE)
    }
}

/// The colours of a place of the plane in all views that see it; `None` where these are too few.
fn samples(point: Vec3, normal: Vec3, views: &[(&Shrunk, &[f32])]) -> Option<Vec<Vec3>> {
    let (mut samples, mut facing) = (Vec::new(), 0);
    for (view, belongs) in views {
        let towards = view.camera.center - point;
        let (place, z) = view.camera.project(point);
        let Some(pixel) = view.pixel_at(place).filter(|_| z > 0.0) else { continue };
        if towards.dot(normal) >= LEAST_SINE * towards.length() {
            facing += 1;
            if belongs[pixel] <= CLEAR {
                samples.push(Vec3::from(view.colors[pixel].map(f32::from)));
            }
        }
    }
    let is_seen = samples.len() >= LEAST_VIEWS && samples.len() as f32 >= LEAST_SHARE * facing as f32;
    is_seen.then_some(samples)
}

/// That of each channel; there must be a sample.
fn median(samples: &[Vec3]) -> Vec3 {
    let of = |axis: usize| {
        let mut values: Vec<f32> = samples.iter().map(|sample| sample[axis]).collect();
        let at = values.len() / 2;
        *values.select_nth_unstable_by(at, f32::total_cmp).1
    };
    Vec3::new(of(0), of(1), of(2))
}

#[cfg(test)]
pub(crate) mod tests {
    use dvr_core::{Camera, View, stored};
    use glam::DVec3;
    use image::{Rgb, RgbImage};

    use super::*;

    pub(crate) const BALL: f32 = 0.15;
    const TABLE: f32 = 0.5;
    const DARK: [u8; 3] = [40, 60, 120];
    const LIGHT: [u8; 3] = [230, 230, 225];

    /// Squares of two colours, up to the table's edge.
    fn table(point: Vec3) -> Option<[u8; 3]> {
        let is_dark = ((point.x / 0.2).floor() + (point.y / 0.2).floor()).rem_euclid(2.0) < 1.0;
        let on = point.x.abs().max(point.y.abs()) < TABLE;
        on.then_some(if is_dark { DARK } else { LIGHT })
    }

    /// A ball on a table at z = -BALL, and beyond its edge something else for each view; what of it shows the ball.
    pub(crate) fn view(index: usize) -> (Shrunk, Vec<f32>) {
        let turn = index as f64 * 0.7;
        let eye = DVec3::new(1.6 * turn.cos(), 1.6 * turn.sin(), 1.0 + 0.1 * (index % 3) as f64);
        let camera = Camera::look_at(120, 120, 150.0, eye, DVec3::ZERO, DVec3::Z);
        let pinhole = Pinhole::new(&camera);
        let mut belongs = Vec::new();
        let picture = RgbImage::from_fn(120, 120, |u, v| {
            let direction = pinhole.direction_through(Vec2::new(u as f32 + 0.5, v as f32 + 0.5)).normalize();
            let nearest = pinhole.center - pinhole.center.dot(direction) * direction;
            let shows_ball = nearest.length() < BALL;
            belongs.push(f32::from(u8::from(shows_ball)));
            let met = pinhole.center - (pinhole.center.z + BALL) / direction.z * direction;
            let beyond = [20 * (index % 12) as u8, 255 - 20 * (index % 12) as u8, 90];
            Rgb(if shows_ball { [200, 40, 40] } else { table(met).unwrap_or(beyond) })
        });
        (Shrunk::new(&View::new("a", camera, stored(picture), None), 120), belongs)
    }

    #[test]
    fn what_stands_before_the_plane_looks_unlike_it_and_beyond_its_edge_nothing_is_known() {
        let views: Vec<(Shrunk, Vec<f32>)> = (0..12).map(view).collect();
        let all: Vec<(&Shrunk, &[f32])> = views.iter().map(|(view, belongs)| (view, belongs.as_slice())).collect();
        let plane = SupportPlane { normal: Vec3::Z, offset: -BALL };
        let colors = SupportColors::new(plane, &all, &Cancellation::default()).unwrap();
        let (view, belongs) = &views[4];
        let mut counts = [0; 4];
        for (pixel, belongs) in belongs.iter().enumerate() {
            let place = view.middle(pixel);
            let direction = view.camera.direction_through(place);
            let met = view.camera.center - (view.camera.center.z + BALL) / direction.z * direction;
            let density = colors.density(&view.camera, place, view.colors[pixel]);
            if *belongs > 0.0 {
                // Of what is hidden by the ball nothing may be known.
                counts[0] += 1;
                assert!(density.is_none_or(|density| density < 0.2), "ball at {place}: {density:?}");
            } else if met.abs().max_element() < 0.9 * TABLE && met.length() > 2.5 * BALL {
                // On the edges of squares both colours are the plane's, or views do not agree.
                assert!(density.is_none_or(|density| density > 1.0), "table at {place}: {density:?}");
                counts[1] += 1;
                if let Some(density) = density.filter(|density| *density > 50.0) {
                    counts[3] += 1;
                    // The colour of the other squares is not that of the plane here.
                    let other = if view.colors[pixel] == DARK { LIGHT } else { DARK };
                    let of_other = colors.density(&view.camera, place, other).unwrap();
                    assert!(of_other < 0.01 * density, "{of_other} at {place}");
                }
            } else if met.truncate().abs().max_element() > 1.1 * TABLE {
                counts[2] += usize::from(density.is_none());
            }
        }
        assert!(counts[0] > 300 && counts[1] > 1000 && counts[2] > 1000, "{counts:?}");
        assert!(10 * counts[3] > 7 * counts[1], "{counts:?}");
    }
}
