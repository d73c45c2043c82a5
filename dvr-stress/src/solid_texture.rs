//! Colours of places in space: solid textures (Perlin, "An image synthesizer", 1985), for what is carved out of a block.

use glam::DVec3;

/// Noise of four octaves, from 0 to 1; each seed has its own.
pub(crate) fn blotches(at: DVec3, seed: u64) -> f64 {
    let octave = |i: u64| 0.62f64.powi(i as i32) * (lattice(at * (1 << i) as f64, 8 * seed + i) - 0.5);
    (0.5 + 1.1 * (0..4).map(octave).sum::<f64>()).clamp(0.0, 1.0)
}

/// Red and yellow blotches of many sizes.
pub(crate) fn stone(at: DVec3) -> DVec3 {
    let value = blotches(9.0 * at, 1);
    DVec3::new(0.95, 0.75, 0.25).lerp(DVec3::new(0.55, 0.08, 0.06), value) * (0.55 + 0.45 * blotches(23.0 * at, 2))
}

/// Random values at whole coordinates, and between them smooth ones.
fn lattice(at: DVec3, seed: u64) -> f64 {
    let (cell, t) = (at.floor(), at - at.floor());
    let t = t * t * (DVec3::splat(3.0) - 2.0 * t);
    let value = |corner: u32| {
        let offset = DVec3::new(f64::from(corner & 1), f64::from(corner >> 1 & 1), f64::from(corner >> 2));
        let share = offset * t + (DVec3::ONE - offset) * (DVec3::ONE - t);
        let mixed = (cell + offset).to_array().iter().fold(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15), |hash, x| {
            let hash = (hash ^ (*x as i64 as u64)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            hash ^ (hash >> 29)
        });
        share.element_product() * (mixed >> 40) as f64 / f64::from(1 << 24)
    };
    (0..8).map(value).sum()
}
