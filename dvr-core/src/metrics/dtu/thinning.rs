//! Thinning a cloud until no two of its points are near each other.

use glam::{DVec3, I64Vec3};
use rustc_hash::FxHashMap;

/// Goes through the points in their order and leaves out each that is at most `distance` away from one that stays.
pub(super) fn thinned(points: &[DVec3], distance: f64) -> Vec<DVec3> {
    let mut kept: Vec<DVec3> = Vec::new();
    // The last point of each cell, and of each point the one before it in its cell.
    let mut last: FxHashMap<I64Vec3, u32> = FxHashMap::default();
    let mut before: Vec<Option<u32>> = Vec::new();
    for &point in points {
        let cell = (point / distance).floor().as_i64vec3();
        let around = (0..27).map(|i| cell + I64Vec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
        let is_near = |cell: I64Vec3| {
            std::iter::successors(last.get(&cell).copied(), |&index| before[index as usize])
                .any(|index| kept[index as usize].distance_squared(point) <= distance * distance)
        };
        if around.into_iter().any(is_near) {
            continue;
        }
        before.push(last.insert(cell, kept.len() as u32));
        kept.push(point);
    }
    kept
}
