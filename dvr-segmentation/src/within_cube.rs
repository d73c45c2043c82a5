//! What pictures show in their middles, where no object stands out of what is around it: a head on a wall, a knot of a tree.
//! Its masks end where surfaces leave a cube.
//!
//! Depths of all views become one solid, of the cube and of what is around it (free space and surfaces vote, as in Curless
//! and Levoy 1996, and the solid of least area that agrees with them is taken), and a mask is where a view meets it in the
//! cube first. So all masks show the same thing.

use dvr_core::voxel::{Segment, VoxelGrid, VoxelTraversal, least_area};
use dvr_core::{Cancellation, Cancelled, Mask, View, signed_distance};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::HALF;
use crate::outline::{Edges, drawn};
use crate::plane_sweep::{Depths, Reach, depths};
use crate::shrunk::{FINAL_SIZE, Shrunk};
use crate::volume::Cube;

/// How far depths are looked for: what may hide the cube, and what is seen beside it.
const REACH: Reach = Reach { before: 2.5 * HALF, behind: 6.0 * HALF };

/// The share of the points in the middles of pictures, a half of their width and height, that the cube holds.
const HELD: f64 = 0.9;

/// Least and greatest half edge of the cube, and its margin as a share.
const HALF_EDGES: [f32; 2] = [0.5 * HALF, 2.0 * HALF];
const MARGIN: f32 = 0.1;

/// How much further than the cube the solid reaches, as a share of its half edge, and nodes along its edge.
const AROUND: f32 = 1.6;
pub(crate) const NODES: usize = 145;

/// Nodes that are further before a surface than this are free, those that are behind it by up to [`THICK`] times as much solid;
/// spacings.
const BAND: f32 = 2.0;
const THICK: f32 = 3.0;

/// Views that must say something of a node; what it costs that fewer do.
const LEAST_VOTES: f32 = 2.0;
const UNSEEN: f32 = 0.2;

/// The least share of all pixels that must meet something in the cube.
const LEAST: f64 = 0.02;

/// How much the solid counts against outlines in plain colour, and the distance from which it counts so much, working pixels.
const TRUST: f32 = 2.5;
const BLURRED: f32 = 2.5;

/// Steps of the solver of outlines.
const OUTLINE_STEPS: usize = 100;

/// Masks of what lies in the cube; `None` where too little is known of it. Views that are not `asked` have no say.
///
/// # Errors
/// [`Cancelled`] where somebody wants it to end.
pub(crate) fn within_cube(
    views: &[View],
    small: &[Shrunk],
    asked: &[bool],
    cancellation: &Cancellation,
    done: &(dyn Fn() + Sync),
) -> Result<Option<Vec<Mask>>, Cancelled> {
    let known = depths(small, asked, REACH, cancellation, done)?;
    let asked: Vec<(&Shrunk, &Depths)> =
        (small.iter().zip(&known).zip(asked)).filter_map(|(view, asked)| asked.then_some(view)).collect();
    let Some(cube) = looked_at(&asked) else { return Ok(None) };
    let solid = Solid::agreed(&asked, cube, cancellation)?;
    let shown: Vec<Vec<bool>> = small.par_iter().map(|view| solid.shown_in_cube(view)).collect();
    let pixels: usize = shown.iter().map(Vec::len).sum();
    let within = shown.iter().flatten().filter(|shown| **shown).count();
    if (within as f64) < LEAST * pixels as f64 {
        return Ok(None);
    }
    let mask = |i: usize| {
        cancellation.check()?;
        let mask = outlined(&shown[i], &small[i], &views[i]);
        done();
        Ok(mask)
    };
    Ok(Some((0..views.len()).into_par_iter().map(mask).collect::<Result<_, Cancelled>>()?))
}

/// The cube around most of what is in the middles of pictures.
fn looked_at(views: &[(&Shrunk, &Depths)]) -> Option<Cube> {
    let mut points: Vec<Vec3> = Vec::new();
    for (view, depths) in views {
        let size = Vec2::new(view.width as f32, view.height as f32);
        for (pixel, depth) in depths.iter().enumerate().filter(|(_, depth)| depth.is_finite()) {
            let place = view.middle(pixel);
            if (place / size - 0.5).abs().max_element() < 0.25 {
                points.push(view.camera.center + depth * view.camera.direction_through(place));
            }
        }
    }
    let of = |share: f64, values: &mut Vec<f32>| {
        let at = (share * values.len().checked_sub(1)? as f64) as usize;
        Some(*values.select_nth_unstable_by(at, f32::total_cmp).1)
    };
    let middle = |axis: usize| of(0.5, &mut points.iter().map(|point| point[axis]).collect());
    let origin = Vec3::new(middle(0)?, middle(1)?, middle(2)?);
    let half = of(HELD, &mut points.iter().map(|point| (*point - origin).abs().max_element()).collect())?;
    Some(Cube { origin, half: ((1.0 + MARGIN) * half).clamp(HALF_EDGES[0], HALF_EDGES[1]) })
}

/// What surfaces that views see enclose, as a layer behind them.
struct Solid {
    cube: Cube,
    /// Around the middle of the cube.
    grid: VoxelGrid,
    solid: Vec<bool>,
}

impl Solid {
    fn agreed(views: &[(&Shrunk, &Depths)], cube: Cube, cancellation: &Cancellation) -> Result<Self, Cancelled> {
        let grid = VoxelGrid::new(NODES, AROUND * cube.half);
        let band = BAND * grid.spacing();
        let price = |node: usize| {
            let point = cube.origin + grid.position(node);
            let (mut sum, mut votes) = (0f32, 0f32);
            for (view, depths) in views {
                let (place, z) = view.camera.project(point);
                let Some(pixel) = view.pixel_at(place).filter(|_| z > 0.0) else { continue };
                let behind = (z - depths[pixel]) / band;
                // No number where no depth is known.
                if behind < THICK {
                    sum += behind.clamp(-1.0, 1.0);
                    votes += 1.0;
                }
            }
            if votes < LEAST_VOTES { UNSEEN } else { -sum / votes }
        };
        let price: Vec<f32> = (0..grid.len()).into_par_iter().map(price).collect();
        cancellation.check()?;
        let solid = least_area(&grid, &price, &vec![true; grid.len()], cancellation)?;
        Ok(Self { cube, grid, solid })
    }

    /// The pixels of a view that meet it in the cube first.
    fn shown_in_cube(&self, view: &Shrunk) -> Vec<bool> {
        let start = view.camera.center - self.cube.origin;
        let of_pixel = |pixel: usize| {
            let direction = view.camera.direction_through(view.middle(pixel));
            let mut passed = VoxelTraversal::new(&self.grid, start, direction, 0.0, f32::MAX).into_iter().flatten();
            passed.find(|segment| self.is_solid(segment.cell)).is_some_and(|Segment { enter, leave, .. }| {
                let met = start + 0.5 * (enter + leave) * direction;
                met.abs().max_element() < self.cube.half
            })
        };
        (0..view.len()).map(of_pixel).collect()
    }

    /// Whether half of a cell's corners are.
    fn is_solid(&self, cell: [usize; 3]) -> bool {
        let first = self.grid.index(cell);
        let solid = self.grid.corner_offsets().into_iter().filter(|offset| self.solid[first + offset]);
        solid.count() >= 4
    }
}

/// A mask with its outline on edges of the photograph that are near.
fn outlined(shown: &[bool], small: &Shrunk, view: &View) -> Mask {
    let fine = Shrunk::new(view, FINAL_SIZE);
    let scale = fine.width as f32 / small.width as f32;
    let at = |pixel: usize| small.pixel_at(fine.middle(pixel) / scale);
    let covered: Vec<bool> = (0..fine.len()).map(|pixel| at(pixel).is_some_and(|at| shown[at])).collect();
    let distance = signed_distance(&covered, fine.width);
    let price: Vec<f32> =
        distance.iter().map(|distance| -TRUST * (distance / (BLURRED * scale)).clamp(-1.0, 1.0)).collect();
    let start = covered.iter().map(|covered| f32::from(u8::from(*covered))).collect();
    drawn(&Edges::new(&fine, scale.max(1.0)).cut(&price, start, OUTLINE_STEPS), &fine, view)
}
