//! The catalogue of all axes.

use dvr_core::mesh::{Mesh, shapes};
use dvr_core::synth::CameraPlacement;

use crate::axis::{Axis, Case, Group, Kind, usual_footprint};
use crate::faults::Faults;
use crate::gradients::GradientTest;
use crate::paint::{Paint, painted};
use crate::photographs::photograph_axes;
use crate::shapes::{
    bowl, far_apart, into_step, pebble, perforated, plate, ring, step, tiny_beside_large, tunnel, wedge,
};

/// Every axis, in the order of the tables.
pub fn axes() -> Vec<Axis> {
    [
        shape_axes(),
        texture_axes(),
        view_axes(),
        mask_axes(),
        camera_axes(),
        picture_axes(),
        photograph_axes(),
        gradient_axes(),
    ]
    .concat()
}

/// A mesh with a clear texture.
fn clear(mesh: Mesh) -> Case {
    Case::of(painted(mesh, Paint::CLEAR))
}

/// The same, whose reconstruction must have the given number of handles: it must neither break nor get holes.
fn whole(handles: i64, mesh: Mesh) -> Case {
    Case { handles: Some(handles), ..clear(mesh) }
}

/// The pebble with faults.
fn faulty(faults: Faults) -> Case {
    Case { faults, ..clear(pebble()) }
}

/// Two parts, of which the second must be reconstructed.
fn parts([rest, part]: [Mesh; 2]) -> Case {
    let mut case = clear(shapes::union([rest, part.clone()]));
    case.part = Some(part);
    case
}

fn shape_axes() -> Vec<Axis> {
    let shape = |words, difficulties, quick, case| Axis::of_scenes(Group::Shape, words, difficulties, quick, case);
    vec![
        shape(
            ["rod-radius", "pixels", "a round rod, bent to a ring"],
            &[4.0, 2.0, 1.0, 0.5, 0.25, 0.1],
            &[1.0, 0.5, 0.25, 0.1],
            |pixels| whole(1, ring(pixels * usual_footprint())),
        ),
        shape(
            ["plate-thickness", "pixels", "a flat plate"],
            &[4.0, 2.0, 1.0, 0.5, 0.25, 0.1],
            &[1.0, 0.25, 0.1],
            |pixels| whole(0, plate(pixels * usual_footprint())),
        ),
        shape(
            ["wedge-angle", "degrees", "a blade with a sharp edge"],
            &[90.0, 45.0, 20.0, 10.0, 5.0, 2.0],
            &[20.0, 5.0],
            |degrees| clear(wedge(degrees)),
        ),
        shape(
            ["bowl-depth", "depths per width", "a bowl with upright walls"],
            &[0.25, 0.5, 0.75, 1.0, 1.5, 2.0],
            &[0.25, 0.5, 1.0],
            |depth| clear(bowl(depth)),
        ),
        shape(
            ["tunnel-length", "lengths per width", "a thick pipe"],
            &[0.5, 1.0, 2.0, 4.0, 8.0],
            &[1.0, 4.0],
            |length| whole(1, tunnel(length)),
        ),
        shape(
            ["genus", "holes", "a thick plate with square holes"],
            &[1.0, 2.0, 4.0, 9.0, 12.0, 20.0],
            &[4.0, 20.0],
            |holes| whole(holes as i64, perforated(holes as usize)),
        ),
        shape(["far-apart", "radii", "two balls with a gap"], &[1.0, 3.0, 6.0, 12.0, 24.0], &[3.0, 24.0], |gap| {
            parts(far_apart(gap))
        }),
        shape(
            ["tiny-part", "pixels", "a ball of this radius beside a large one"],
            &[4.0, 2.0, 1.0, 0.5, 0.25],
            &[1.0, 0.5, 0.25],
            |pixels| parts(tiny_beside_large(pixels * usual_footprint())),
        ),
    ]
}

fn texture_axes() -> Vec<Axis> {
    let texture = |words, difficulties, quick, case| Axis::of_scenes(Group::Texture, words, difficulties, quick, case);
    vec![
        texture(
            ["texture-contrast", "share", "a bowl half as deep as wide, its noise texture fading to grey"],
            &[1.0, 0.5, 0.2, 0.1, 0.05, 0.0],
            &[1.0, 0.2, 0.0],
            |contrast| Case::of(painted(bowl(0.5), Paint::Noise(contrast as f32))),
        ),
        texture(
            ["texture-repeats", "pixels", "the same bowl with one repeated wave of this period"],
            &[16.0, 8.0, 4.0, 2.0],
            &[16.0, 4.0],
            |period| Case::of(painted(bowl(0.5), Paint::Waves(period))),
        ),
        texture(
            ["texture-lies", "pixels", "squares of this size that run across the edge of a step without a break"],
            &[16.0, 8.0, 4.0, 2.0],
            &[16.0, 4.0],
            |square| Case::of(painted(step(), Paint::Squares(square, into_step()))),
        ),
    ]
}

fn view_axes() -> Vec<Axis> {
    let views = |words, difficulties, quick, case| Axis::of_scenes(Group::Views, words, difficulties, quick, case);
    vec![
        views(
            ["views", "views", "a pebble, seen from all sides by this many views"],
            &[24.0, 16.0, 12.0, 8.0, 6.0, 4.0, 3.0],
            &[12.0, 6.0, 3.0],
            |count| {
                let mut case = clear(pebble());
                case.config.views = count as usize;
                case
            },
        ),
        views(
            ["one-sided", "degrees", "24 views within this angle of one direction; judged is what two of them see"],
            &[180.0, 120.0, 90.0, 60.0, 40.0, 20.0],
            &[90.0, 40.0],
            |half_angle| {
                let mut case = clear(pebble());
                case.config.placement = CameraPlacement::Cap { half_angle };
                case
            },
        ),
    ]
}

fn mask_axes() -> Vec<Axis> {
    let masks = |words, difficulties, quick, case| Axis::of_scenes(Group::Masks, words, difficulties, quick, case);
    vec![
        masks(
            ["mask-grown", "pixels", "all masks too large"],
            &[0.0, 1.0, 2.0, 3.0, 4.0],
            &[1.0, 2.0, 4.0],
            |pixels| faulty(Faults { grown_masks: pixels, ..Faults::default() }),
        ),
        masks(
            ["mask-shrunk", "pixels", "all masks too small"],
            &[0.0, 1.0, 2.0, 3.0, 4.0],
            &[1.0, 2.0, 4.0],
            |pixels| faulty(Faults { grown_masks: -pixels, ..Faults::default() }),
        ),
        masks(
            ["mask-holes", "share of the object", "round holes of five pixels in all masks"],
            &[0.02, 0.05, 0.1, 0.2, 0.4],
            &[0.05, 0.1, 0.2],
            |share| faulty(Faults { holes: share, ..Faults::default() }),
        ),
        masks(
            ["mask-speckle", "share of the pixels", "single pixels of all masks flipped"],
            &[0.001, 0.003, 0.01, 0.03, 0.1],
            &[0.003, 0.01, 0.03],
            |share| faulty(Faults { speckle: share, ..Faults::default() }),
        ),
        masks(
            ["wrong-masks", "masks of 24", "masks of another object"],
            &[1.0, 2.0, 3.0, 5.0, 8.0],
            &[1.0, 2.0, 5.0],
            |count| faulty(Faults { wrong_masks: count as usize, ..Faults::default() }),
        ),
    ]
}

fn camera_axes() -> Vec<Axis> {
    let cameras = |words, difficulties, quick, case| Axis::of_scenes(Group::Cameras, words, difficulties, quick, case);
    vec![
        cameras(
            ["camera-rotation", "degrees", "every camera rotated about a random axis"],
            &[0.1, 0.25, 0.5, 1.0, 2.0, 4.0],
            &[0.5, 1.0, 2.0],
            |rotation| faulty(Faults { rotation, ..Faults::default() }),
        ),
        cameras(
            ["camera-translation", "share of the distance", "every camera moved in a random direction"],
            &[0.0025, 0.005, 0.01, 0.02, 0.05],
            &[0.01, 0.05],
            |translation| faulty(Faults { translation, ..Faults::default() }),
        ),
        cameras(
            ["camera-focal", "share", "focal lengths too long in half of the views, too short in the others"],
            &[0.0025, 0.005, 0.01, 0.02, 0.05],
            &[0.02, 0.05],
            |focal| faulty(Faults { focal, ..Faults::default() }),
        ),
    ]
}

fn picture_axes() -> Vec<Axis> {
    let pictures =
        |words, difficulties, quick, case| Axis::of_scenes(Group::Pictures, words, difficulties, quick, case);
    vec![
        pictures(
            ["noise", "standard deviation", "noise on all channels, whose range is 0 to 1"],
            &[0.01, 0.03, 0.1, 0.2, 0.4],
            &[0.1, 0.2],
            |deviation| {
                let mut case = clear(pebble());
                case.config.noise = deviation as f32;
                case
            },
        ),
        pictures(
            ["exposure", "stops", "standard deviation of the exposure from view to view"],
            &[0.1, 0.25, 0.5, 1.0, 2.0],
            &[0.25, 1.0],
            |stops| {
                let mut case = clear(pebble());
                case.config.exposure_jitter = stops as f32;
                case
            },
        ),
        pictures(
            ["cut", "frames", "the object this far from the centre of every picture; from a quarter on it is cut off"],
            &[0.2, 0.3, 0.4, 0.5, 0.6],
            &[0.3, 0.5],
            |aside| faulty(Faults { aside, ..Faults::default() }),
        ),
    ]
}

fn gradient_axes() -> Vec<Axis> {
    let gradient = |[name, unit, what]: [&'static str; 3], difficulties: &'static [f64], test| Axis {
        name,
        group: Group::Gradients,
        unit,
        what,
        difficulties,
        quick: difficulties,
        kind: Kind::Gradient(test),
    };
    vec![
        gradient(
            ["gradient-grazing", "degrees", "relative error of the depth's gradient at this angle to the surface"],
            &[45.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.1, 0.05, 0.02],
            GradientTest::Grazing,
        ),
        gradient(
            ["gradient-scale", "factor", "the same at 30 degrees, for a field times this"],
            &[1.0, 0.1, 0.01, 0.003, 0.001, 0.0001],
            GradientTest::Scale,
        ),
        gradient(
            ["gradient-spread", "rays", "relative standard deviation of the mean gradient over a batch"],
            &[4096.0, 2048.0, 1024.0, 512.0, 256.0, 128.0, 64.0],
            GradientTest::Spread,
        ),
    ]
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn names_are_unique_and_quick_difficulties_are_among_all() {
        let axes = axes();
        let names: HashSet<&str> = axes.iter().map(|axis| axis.name).collect();
        assert_eq!(names.len(), axes.len());
        for axis in &axes {
            let mut rest = axis.difficulties.iter();
            assert!(axis.quick.iter().all(|quick| rest.any(|d| d == quick)), "{}: in the same order", axis.name);
        }
    }

    #[test]
    fn every_object_lies_in_the_cube_and_in_the_frame() {
        for axis in axes() {
            for case in axis.difficulties.iter().filter_map(|&difficulty| axis.case(difficulty)) {
                let reach = case.object.mesh.vertices.iter().map(|v| v.length()).fold(0.0, f32::max);
                assert!(reach < 0.55, "{}: {reach}", axis.name);
                let inside = case.object.mesh.vertices.iter().all(|v| v.abs().max_element() <= 0.5);
                assert!(inside, "{}", axis.name);
                assert!(case.config.check().is_ok());
            }
        }
    }
}
