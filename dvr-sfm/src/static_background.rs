//! What stands still behind a turntable: a camera on a tripod sees the room at the same place of all pictures, while the object
//! turns. Structure from motion would place the cameras by the room.
//!
//! Pictures that were cut out around the object show the room moved, each by an offset of its own.

use glam::DVec2;
use rayon::prelude::*;

use crate::database::{Features, Matches, Pair};

/// Fewer pictures do not tell a turntable from steps to the side.
const LEAST_PICTURES: usize = 6;

/// Two pictures show the same room where so many matches are moved alike, up to this share of a picture's longer side, ...
const LEAST_MATCHES: usize = 12;
const ALIKE: f64 = 0.01;

/// ... where those are spread by this share of it, which the part of an object that faces both cameras is not, ...
const SPREAD: f64 = 0.15;

/// ... and are moved by no more than this.
const FARTHEST: f64 = 0.25;

/// Pictures are apart where this share of all lies between them; a clip's neighbours are alike, whatever moves.
const APART: f64 = 0.125;

/// The share of the pairs of pictures which are apart that must show the same room. None does where a camera is carried
/// around an object.
const LEAST_PAIRS: f64 = 0.5;

/// Rounds in which offsets are made to agree, at most.
const ROUNDS: usize = 100;

/// Where each picture shows what stands still.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StaticBackground {
    /// Pixels, against the others.
    offsets: Vec<DVec2>,
    /// The longer side of all pictures, pixels.
    side: f64,
}

impl StaticBackground {
    /// By the matches of pictures that are alike in size, in the order they were taken. `None` where nothing stands still.
    pub fn of(matches: &Matches, side: f64) -> Option<Self> {
        let count = matches.pictures.len();
        if count < LEAST_PICTURES {
            return None;
        }
        let moved: Vec<Moved> =
            matches.pairs.par_iter().filter_map(|pair| moved_alike(&matches.pictures, pair, side)).collect();
        let background = Self { offsets: agreed_offsets(count, &moved), side };
        let is_apart = |[a, b]: [usize; 2]| a.abs_diff(b) as f64 >= APART * count as f64;
        let compared = matches.pairs.iter().filter(|pair| is_apart(pair.pictures)).count();
        let agrees = |moved: &&Moved| is_apart(moved.pictures) && background.is_along(moved.pictures, moved.by);
        let agreeing = moved.iter().filter(agrees).count();
        (agreeing > 0 && agreeing as f64 >= LEAST_PAIRS * compared as f64).then_some(background)
    }

    /// The matches that do not go along with the background.
    pub fn without(&self, matches: &Matches) -> Matches {
        let moving = |pair: &Pair| {
            let by = |feature: &[usize; 2]| movement(&matches.pictures, pair, feature);
            let moving = pair.matches.iter().filter(|feature| !self.is_along(pair.pictures, by(feature)));
            Pair { pictures: pair.pictures, matches: moving.copied().collect() }
        };
        Matches { pictures: matches.pictures.clone(), pairs: matches.pairs.iter().map(moving).collect() }
    }

    /// Whether what is moved by this from one picture to the other stands still.
    fn is_along(&self, [a, b]: [usize; 2], by: DVec2) -> bool {
        by.distance(self.offsets[b] - self.offsets[a]) < 2.0 * ALIKE * self.side
    }
}

/// How far many features are moved alike from one picture to another.
struct Moved {
    pictures: [usize; 2],
    /// Pixels.
    by: DVec2,
}

/// Where the second picture of a pair shows a feature, against the first.
fn movement(pictures: &[Features], pair: &Pair, &[a, b]: &[usize; 2]) -> DVec2 {
    pictures[pair.pictures[1]].places[b] - pictures[pair.pictures[0]].places[a]
}

/// The movement that most matches of a pair have in common, where it may be that of a room.
fn moved_alike(pictures: &[Features], pair: &Pair, side: f64) -> Option<Moved> {
    let movements: &[DVec2] = &pair.matches.iter().map(|feature| movement(pictures, pair, feature)).collect::<Vec<_>>();
    let about = |center: DVec2| {
        let is_about = move |i: &usize| movements[*i].distance(center) < ALIKE * side;
        (0..movements.len()).filter(is_about)
    };
    let center = movements.iter().copied().max_by_key(|&center| about(center).count())?;
    let most: Vec<usize> = about(center).collect();
    let mean = |of: &mut dyn Iterator<Item = DVec2>| of.sum::<DVec2>() / most.len() as f64;
    let by = mean(&mut most.iter().map(|&i| movements[i]));
    let places: Vec<DVec2> = most.iter().map(|&i| pictures[pair.pictures[0]].places[pair.matches[i][0]]).collect();
    let middle = mean(&mut places.iter().copied());
    let variance = places.iter().map(|place| place.distance_squared(middle)).sum::<f64>() / most.len() as f64;
    let is_room = most.len() >= LEAST_MATCHES && variance.sqrt() > SPREAD * side && by.length() < FARTHEST * side;
    is_room.then_some(Moved { pictures: pair.pictures, by })
}

/// An offset for each picture, so that most differences are those that were seen.
fn agreed_offsets(count: usize, moved: &[Moved]) -> Vec<DVec2> {
    let mut seen: Vec<Vec<(usize, DVec2)>> = vec![Vec::new(); count];
    for Moved { pictures: [a, b], by } in moved {
        seen[*b].push((*a, *by));
        seen[*a].push((*b, -*by));
    }
    let mut offsets = vec![DVec2::ZERO; count];
    for _ in 0..ROUNDS {
        let mut change = 0f64;
        for picture in 0..count {
            let along = |axis: usize| {
                let mut all: Vec<f64> = seen[picture].iter().map(|(other, by)| (offsets[*other] + *by)[axis]).collect();
                let at = all.len() / 2;
                (!all.is_empty()).then(|| *all.select_nth_unstable_by(at, f64::total_cmp).1)
            };
            if let (Some(x), Some(y)) = (along(0), along(1)) {
                change = change.max(offsets[picture].distance(DVec2::new(x, y)));
                offsets[picture] = DVec2::new(x, y);
            }
        }
        if change < 0.01 {
            break;
        }
    }
    offsets
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: f64 = 1000.0;

    /// A number from 0 to 1 for each pair of numbers.
    fn random(a: usize, b: usize) -> f64 {
        let mixed =
            (a as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (b as u64 + 1).wrapping_mul(0xff51_afd7_ed55_8ccd);
        ((mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn point(i: usize) -> DVec2 {
        SIDE * DVec2::new(random(i, 1), random(i, 2))
    }

    /// Where a picture was cut out.
    fn cut(picture: usize) -> DVec2 {
        0.1 * SIDE * DVec2::new(random(picture, 7) - 0.5, random(picture, 8) - 0.5)
    }

    const ROOM: usize = 40;
    const OBJECT: usize = 60;

    /// Pictures of an object that turns, each point seen for a quarter of a turn, before `room` points that do not.
    fn turntable(count: usize, room: usize) -> Matches {
        let turn = |picture: usize| std::f64::consts::TAU * picture as f64 / count as f64;
        let angle = |i: usize, picture: usize| std::f64::consts::TAU * random(i, 3) + turn(picture);
        let of_object =
            |i: usize, picture: usize| DVec2::new(0.5 + 0.3 * angle(i, picture).sin(), 0.2 + 0.6 * random(i, 4)) * SIDE;
        let picture = |picture: usize| Features {
            name: format!("{picture}.jpg"),
            places: (0..room)
                .map(|i| point(i) - cut(picture))
                .chain((0..OBJECT).map(|i| of_object(i, picture)))
                .collect(),
        };
        let mut pairs = Vec::new();
        for b in 1..count {
            for a in 0..b {
                let both_see = |i: &usize| [a, b].iter().all(|&picture| angle(*i, picture).cos() > 0.7);
                let all = (0..room).chain((0..OBJECT).filter(both_see).map(|i| room + i));
                pairs.push(Pair { pictures: [a, b], matches: all.map(|i| [i, i]).collect() });
            }
        }
        Matches { pictures: (0..count).map(picture).collect(), pairs }
    }

    #[test]
    fn a_room_behind_a_turntable_is_left_out_and_what_turns_stays() {
        let matches = turntable(24, ROOM);
        let background = StaticBackground::of(&matches, SIDE).unwrap();
        let moving = background.without(&matches);
        assert_eq!(moving.pictures, matches.pictures);
        let is_room = |[a, _]: &[usize; 2]| *a < ROOM;
        assert!(moving.pairs.iter().flat_map(|pair| &pair.matches).all(|pair| !is_room(pair)));
        let of_object = |matches: &Matches| {
            let all = matches.pairs.iter().flat_map(|pair| &pair.matches);
            all.filter(|pair| !is_room(pair)).count()
        };
        // Points that turn towards a camera and away again may be where they were.
        assert!(10 * of_object(&moving) > 9 * of_object(&matches), "{} of {}", of_object(&moving), of_object(&matches));
        assert_eq!(StaticBackground::of(&moving, SIDE), None, "there is no other");
    }

    #[test]
    fn a_plain_background_few_pictures_and_steps_to_the_side_are_no_turntable() {
        assert_eq!(StaticBackground::of(&turntable(24, 0), SIDE), None);
        assert_eq!(StaticBackground::of(&turntable(24, LEAST_MATCHES - 1), SIDE), None);
        assert_eq!(StaticBackground::of(&turntable(LEAST_PICTURES - 1, ROOM), SIDE), None);
        assert!(StaticBackground::of(&turntable(LEAST_PICTURES, ROOM), SIDE).is_some());
        assert_eq!(StaticBackground::of(&Matches::default(), SIDE), None);
        // A camera that is carried along a wall: pictures have less in common the further they are apart.
        let shown = |i: usize, picture: usize| {
            let place = point(i) * DVec2::new(4.0, 1.0) - DVec2::X * 0.12 * SIDE * picture as f64;
            (place.x > 0.0 && place.x < SIDE).then_some(place)
        };
        let picture = |picture: usize| Features {
            name: format!("{picture}.jpg"),
            places: (0..400).map(|i| shown(i, picture).unwrap_or_default()).collect(),
        };
        let pair = |a: usize, b: usize| {
            let both = (0..400).filter(|&i| shown(i, a).is_some() && shown(i, b).is_some());
            Pair { pictures: [a, b], matches: both.map(|i| [i, i]).collect() }
        };
        let pairs = (1..24).flat_map(|b| (0..b).map(move |a| pair(a, b))).collect();
        let wall = Matches { pictures: (0..24).map(picture).collect(), pairs };
        assert_eq!(StaticBackground::of(&wall, SIDE), None);
    }
}
