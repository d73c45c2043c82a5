//! Writes the shapes of the benchmark as meshes that `dvr synth` renders: what is smooth, sharp, thin and thinner.
//!
//! ```sh
//! cargo run --release -p dvr-core --example make_shapes -- FOLDER
//! dvr synth FOLDER/*.ply --category res64 --size 64 --out SCENES
//! ```
//!
//! Nothing in them is anybody else's. `blob` is a ball with dents, `sharp` a stepped tower with a groove and a point,
//! `plate` crossed plates .012 thick, `rods` the edges of a cube, .022 thick.

use std::path::PathBuf;

use dvr_core::files::write_bytes_atomically;
use dvr_core::mesh::{Mesh, shapes, write_mesh};
use glam::{Vec2, Vec3};

/// Longest edge of a face: a pixel of pictures of 64 pixels.
const LONGEST_EDGE: f32 = 0.03;

fn main() -> dvr_core::Result<()> {
    let folder = std::env::args_os().nth(1).map_or_else(|| PathBuf::from("shapes"), PathBuf::from);
    std::fs::create_dir_all(&folder).map_err(|error| dvr_core::Error::io(&folder, error))?;
    let shapes = [
        ("blob", blob()),
        ("sharp", sharp()),
        ("plate", shapes::crossed_plates(0.9, 0.012)),
        ("rods", shapes::wire_cube(0.878, 0.011)),
    ];
    for (name, mesh) in shapes {
        let path = folder.join(format!("{name}.ply"));
        write_mesh(&path, &painted(divided(mesh)))?;
        println!("wrote {}", path.display());
    }
    let readme = "Made by dvr-core/examples/make_shapes.rs.\n";
    write_bytes_atomically(&folder.join("README.txt"), readme.as_bytes())
}

/// A ball with dents and bumps.
fn blob() -> Mesh {
    let mut mesh = shapes::icosphere(6, 1.0);
    for vertex in &mut mesh.vertices {
        let [x, y, z] = (4.0 * *vertex).to_array();
        *vertex *= 0.36 * (1.0 + 0.18 * (x + 0.7 * y).sin() + 0.12 * (y - z).cos() + 0.1 * (1.7 * z).sin());
    }
    mesh.normals = Some(shapes::vertex_normals(&mesh.vertices, &mesh.faces));
    mesh
}

/// A tower of square steps with a groove around it and a pyramid on top, in one closed surface.
fn sharp() -> Mesh {
    let outline = [
        [0.0, -0.45],
        [0.45, -0.45],
        [0.45, -0.25],
        [0.36, -0.25],
        [0.36, -0.1],
        [0.26, -0.1],
        [0.26, 0.0],
        [0.36, 0.0],
        [0.36, 0.12],
        [0.24, 0.12],
        [0.24, 0.2],
        [0.0, 0.45],
    ];
    Mesh { normals: None, ..shapes::revolve(&outline.map(Vec2::from_array), 4) }
}

/// The same surface with every face split in four, as often as its longest edge needs.
fn divided(mut mesh: Mesh) -> Mesh {
    let longest = |mesh: &Mesh| {
        let edges = (0..mesh.faces.len()).map(|face| mesh.triangle(face));
        edges.flat_map(|[a, b, c]| [a.distance(b), b.distance(c), c.distance(a)]).fold(0.0, f32::max)
    };
    while longest(&mesh) > LONGEST_EDGE {
        let mut finer = Mesh::default();
        for face in 0..mesh.faces.len() {
            let [a, b, c] = mesh.triangle(face);
            let [ab, bc, ca] = [a.midpoint(b), b.midpoint(c), c.midpoint(a)];
            let first = finer.vertices.len() as u32;
            finer.vertices.extend([a, b, c, ab, bc, ca]);
            finer.faces.extend([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]].map(|face| face.map(|i| first + i)));
        }
        mesh = finer;
    }
    mesh
}

/// Colours by position, with waves that views can be matched by.
fn painted(mut mesh: Mesh) -> Mesh {
    let paint = |p: &Vec3| {
        let wave = |phase: f32| 0.12 * (23.0 * p.x + 31.0 * p.y + 17.0 * p.z + phase).sin();
        [0.5 + 0.6 * p.x + wave(0.0), 0.5 + 0.6 * p.y + wave(2.1), 0.5 + 0.6 * p.z + wave(4.2)]
            .map(|channel| channel.clamp(0.05, 0.95))
    };
    mesh.colors = Some(mesh.vertices.iter().map(paint).collect());
    mesh
}
