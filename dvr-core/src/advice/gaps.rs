//! Sides of the object that no picture looks at: gaps in the orbit.
//!
//! Somebody who walks around an object leaves gaps along the walk: pictures beside each other in azimuth, at about one
//! height, that are too far apart. Heights, too, can be too far apart. Cameras that stand here and there have no order;
//! of them is asked how far the nearest one is from any side between the lowest and the highest.

use glam::DVec3;

use super::directions::even_directions;
use super::finding::{Advice, Topic, ViewFigure, listed};
use super::orbit::{Orbit, Side};
use crate::scene::Scene;

/// Degrees between neighbours along a turn, and between heights, from which there is a gap.
const GAP: f64 = 25.0;

/// Degrees of azimuth without a picture from which an object counts as seen from one side alone.
const ONE_SIDED: f64 = 180.0;

/// Above so many degrees of elevation a picture shows all sides, or none.
const STEEP: f64 = 70.0;

/// Heights that differ by more than so many degrees are those of different turns.
const TURN_STEP: f64 = 8.0;

/// A turn has so many pictures or more, and of this share of them the nearest picture is beside them along it; gaps leave
/// so many degrees of it or more.
const TURN_VIEWS: usize = 6;
const TURN_SHARE: f64 = 0.75;
const TURN_DEGREES: f64 = 180.0;

/// Degrees to the nearest picture from which a side is a hole between cameras that stand here and there: surface that
/// faces it shows at half its size, or less. 24 cameras that are thrown over a sphere leave up to 50.
const HOLE: f64 = 60.0;

/// Sides that are asked for holes, over the whole sphere: three degrees apart. And holes that are told.
const HOLE_SAMPLES: usize = 4000;
const MOST_HOLES: usize = 3;

/// Degrees that new pictures should be apart.
const STEP: f64 = 20.0;

/// Fewer views have no order: how much they share tells.
const FEWEST: usize = 3;

/// Gaps in azimuth, as a whole and along turns, gaps in elevation, and holes.
pub(super) fn advice(scene: &Scene, orbit: &Orbit) -> Vec<Advice> {
    if orbit.sides.len() < FEWEST {
        return Vec::new();
    }
    let names: Vec<&str> = scene.views.iter().map(|view| view.name.as_str()).collect();
    let arc = unseen_arc(orbit);
    let mut found: Vec<Advice> = arc.iter().map(|arc| one_sided(arc, &names)).collect();
    let turns = turns(orbit);
    for turn in &turns {
        let arcs = arcs(orbit, turn).into_iter();
        let gaps: Vec<Arc> = arcs.filter(|gap| is_told(gap, turn, arc.as_ref(), orbit)).collect();
        if 2 * gaps.len() > turn.len() {
            found.push(sparse_turn(turn, &gaps, orbit, &names));
        } else if !gaps.is_empty() && gaps.iter().map(|gap| gap.degrees).sum::<f64>() < 360.0 - TURN_DEGREES {
            found.push(gaps_in_turn(turn, &gaps, orbit, &names));
        }
    }
    found.extend(gaps_of_heights(orbit).into_iter().map(|pair| gap_of_heights(pair, orbit, &names)));
    if found.is_empty() {
        found.extend(holes(orbit).into_iter().map(|hole| advice_on_hole(hole, orbit, &names)));
    }
    found
}

/// Azimuths from one view to the next, counter-clockwise seen from above.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Arc {
    from: usize,
    to: usize,
    degrees: f64,
}

/// The arcs between views that follow each other in azimuth.
fn arcs(orbit: &Orbit, views: &[usize]) -> Vec<Arc> {
    let by_azimuth = in_order(orbit, views, |side| side.azimuth);
    let next = by_azimuth.iter().cycle().skip(1);
    let pairs = by_azimuth.iter().zip(next);
    pairs
        .map(|(&from, &to)| {
            let degrees = (orbit.sides[to].azimuth - orbit.sides[from].azimuth).rem_euclid(360.0);
            Arc { from, to, degrees: if from == to { 360.0 } else { degrees } }
        })
        .collect()
}

/// Views in the order of a part of their sides.
fn in_order(orbit: &Orbit, views: &[usize], part: fn(&Side) -> f64) -> Vec<usize> {
    let mut views = views.to_vec();
    views.sort_by(|&a, &b| part(&orbit.sides[a]).total_cmp(&part(&orbit.sides[b])));
    views
}

/// The arc without a picture, where it is so large that the object is seen from one side.
fn unseen_arc(orbit: &Orbit) -> Option<Arc> {
    let flat: Vec<usize> = (0..orbit.sides.len()).filter(|&view| orbit.sides[view].elevation.abs() < STEEP).collect();
    let largest = arcs(orbit, &flat).into_iter().max_by(|a, b| a.degrees.total_cmp(&b.degrees));
    largest.filter(|arc| arc.degrees > ONE_SIDED)
}

/// The turns around the object: views at about one height, in each of which the next picture is the next in azimuth.
fn turns(orbit: &Orbit) -> Vec<Vec<usize>> {
    let all: Vec<usize> = (0..orbit.sides.len()).collect();
    let by_height = in_order(orbit, &all, |side| side.elevation);
    let height = |view: usize| orbit.sides[view].elevation;
    let levels = by_height.chunk_by(|&a, &b| height(b) - height(a) <= TURN_STEP);
    levels.filter(|level| level.len() >= TURN_VIEWS && is_turn(orbit, level)).map(<[usize]>::to_vec).collect()
}

fn is_turn(orbit: &Orbit, level: &[usize]) -> bool {
    let directions: Vec<DVec3> = orbit.sides.iter().map(|side| orbit.direction(*side)).collect();
    let by_azimuth = in_order(orbit, level, |side| side.azimuth);
    let count = by_azimuth.len();
    let follows = |place: usize| {
        let view = by_azimuth[place];
        let others = (0..directions.len()).filter(|&other| other != view);
        let nearness = |other: usize| directions[view].dot(directions[other]);
        let nearest = others.max_by(|&a, &b| nearness(a).total_cmp(&nearness(b)));
        let beside = [1, count - 1].map(|step| by_azimuth[(place + step) % count]);
        nearest.is_some_and(|nearest| beside.contains(&nearest))
    };
    (0..count).filter(|&place| follows(place)).count() as f64 >= TURN_SHARE * count as f64
}

/// Whether an arc of a turn is a gap that is not told as the unseen side. High above the object, a degree of azimuth is
/// less of a way.
fn is_told(gap: &Arc, turn: &[usize], unseen: Option<&Arc>, orbit: &Orbit) -> bool {
    let is_unseen = unseen.is_some_and(|unseen| {
        let start = (orbit.sides[unseen.from].azimuth - orbit.sides[gap.from].azimuth).rem_euclid(360.0);
        start + unseen.degrees <= gap.degrees + 1e-9
    });
    gap.degrees * mean_elevation(turn, orbit).to_radians().cos() > GAP && !is_unseen
}

/// Pairs of heights, one after the other, that are too far apart.
fn gaps_of_heights(orbit: &Orbit) -> Vec<[usize; 2]> {
    let all: Vec<usize> = (0..orbit.sides.len()).collect();
    let by_height = in_order(orbit, &all, |side| side.elevation);
    let height = |view: usize| orbit.sides[view].elevation;
    by_height.windows(2).filter(|pair| height(pair[1]) - height(pair[0]) > GAP).map(|pair| [pair[0], pair[1]]).collect()
}

/// A side without a picture nearby.
struct Hole {
    side: Side,
    /// The nearest view, and how far it is, in degrees.
    nearest: usize,
    degrees: f64,
}

/// Sides between the lowest and the highest camera that are farther than [`HOLE`] from the nearest, the farthest first;
/// the next would stay one if somebody photographed that.
fn holes(orbit: &Orbit) -> Vec<Hole> {
    let heights = orbit.sides.iter().map(|side| side.elevation);
    let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), height| (a.min(height), b.max(height)));
    let is_between = |direction: &DVec3| (low..=high).contains(&orbit.side(*direction).elevation);
    let asked: Vec<DVec3> = even_directions(HOLE_SAMPLES).filter(is_between).collect();
    let mut cameras: Vec<DVec3> = orbit.sides.iter().map(|side| orbit.direction(*side)).collect();
    let mut found = Vec::new();
    while found.len() < MOST_HOLES {
        let nearest = |direction: &DVec3| {
            let near = cameras.iter().enumerate().map(|(view, camera)| (view, camera.dot(*direction)));
            near.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 1.0))
        };
        let farthest = asked.iter().map(|direction| (*direction, nearest(direction)));
        let Some((direction, (view, cosine))) = farthest.min_by(|a, b| a.1.1.total_cmp(&b.1.1)) else { break };
        let degrees = cosine.clamp(-1.0, 1.0).acos().to_degrees();
        if degrees <= HOLE {
            break;
        }
        found.push(Hole { side: orbit.side(direction), nearest: view, degrees });
        cameras.push(direction);
    }
    found.retain(|hole| hole.nearest < orbit.sides.len());
    found
}

/// Advice on a gap beside these views, each with its degrees.
fn gap(views: impl IntoIterator<Item = (usize, f64)>, threshold: f64, names: &[&str], text: String) -> Advice {
    let beside = views.into_iter().map(|(view, figure)| ViewFigure { view: names[view].to_owned(), figure });
    Advice { topic: Topic::Gap, views: beside.collect(), threshold, text }
}

fn one_sided(arc: &Arc, names: &[&str]) -> Advice {
    let text = format!(
        "no picture over {:.0} degrees of azimuth, from `{}` counter-clockwise to `{}`: the object is seen from one side, and \
         what faces the other is a guess; photograph that side too, every {STEP} degrees, if it matters",
        arc.degrees, names[arc.from], names[arc.to]
    );
    gap([(arc.from, arc.degrees), (arc.to, arc.degrees)], GAP, names, text)
}

fn gaps_in_turn(turn: &[usize], gaps: &[Arc], orbit: &Orbit, names: &[&str]) -> Advice {
    let mut gaps = gaps.to_vec();
    gaps.sort_by(|a, b| b.degrees.total_cmp(&a.degrees));
    let each = |arc: &Arc| format!("`{}` and `{}` ({:.0} degrees)", names[arc.from], names[arc.to], arc.degrees);
    let missing: Vec<f64> = gaps.iter().flat_map(|arc| missing_azimuths(arc, orbit)).collect();
    let text = format!(
        "gaps of azimuth, told from {GAP} degrees on, are between {}: photograph from azimuth {}, at about {:.0} degrees of \
         elevation",
        listed(gaps.iter().map(each)),
        listed(missing.iter().map(|azimuth| format!("{azimuth:.0}"))),
        mean_elevation(turn, orbit)
    );
    let beside = gaps.iter().flat_map(|arc| [(arc.from, arc.degrees), (arc.to, arc.degrees)]);
    gap(beside, GAP, names, text)
}

/// Azimuths that would fill a gap, evenly.
fn missing_azimuths(arc: &Arc, orbit: &Orbit) -> impl Iterator<Item = f64> {
    let (from, degrees) = (orbit.sides[arc.from].azimuth, arc.degrees);
    let steps = (degrees / STEP).ceil().max(2.0);
    (1..steps as usize).map(move |step| (from + degrees * step as f64 / steps).rem_euclid(360.0).floor())
}

/// In whole degrees.
fn mean_elevation(views: &[usize], orbit: &Orbit) -> f64 {
    (views.iter().map(|&view| orbit.sides[view].elevation).sum::<f64>() / views.len() as f64).round() + 0.0
}

fn sparse_turn(turn: &[usize], gaps: &[Arc], orbit: &Orbit, names: &[&str]) -> Advice {
    let widest = gaps.iter().map(|gap| gap.degrees).fold(0.0, f64::max);
    let text = format!(
        "{} of {} pictures at about {:.0} degrees of elevation are up to {widest:.0} degrees of azimuth from the next (a \
         gap from {GAP} degrees on): take one every {STEP} degrees",
        gaps.len(),
        turn.len(),
        mean_elevation(turn, orbit)
    );
    gap(gaps.iter().map(|gap| (gap.from, gap.degrees)), GAP, names, text)
}

fn gap_of_heights([low, high]: [usize; 2], orbit: &Orbit, names: &[&str]) -> Advice {
    let [below, above] = [low, high].map(|view| orbit.sides[view].elevation);
    let text = format!(
        "no picture between {below:.0} degrees of elevation (`{}`) and {above:.0} (`{}`), {:.0} degrees apart (a gap from \
         {GAP} degrees on): photograph a turn at about {:.0} degrees",
        names[low],
        names[high],
        above - below,
        0.5 * (below + above)
    );
    gap([(low, above - below), (high, above - below)], GAP, names, text)
}

fn advice_on_hole(hole: Hole, orbit: &Orbit, names: &[&str]) -> Advice {
    let text = format!(
        "no picture within {:.0} degrees of {}, the nearest is `{}` from {} (a hole from {HOLE} degrees on): photograph from \
         there too",
        hole.degrees.floor(),
        hole.side,
        names[hole.nearest],
        orbit.sides[hole.nearest]
    );
    gap([(hole.nearest, hole.degrees)], HOLE, names, text)
}

#[cfg(test)]
mod tests {
    use super::super::tests::scene_from;
    use super::*;

    fn told(sides: &[(f64, f64)]) -> Vec<Advice> {
        let scene = scene_from(sides);
        advice(&scene, &Orbit::of(&scene))
    }

    fn turn(count: usize, elevation: f64) -> Vec<(f64, f64)> {
        (0..count).map(|i| (i as f64 * 360.0 / count as f64, elevation + (2.3 * i as f64).sin())).collect()
    }

    #[test]
    fn turns_that_are_close_have_no_gaps() {
        for sides in [turn(16, 20.0), [turn(18, 5.0), turn(16, 28.0), turn(10, 50.0)].concat(), turn(10, 60.0)] {
            assert_eq!(told(&sides), []);
        }
    }

    #[test]
    fn pictures_that_are_missing_on_a_turn_leave_a_gap_that_is_told_with_its_place() {
        let mut sides = [turn(24, 10.0), turn(20, 34.0)].concat();
        sides.drain(8..11);
        let found = told(&sides);
        let [gap] = &found[..] else { panic!("{found:?}") };
        assert_eq!((gap.topic, gap.threshold), (Topic::Gap, 25.0));
        assert!((gap.views[0].figure - 60.0).abs() < 1.0 && gap.views[0].figure == gap.views[1].figure, "{gap:?}");
        assert_eq!([&gap.views[0].view, &gap.views[1].view], ["7", "8"]);
        for part in ["between `7` and `8` (60 degrees)", "from azimuth 125, 145, at about 10 degrees"] {
            assert!(gap.text.contains(part), "{part}: {gap}");
        }
    }

    #[test]
    fn a_turn_of_few_pictures_is_told_once() {
        let found = told(&turn(10, 10.0));
        let [gap] = &found[..] else { panic!("{found:?}") };
        assert!(gap.views.len() == 10 && gap.text.contains("36 degrees"), "{gap}");
    }

    #[test]
    fn heights_that_are_far_apart_are_told() {
        let found = told(&[turn(20, 5.0), turn(16, 45.0)].concat());
        let [gap] = &found[..] else { panic!("{found:?}") };
        assert!(gap.text.contains("a turn at about 25 degrees"), "{gap}");
    }

    #[test]
    fn one_side_is_told_once() {
        let rows = (0..4).flat_map(|row| (0..10).map(move |i| (12.0 * f64::from(i), 15.0 * f64::from(row))));
        let found = told(&rows.collect::<Vec<_>>());
        let [gap] = &found[..] else { panic!("{found:?}") };
        assert!(gap.text.contains("one side") && gap.text.contains("252 degrees"), "{gap}");
    }

    #[test]
    fn cameras_here_and_there_have_a_hole_where_none_is_near() {
        let scattered: Vec<(f64, f64)> = even_directions(36)
            .map(|d| (d.z.atan2(d.x).to_degrees().rem_euclid(360.0), d.y.asin().to_degrees()))
            .collect();
        assert_eq!(told(&scattered), []);
        let is_far = |&&(azimuth, elevation): &&(f64, f64)| {
            let (a, e) = (azimuth.to_radians(), elevation.to_radians());
            e.cos() * (a - 1.0).cos() < 62f64.to_radians().cos()
        };
        let found = told(&scattered.iter().filter(is_far).copied().collect::<Vec<_>>());
        let [hole] = &found[..] else { panic!("{found:?}") };
        assert!(hole.threshold == 60.0 && hole.views[0].figure > 60.0, "{hole:?}");
    }
}
