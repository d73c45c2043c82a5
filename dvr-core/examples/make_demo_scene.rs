//! Makes the scene of the demo, `assets/scenes/mug`: a mug with a painted seaside.
//!
//! Nothing in it is anybody else's: the shape is a surface of revolution and a sweep, the picture is a handful of
//! formulas. It has what silhouettes alone cannot show (the inside), a hole (the handle) and detail to match across
//! views.
//!
//! ```sh
//! cargo run -p dvr-core --example make_demo_scene -- assets/scenes
//! ```

use std::f32::consts::{PI, TAU};
use std::path::PathBuf;

use dvr_core::mesh::{Material, Mesh, TexturedMesh, shapes};
use dvr_core::synth::{Lighting, SynthConfig, render_dataset};
use glam::{Vec2, Vec3};

/// Distance of vertices, which carry the colours: half a pixel of the pictures.
const SPACING: f32 = 0.005;
const HEIGHT: f32 = 0.66;

fn main() -> dvr_core::Result<()> {
    let out = std::env::args_os().nth(1).map_or_else(|| PathBuf::from("assets/scenes"), PathBuf::from);
    let mug = TexturedMesh {
        mesh: shapes::union([body(), handle()]),
        materials: vec![Material { base_color: [1.0; 3], texture: None }],
        ..TexturedMesh::default()
    };
    let config = SynthConfig {
        views: 28,
        width: 128,
        height: 128,
        // Closer than usual: every pixel of so small pictures counts.
        focal: 2.2,
        lighting: Lighting { ambient: 0.55, ..Lighting::default() },
        surface_points: 10_000,
        occupancy_points: 10_000,
        ..SynthConfig::default()
    };
    render_dataset(&mug, "mug", "mug", &out, &config, &|done, total| eprintln!("{done} of {total} views"))
}

/// The vessel: outside, lip, inside and foot in one closed profile.
fn body() -> Mesh {
    let mut outline =
        vec![Vec2::new(0.0, 0.022), Vec2::new(0.205, 0.022), Vec2::new(0.215, 0.0), Vec2::new(0.245, 0.0)];
    // The foot's rounded corner, the wall with a slight belly, the round lip, and the inside down to its middle.
    outline
        .extend((0..=8).map(|i| Vec2::new(0.245, 0.035) + 0.035 * Vec2::from_angle(0.5 * PI * (i as f32 / 8.0 - 1.0))));
    outline.extend((1..=40).map(|i| i as f32 / 40.0).map(|t| Vec2::new(outside_radius(t), 0.035 + 0.603 * t)));
    outline.extend((1..=12).map(|i| Vec2::new(0.26, 0.638) + 0.022 * Vec2::from_angle(PI * i as f32 / 12.0)));
    outline.extend(
        (1..=40).map(|i| 1.0 - i as f32 / 40.0).map(|t| Vec2::new(outside_radius(t) - 0.044, 0.115 + 0.523 * t)),
    );
    outline.extend((1..=8).map(|i| Vec2::new(0.176, 0.115) + 0.06 * Vec2::from_angle(-0.5 * PI * i as f32 / 8.0)));
    outline.push(Vec2::new(0.0, 0.055));
    let profile = resampled(&outline);
    let mut mesh = shapes::revolve(&profile, (TAU * 0.3 / SPACING) as u32);
    mesh.vertices.iter_mut().for_each(|v| v.y -= 0.5 * HEIGHT);
    let normals = mesh.normals.as_deref().unwrap_or_default();
    let paint = |(&v, &n): (&Vec3, &Vec3)| {
        let height = v.y + 0.5 * HEIGHT;
        let outwards = Vec2::new(v.x, v.z).dot(Vec2::new(n.x, n.z)) > 0.0;
        match (n.y < -0.7 || height < 0.02, outwards) {
            (true, _) => underside(Vec2::new(v.x, v.z)),
            (false, true) => seaside(v.z.atan2(v.x), height),
            (false, false) => inside(Vec2::new(v.x, v.z), height),
        }
    };
    mesh.colors = Some(mesh.vertices.iter().zip(normals).map(paint).collect());
    mesh
}

/// Radius of the wall at a share of its height.
fn outside_radius(t: f32) -> f32 {
    0.28 + 0.012 * (PI * t).sin() + 0.002 * t
}

/// The same outline with corners at equal distances, so that colours have the same sharpness everywhere.
fn resampled(outline: &[Vec2]) -> Vec<Vec2> {
    let mut points = vec![outline[0]];
    for pair in outline.windows(2) {
        let steps = (pair[0].distance(pair[1]) / SPACING).ceil().max(1.0);
        points.extend((1..=steps as u32).map(|i| pair[0].lerp(pair[1], i as f32 / steps)));
    }
    points
}

/// An ear whose ends are sunk into the wall, wound with rope.
fn handle() -> Mesh {
    let [a, b, c, d] = [[0.27, 0.18], [0.60, 0.30], [0.50, -0.24], [0.265, -0.17]].map(Vec2::from);
    let curve =
        |t: f32| (1.0 - t).powi(3) * a + 3.0 * t * (1.0 - t).powi(2) * b + 3.0 * t * t * (1.0 - t) * c + t.powi(3) * d;
    let slope = |t: f32| (1.0 - t).powi(2) * (b - a) + 2.0 * t * (1.0 - t) * (c - b) + t * t * (d - c);
    let (rows, columns) = (160, 48);
    let frames: Vec<shapes::Frame> = (0..=rows)
        .map(|i| i as f32 / rows as f32)
        .map(|t| {
            let along = slope(t).normalize().extend(0.0);
            let thickness = 0.026 + 0.008 * (2.0 * t - 1.0).powi(4);
            shapes::Frame {
                center: curve(t).extend(0.0),
                x: thickness * Vec3::Z.cross(along),
                y: 1.3 * thickness * Vec3::Z,
            }
        })
        .collect();
    let circle: Vec<Vec2> = (0..columns).map(|i| Vec2::from_angle(TAU * i as f32 / columns as f32)).collect();
    let mut mesh = shapes::loft(&frames, &circle, false);
    let strand = |i: usize| {
        let (row, column) = ((i / columns).min(rows) as f32 / rows as f32, (i % columns) as f32 / columns as f32);
        let phase = (14.0 * row + column).fract();
        let groove = smooth(0.09, 0.03, (phase - 0.5).abs());
        mix(mix([0.86, 0.70, 0.45], [0.68, 0.48, 0.27], smooth(0.5, 1.0, phase)), [0.30, 0.18, 0.10], groove)
    };
    mesh.colors = Some((0..mesh.vertices.len()).map(strand).collect());
    mesh
}

type Color = [f32; 3];

const NAVY: Color = [0.10, 0.16, 0.36];
const CREAM: Color = [0.96, 0.92, 0.82];
const RED: Color = [0.80, 0.16, 0.14];

fn mix(a: Color, b: Color, t: f32) -> Color {
    Vec3::from(a).lerp(Vec3::from(b), t.clamp(0.0, 1.0)).to_array()
}

/// 0 at `from`, 1 at `to`, smooth between; `from` may be the larger.
fn smooth(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// 1 where a signed distance is negative, with an edge one vertex wide.
fn within(distance: f32) -> f32 {
    smooth(0.5 * SPACING, -0.5 * SPACING, distance)
}

/// Picture around the outside: `angle` around the mug, `y` from the table up.
fn seaside(angle: f32, y: f32) -> Color {
    // Distances along the wall from the middle of a motif.
    let around = |turn: f32| 0.29 * ((angle / TAU - turn + 1.5).fract() - 0.5) * TAU;
    let mut color = mix([0.98, 0.83, 0.62], [0.42, 0.68, 0.90], smooth(0.18, 0.52, y));
    // The sun and its rays.
    let sun = Vec2::new(around(0.31), y - 0.46);
    let ray = within(sun.length() - 0.095).min(within(0.068 - sun.length()))
        * smooth(-0.1, 0.1, (12.0 * sun.to_angle()).cos());
    color = mix(color, [0.97, 0.58, 0.16], ray);
    color = mix(color, [0.99, 0.76, 0.20], within(sun.length() - 0.058));
    // Clouds are heaps of discs.
    for (turn, height) in [(0.12, 0.50), (0.47, 0.545), (0.70, 0.48), (0.93, 0.54)] {
        let at = Vec2::new(around(turn), y - height);
        let disc = |x: f32, y: f32, r: f32| at.distance(Vec2::new(x, y)) - r;
        let heap = disc(0.0, 0.0, 0.034).min(disc(0.042, -0.006, 0.025)).min(disc(-0.04, -0.008, 0.023));
        color = mix(color, [0.99, 0.99, 0.98], within(heap.max(-0.022 - at.y)));
    }
    // Gulls are pairs of arcs.
    for (turn, height, size) in [(0.23, 0.36, 0.032), (0.40, 0.42, 0.026), (0.60, 0.40, 0.03), (0.985, 0.44, 0.028)] {
        let at = Vec2::new(around(turn).abs() - 0.5 * size, y - height) / size;
        let wing = (at.y - 0.25 + at.x * at.x * 1.6).abs() * size - 0.0042;
        color = mix(color, [0.20, 0.22, 0.28], within(wing.max((at.x.abs() - 0.55) * size)));
    }
    color = lighthouse(color, around(0.83), y);
    color = boat(color, around(0.56), y);
    color = boat(color, 1.4 * around(0.07), 1.4 * (y - 0.02));
    // Three rows of waves with foam, the nearest darkest.
    for (row, [r, g, b]) in [[0.30, 0.62, 0.74], [0.18, 0.45, 0.64], [0.11, 0.29, 0.51]].into_iter().enumerate() {
        let row = row as f32;
        let crest = 0.20 - 0.052 * row + 0.010 * ((11.0 + 4.0 * row) * angle + 1.7 * row).sin();
        color = mix(color, [r, g, b], within(y - crest));
        color = mix(color, [0.93, 0.97, 0.98], within((y - crest + 0.009).abs() - 0.0042));
    }
    // Bands at the foot and the lip, the upper one with dots.
    color = mix(color, NAVY, within((y - 0.012).abs() - 0.022).max(within(0.60 - y)));
    let dot = Vec2::new(0.29 * TAU / 36.0 * ((36.0 * angle / TAU + 36.5).fract() - 0.5), y - 0.617);
    mix(color, CREAM, within(dot.length() - 0.0085))
}

/// A striped tower on a hill.
fn lighthouse(under: Color, x: f32, y: f32) -> Color {
    let hill = y - 0.175 - 0.085 * (-(x / 0.11).powi(2)).exp();
    let mut color = mix(under, mix([0.25, 0.48, 0.22], [0.45, 0.66, 0.30], smooth(0.16, 0.26, y)), within(hill));
    let half_width = 0.042 - 0.05 * (y - 0.24);
    let tower = (x.abs() - half_width).max(0.235 - y).max(y - 0.46);
    let stripe = if (22.0 * (y - 0.24) + 2.2 * x).rem_euclid(2.0) < 1.0 { RED } else { CREAM };
    color = mix(color, stripe, within(tower));
    color = mix(color, NAVY, within((x.abs() - 0.010).max((y - 0.275).abs() - 0.024)));
    color = mix(color, [0.99, 0.86, 0.35], within((x.abs() - 0.021).max((y - 0.482).abs() - 0.022)));
    let rails = ((y - 0.462).abs() - 0.005).max(x.abs() - 0.043).min((x.abs() - 0.003).max((y - 0.482).abs() - 0.022));
    let roof = (x.abs() - 0.9 * (0.545 - y)).max(0.504 - y);
    mix(color, [0.22, 0.20, 0.24], within(rails.min(roof)))
}

/// Two sails on a hull.
fn boat(under: Color, x: f32, y: f32) -> Color {
    let hull = (y - 0.225).max(0.185 - y).max(x.abs() - 0.045 - 0.6 * (y - 0.2));
    let main_sail = (0.004 - x).max(0.235 - y).max(x - 0.55 * (0.37 - y));
    let fore_sail = (x + 0.004).max(0.235 - y).max(-x - 0.42 * (0.33 - y));
    let color = mix(under, RED, within(hull));
    mix(mix(color, [0.98, 0.97, 0.93], within(main_sail)), [0.95, 0.75, 0.30], within(fore_sail))
}

/// Cream, with rings, rows of dots, and a compass rose at the bottom.
fn inside(at: Vec2, y: f32) -> Color {
    let ring = |height: f32, width: f32| within((y - height).abs() - width);
    let mut color = mix(CREAM, NAVY, ring(0.56, 0.008).max(ring(0.535, 0.0035)).max(within(0.60 - y)));
    color = mix(color, [0.36, 0.60, 0.70], ring(0.22, 0.012));
    let (radius, angle) = (at.length(), at.to_angle());
    for row in 0..5 {
        let turn = 18.0 * angle / TAU + 18.5 + 0.5 * (row % 2) as f32;
        let dot = Vec2::new(0.24 * TAU / 18.0 * (turn.fract() - 0.5), y - 0.27 - 0.055 * row as f32);
        let tint = if row % 2 == 0 { [0.36, 0.60, 0.70] } else { RED };
        color = mix(color, tint, within(dot.length() - 0.013));
    }
    for (points, size, tint) in [(4.0, 0.095, [0.36, 0.60, 0.70]), (4.0, 0.135, RED)] {
        let turn = if size < 0.1 { 0.5 } else { 0.0 };
        let share = ((points * angle / TAU + turn + points).fract() - 0.5).abs() * 2.0;
        let floor = within(y - 0.062);
        color = mix(color, tint, floor * within(radius - size * (0.25 + 0.75 * share.powi(3))));
    }
    mix(color, NAVY, within(y - 0.062) * within((radius - 0.15).abs() - 0.006))
}

/// The bottom: cream with rings and a mark.
fn underside(at: Vec2) -> Color {
    let rings = within((at.length() - 0.15).abs() - 0.012).max(within((at.length() - 0.11).abs() - 0.004));
    let mark = (at.x.abs() - 0.05).max(at.y.abs() - 0.018).min((at.y.abs() - 0.05).max(at.x.abs() - 0.018));
    mix(mix(CREAM, [0.36, 0.60, 0.70], rings), NAVY, within(mark))
}
