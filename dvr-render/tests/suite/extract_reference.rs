//! Extraction of a fitted decoder, against the meshes that DVR's reference code made of it.

use std::path::PathBuf;

use crate::support::array;
use crate::support::decoder::Decoder;
use crate::support::topology::{area, assert_watertight, euler_characteristic, volume};
use dvr_core::mesh::Mesh;
use dvr_render::extract::{ExtractSettings, Extraction, NormalSource, ScalarField, extract_mesh};
use dvr_test_support::{fixture, largest};
use glam::{DVec3, Vec3};

fn decoder() -> Decoder {
    Decoder::open(&fixture("decoder_c0_h64.safetensors"))
}

fn points(flat: &[f64]) -> Vec<DVec3> {
    flat.chunks_exact(3).map(DVec3::from_slice).collect()
}

/// One of the two extractions in the fixture.
struct Reference {
    file: PathBuf,
    /// "mise" (16 cells, refined once) or "dense" (24 nodes an edge).
    name: &'static str,
    cells: usize,
    upsampling_steps: usize,
}

impl Reference {
    fn both() -> [Self; 2] {
        let file = fixture("extract_render_c0_h64.npz");
        [
            Self { file: file.clone(), name: "mise", cells: 32, upsampling_steps: 1 },
            Self { file, name: "dense", cells: 23, upsampling_steps: 0 },
        ]
    }

    fn array<T: crate::support::FromNumber>(&self, key: &str) -> Vec<T> {
        array(&self.file, &format!("{}.{key}", self.name))
    }

    fn extract(&self, decoder: &Decoder, refinement_steps: usize) -> Extraction {
        let settings = ExtractSettings {
            resolution: self.cells,
            upsampling_steps: self.upsampling_steps,
            refinement_steps,
            normals: NormalSource::Faces,
            ..Default::default()
        };
        extract_mesh(decoder, &settings, &[]).unwrap()
    }
}

#[test]
fn the_plain_decoder_computes_what_the_reference_code_does() {
    let (decoder, file) = (decoder(), fixture("decoder_eval_c0_h64.npz"));
    let expected: Vec<f32> = array(&file, "out");
    let at: Vec<f32> = array(&file, "p");
    let ours = at.chunks_exact(3).flat_map(|p| decoder.forward(Vec3::from_slice(p)));
    for (ours, theirs) in ours.zip(&expected) {
        assert!((ours - theirs).abs() < 2e-5, "{ours} {theirs}");
    }
}

#[test]
fn values_at_the_nodes_are_those_of_the_reference_code_where_it_evaluated_them() {
    let (decoder, [mise, dense]) = (decoder(), Reference::both());
    for reference in [mise, dense] {
        let nodes = reference.cells + 1;
        let position = |k: usize| 1.1 * (k as f32 / reference.cells as f32 - 0.5);
        let at: Vec<Vec3> = (0..nodes.pow(3))
            .map(|k| Vec3::new(position(k / nodes / nodes), position(k / nodes % nodes), position(k % nodes)))
            .collect();
        let theirs: Vec<f32> = reference.array("value_grid");
        let ours = decoder.logits(&at);
        let agree = ours.iter().zip(&theirs).filter(|(a, b)| (*a - *b).abs() < 1e-4).count();
        let same_sign = ours.iter().zip(&theirs).filter(|(a, b)| (**a >= 0.0) == (**b >= 0.0)).count();
        assert_eq!(same_sign, ours.len());
        match reference.name {
            "dense" => assert_eq!(agree, ours.len()),
            _ => assert!(agree > ours.len() / 4, "{agree} of {}: the rest is interpolated there", ours.len()),
        }
    }
}

#[test]
fn without_refinement_vertices_are_those_of_the_reference_code() {
    let (decoder, references) = (decoder(), Reference::both());
    for reference in references {
        let extraction = reference.extract(&decoder, 0);
        assert_watertight(&extraction.mesh);
        assert_eq!(extraction.warnings, []);
        let theirs = points(&reference.array("vertices"));
        assert_eq!(extraction.mesh.vertices.len(), theirs.len());
        assert_eq!(
            euler_characteristic(&extraction.mesh),
            theirs.len() as i64 - reference.array::<i64>("faces").len() as i64 / 6
        );
        let worst = largest(pair(&extraction.mesh, &theirs).into_iter().map(|(_, distance)| distance));
        println!("{}: the vertices are within {worst:.1e} of the reference code's", reference.name);
        // Ours keep a thousandth of a cell away from the nodes.
        assert!(worst < 1.1e-3 * 1.1 / reference.cells as f64);
        let (true_volume, true_area) = (reference.array::<f64>("volume")[0], reference.array::<f64>("area")[0]);
        // Four crossings out of a plane have two triangulations, and the reference code may take the other.
        assert!((volume(&extraction.mesh) / true_volume - 1.0).abs() < 5e-3);
        assert!((area(&extraction.mesh) / true_area - 1.0).abs() < 5e-3);
    }
}

#[test]
fn colors_are_those_of_the_reference_code() {
    let (decoder, references) = (decoder(), Reference::both());
    for reference in references {
        let mesh = reference.extract(&decoder, 0).mesh;
        let theirs: Vec<u8> = reference.array("colors_rgba");
        let colors = mesh.colors.as_ref().unwrap();
        for (ours, (theirs_at, _)) in pair(&mesh, &points(&reference.array("vertices"))).into_iter().enumerate() {
            for channel in 0..3 {
                let ours = 255.0 * colors[ours][channel];
                let theirs = f32::from(theirs[4 * theirs_at + channel]);
                // The reference code cuts off the fraction.
                assert!((ours - 0.5 - theirs).abs() < 0.6, "{ours} {theirs}");
            }
        }
    }
}

#[test]
fn refinement_puts_the_vertices_on_the_level_set() {
    let (decoder, [mise, _]) = (decoder(), Reference::both());
    let logits = |steps| {
        let mesh = mise.extract(&decoder, steps).mesh;
        let logits = decoder.logits(&mesh.vertices);
        logits.iter().map(|logit| logit.abs()).sum::<f32>() / logits.len() as f32
    };
    let [none, two, four] = [0, 2, 4].map(logits);
    println!("mean |logit| at the vertices: {none:.1e} unrefined, {two:.1e} after 2 steps, {four:.1e} after 4");
    assert!((none - 0.012).abs() < 0.002, "the reference code's figure");
    assert!(two < 0.1 * none && four < 0.02 * none);
}

#[test]
fn refining_finds_the_whole_fitted_shape() {
    let decoder = decoder();
    let settings = |upsampling_steps| ExtractSettings {
        resolution: 36,
        upsampling_steps,
        normals: NormalSource::Faces,
        ..Default::default()
    };
    let dense = extract_mesh(&decoder, &settings(0), &[]).unwrap();
    let refined = extract_mesh(&decoder, &settings(2), &[]).unwrap();
    assert_eq!(refined.mesh, dense.mesh);
    println!("{:?} against {:?}", refined.evaluations, dense.evaluations);
}

/// For each of our vertices, the nearest of theirs and its distance; asserts that none of theirs is used twice.
fn pair(ours: &Mesh, theirs: &[DVec3]) -> Vec<(usize, f64)> {
    let mut used = vec![false; theirs.len()];
    let nearest = |vertex: &Vec3| {
        let distances = theirs.iter().map(|other| other.distance_squared(vertex.as_dvec3())).enumerate();
        let (index, squared) = distances.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!(!std::mem::replace(&mut used[index], true), "two of our vertices at one of theirs");
        (index, squared.sqrt())
    };
    ours.vertices.iter().map(nearest).collect()
}
