//! Surfaces of many handles.

use std::collections::HashMap;

use dvr_core::mesh::Mesh;
use glam::Vec3;

use super::placement::tilted;

/// Edge of the plate's longer side, object units.
const EDGE: f32 = 0.72;

/// A thick plate with square holes, as wide as the bars between them: a surface whose genus is the number of holes.
pub(crate) fn perforated(holes: usize) -> Mesh {
    // As square as possible: 20 is 5 by 4.
    let rows = (1..=holes).filter(|rows| rows * rows <= holes && holes.is_multiple_of(*rows)).max().unwrap_or(1);
    let columns = holes / rows;
    let cells = [2 * columns + 1, 2 * rows + 1];
    let solid = |x: i32, y: i32, z: i32| {
        let within = |i: i32, count: usize| (0..count as i32).contains(&i);
        within(x, cells[0]) && within(y, cells[1]) && z == 0 && !(x % 2 == 1 && y % 2 == 1)
    };
    let scale = EDGE / cells[0] as f32;
    let middle = 0.5 * Vec3::new(cells[0] as f32, cells[1] as f32, 1.0);
    let mut mesh = Mesh::default();
    let mut numbers: HashMap<[i32; 3], u32> = HashMap::new();
    let mut corner = |place: [i32; 3], mesh: &mut Mesh| {
        *numbers.entry(place).or_insert_with(|| {
            mesh.vertices.push(scale * (Vec3::from(place.map(|c| c as f32)) - middle));
            (mesh.vertices.len() - 1) as u32
        })
    };
    for y in 0..cells[1] as i32 {
        for x in (0..cells[0] as i32).filter(|&x| solid(x, y, 0)) {
            for (axis, side) in (0..3).flat_map(|axis| [(axis, 0), (axis, 1)]) {
                let mut beside = [x, y, 0];
                beside[axis] += 2 * side - 1;
                if solid(beside[0], beside[1], beside[2]) {
                    continue;
                }
                // Counter-clockwise around the axis; seen from the low side that is clockwise.
                let around = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(s, t)| {
                    let mut place = [x, y, 0];
                    place[axis] += side;
                    place[(axis + 1) % 3] += s;
                    place[(axis + 2) % 3] += t;
                    corner(place, &mut mesh)
                });
                let [a, b, c, d] = if side == 1 { around } else { [around[0], around[3], around[2], around[1]] };
                mesh.faces.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    tilted(mesh)
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::Topology;

    use super::*;
    use crate::shapes::measures::volume;

    #[test]
    fn the_genus_of_a_plate_is_its_number_of_holes() {
        for holes in [1, 2, 4, 9, 20] {
            let mesh = perforated(holes);
            let topology = Topology::of(&mesh);
            assert_eq!((topology.components, topology.handles()), (1, Some(holes as i64)));
            assert_eq!(topology.euler_characteristic, 2 - 2 * holes as i64);
            assert!(volume(&mesh) > 0.0);
        }
    }
}
