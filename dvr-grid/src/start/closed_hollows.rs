//! How far training leaves hollows open. Those that it closes were none, unless colours at their mouths say otherwise
//! (`trainer/hollows.rs`).
//!
//! Where colours are smooth, a plane sweep finds matches deep inside of what is solid. Training does not believe them: colours
//! pull the surface back to where it is. But what lies deep in a hollow stays empty, and a void would remain in the object,
//! open by small holes only.

use dvr_core::voxel::VoxelGrid;
use dvr_core::{flood, signed_distance_at_nodes};

/// The mouth of a hollow must be this wide, beside its widest place.
const MOUTH: f32 = 0.95;

/// What is as wide as this is a mouth whatever lies behind it, as a radius in object units: 3.5 spacings of 32 cells.
const WIDE: f32 = 0.12;

/// The share of hollows that is open to the outside of the object, of a field with these values at the nodes, positive
/// inside: by ways that are nowhere much narrower than the hollow. One where nothing of a hollow is empty.
pub(crate) fn open_share(grid: &VoxelGrid, values: &[f32], is_in_hollow: impl Fn(usize) -> bool) -> f64 {
    let solid: Vec<bool> = values.iter().map(|&value| value > 0.0).collect();
    // Field values will not do: beside the hull they are distances to the hull, also at the mouth of a hollow.
    let room: Vec<f32> = signed_distance_at_nodes(&solid, grid).into_iter().map(|distance| -distance).collect();
    let widest = (0..grid.len()).filter(|&node| is_in_hollow(node)).map(|node| room[node]).fold(0.0, f32::max);
    let clearance = (MOUTH * widest).min(WIDE / grid.spacing());
    let mut left: Vec<bool> = room.iter().map(|&room| room > clearance).collect();
    let hollow: Vec<bool> = (0..grid.len()).map(|node| left[node] && is_in_hollow(node)).collect();
    let all = hollow.iter().filter(|&&is_in_hollow| is_in_hollow).count();
    let mut reached = 0usize;
    for start in 0..grid.len() {
        if left[start] && grid.is_on_border(start) {
            reached +=
                flood(start, &mut left, |node| grid.neighbours(node)).into_iter().filter(|&node| hollow[node]).count();
        }
    }
    if all == 0 { 1.0 } else { reached as f64 / all as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hollow_is_open_where_its_mouth_is_wide() {
        // Cells of .03; a ball of radius .4 with a void of radius .2 in it, and a way out along z.
        let grid = VoxelGrid::new(33, 0.48);
        let open = |mouth: f32| {
            let value = |node: usize| {
                let at = grid.position(node);
                let way = if at.z > 0.0 { mouth - at.truncate().length() } else { -1.0 };
                (0.4 - at.length()).min(at.length() - 0.2).min(-way)
            };
            let values: Vec<f32> = (0..grid.len()).map(value).collect();
            open_share(&grid, &values, |node| grid.position(node).length() < 0.2)
        };
        assert_eq!(open(-1.0), 0.0, "closed");
        assert_eq!(open(0.06), 0.0, "a small hole");
        assert!(open(0.16) > 0.9, "a mouth: {}", open(0.16));
        assert_eq!(open_share(&grid, &vec![1.0; grid.len()], |_| true), 1.0, "no hollow at all");
    }
}
