//! Where sets stand among each other, by the points of the object that they share.

use std::collections::HashMap;

use dvr_core::{Camera, Sighting, Similarity, triangulate};
use glam::{DVec2, DVec3, Vec3};

use super::set_pictures::SetView;
use super::tracks::tracks;
use crate::database::Matches;

/// A picture that shows a point further away than this from where the others have it, pixels, has another point.
const REACH_PX: f64 = 3.0;

/// Of a point that is used, a pixel moves the place by at most this share of its distance.
const SURE: f64 = 0.02;

/// Points that are nearer than this share of the object's size may agree.
const TOLERANCE: f64 = 0.03;

/// The share of the points that the size of the object is measured by: some are no points of it.
const MOST: f64 = 0.9;

/// Fewer points that agree tell nothing of how two sets belong together.
const LEAST_AGREEING: usize = 15;

/// The share of the points that two sets have in common that must agree.
const LEAST_SHARE: f64 = 0.3;

/// Tracks that some sets show, with the place that the cameras of each have for them.
pub(super) struct SharedPoints {
    /// Of each track, a place for each set, in the world of that set.
    places: Vec<Vec<Option<DVec3>>>,
    /// How far the features of these places are from where they should be, pixels in the mean.
    pub mean_error_px: f64,
}

impl SharedPoints {
    /// By what the pictures of all sets have in common.
    pub fn of(found: &Matches, sets: &[Vec<SetView>]) -> Self {
        let own: HashMap<&str, (usize, &Camera)> = (sets.iter().enumerate())
            .flat_map(|(set, views)| views.iter().map(move |view| (view.name.as_str(), (set, &view.camera))))
            .collect();
        let cameras: Vec<Option<(usize, &Camera)>> =
            found.pictures.iter().map(|picture| own.get(picture.name.as_str()).copied()).collect();
        let mut points = Vec::new();
        let (mut sum, mut count) = (0.0, 0usize);
        for track in tracks(found) {
            let mut sightings: Vec<Vec<Sighting>> = vec![Vec::new(); sets.len()];
            for feature in track {
                if let Some((set, camera)) = cameras[feature.picture] {
                    sightings[set].push(Sighting { camera, bearing: bearing(camera, feature.place) });
                }
            }
            let placed: Vec<Option<Placed>> = sightings.into_iter().map(place).collect();
            for errors in placed.iter().flatten().map(|placed| &placed.errors_px) {
                sum += errors.iter().sum::<f64>();
                count += errors.len();
            }
            if placed.iter().any(Option::is_some) {
                points.push(placed.iter().map(|placed| Some(placed.as_ref()?.point)).collect());
            }
        }
        Self { places: points, mean_error_px: sum / count.max(1) as f64 }
    }

    /// All points in the world of the first set, each by the first set that shows it.
    pub fn in_first(&self, placements: &[Placement]) -> Vec<Vec3> {
        let place = |places: &Vec<Option<DVec3>>| {
            let mut placed = places.iter().zip(placements);
            placed.find_map(|(place, placement)| Some(placement.to_first.transform_point((*place)?).as_vec3()))
        };
        self.places.iter().filter_map(place).collect()
    }
}

/// Where a pixel of a pinhole picture lies, as `(x / z, y / z)` in camera space.
fn bearing(camera: &Camera, pixel: DVec2) -> DVec2 {
    let [x, y, c] = [camera.intrinsics.x_axis, camera.intrinsics.y_axis, camera.intrinsics.z_axis];
    let down = (pixel.y - c.y) / y.y;
    DVec2::new((pixel.x - c.x - y.x * down) / x.x, down)
}

/// A point by some of its pictures.
struct Placed {
    point: DVec3,
    /// How far it is from where these show it.
    errors_px: Vec<f64>,
}

/// Where most of some pictures of a point have it: what the others disagree with most is left out, one after another.
/// `None` where two do not tell it.
fn place(mut sightings: Vec<Sighting>) -> Option<Placed> {
    loop {
        if sightings.len() < 2 {
            return None;
        }
        let found = triangulate(&sightings)?;
        let error = |sighting: &Sighting| {
            let camera = sighting.camera;
            let p = camera.rotation * found.point + camera.translation;
            let off = p.truncate() / p.z - sighting.bearing;
            (off * camera.intrinsics.x_axis.x).length()
        };
        let errors: Vec<f64> = sightings.iter().map(error).collect();
        let (worst, largest) = errors.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        if *largest <= REACH_PX {
            let covariance = found.covariance;
            let spread = (covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z).sqrt();
            let distance = (found.point - sightings[0].camera.center()).length();
            return (spread <= SURE * distance).then_some(Placed { point: found.point, errors_px: errors });
        }
        sightings.remove(worst);
    }
}

/// How a set stands to the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placement {
    /// Whether it is the first, which stays where it is.
    pub is_first: bool,
    /// Takes its world to that of the first set.
    pub to_first: Similarity,
    /// Points that it shares with sets that were placed before it.
    pub shared: usize,
    /// Of these, those that agree about `to_first`.
    pub agreeing: usize,
    /// The root mean square of how far these are apart, as a share of the object's size.
    pub distance_share: f64,
}

impl Placement {
    /// How many points must agree.
    pub fn least(&self) -> usize {
        LEAST_AGREEING.max((LEAST_SHARE * self.shared as f64).ceil() as usize)
    }

    /// Whether enough points agree.
    pub fn is_sure(&self) -> bool {
        self.is_first || self.agreeing >= self.least()
    }

    const FIRST: Self = Self { is_first: true, to_first: IDENTITY, shared: 0, agreeing: 0, distance_share: 0.0 };
    const NOWHERE: Self = Self { is_first: false, ..Self::FIRST };
}

const IDENTITY: Similarity = Similarity { scale: 1.0, rotation: glam::DQuat::IDENTITY, translation: DVec3::ZERO };

/// Places the sets one after another, first those that share most with sets that are placed. Where none of the rest is
/// sure, all of these are given as they would be, and none of them is.
pub(super) fn place_sets(points: &SharedPoints, count: usize) -> Vec<Placement> {
    let mut placements: Vec<Option<Placement>> = vec![None; count];
    if let Some(first) = placements.first_mut() {
        *first = Some(Placement::FIRST);
    }
    let mut known: Vec<Option<DVec3>> = points.places.iter().map(|places| places.first().copied().flatten()).collect();
    loop {
        let rest = (0..count).filter(|set| placements[*set].is_none());
        let candidates: Vec<(usize, Placement)> = rest.map(|set| (set, place_set(points, &known, set))).collect();
        let best = candidates.iter().max_by_key(|(_, placement)| placement.agreeing);
        let Some(&(set, placement)) = best.filter(|(_, placement)| placement.is_sure()) else {
            for &(set, placement) in &candidates {
                placements[set] = Some(placement);
            }
            break;
        };
        placements[set] = Some(placement);
        for (known, places) in known.iter_mut().zip(&points.places) {
            *known = known.or_else(|| Some(placement.to_first.transform_point(places[set]?)));
        }
    }
    placements.into_iter().flatten().collect()
}

/// Places one set by the points that it shares with what is known.
fn place_set(points: &SharedPoints, known: &[Option<DVec3>], set: usize) -> Placement {
    let pairs = points.places.iter().zip(known).filter_map(|(places, known)| Some((places[set]?, (*known)?)));
    let (from, to): (Vec<DVec3>, Vec<DVec3>) = pairs.unzip();
    let size = size_of(&known.iter().flatten().copied().collect::<Vec<_>>());
    let nowhere = Placement { shared: from.len(), ..Placement::NOWHERE };
    let Some(found) = Similarity::between_most(&from, &to, TOLERANCE * size) else { return nowhere };
    Placement { to_first: found.similarity, agreeing: found.count(), distance_share: found.rms / size, ..nowhere }
}

/// The width of a cloud, without what lies far off.
fn size_of(points: &[DVec3]) -> f64 {
    let coordinate = |axis: usize, share: f64| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        values.sort_by(f64::total_cmp);
        values.get((share * values.len().saturating_sub(1) as f64) as usize).copied().unwrap_or_default()
    };
    let width = |axis: usize| coordinate(axis, 0.5 + 0.5 * MOST) - coordinate(axis, 0.5 - 0.5 * MOST);
    (0..3).map(width).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    /// A wobble without a pattern.
    fn noise(seed: usize) -> DVec3 {
        let of = |k: f64| (12.9898 * (seed as f64 + 1.0) + 78.233 * k).sin() * 43_758.545_3;
        DVec3::new(of(1.0).fract(), of(2.0).fract(), of(3.0).fract())
    }

    /// Three sets: the second shares points with the first, the third with the second alone; some pairs are wrong.
    fn chain() -> (SharedPoints, [Similarity; 3]) {
        let turned = |x: f64, scale: f64| Similarity {
            scale,
            rotation: DQuat::from_euler(glam::EulerRot::XYZ, x, 0.4, -0.2),
            translation: DVec3::new(x, 2.0, -1.0),
        };
        let to_first = [IDENTITY, turned(3.0, 0.6), turned(1.5, 2.0)];
        let points = (0..300).map(|i| {
            let point = noise(i);
            let of_set = |set: usize| {
                let shown = match set {
                    0 => i < 150,
                    1 => i >= 70,
                    _ => i >= 220,
                };
                let wrong = if i % 5 == 0 && set > 0 { 4.0 * noise(i + 5000 * set) } else { DVec3::ZERO };
                shown.then(|| {
                    to_first[set].inverse().transform_point(point + wrong + 0.002 * noise(i + 900 * set + 400))
                })
            };
            (0..3).map(of_set).collect()
        });
        (SharedPoints { places: points.collect(), mean_error_px: 0.0 }, to_first)
    }

    #[test]
    fn sets_are_placed_one_by_another_although_some_points_are_wrong() {
        let (points, truth) = chain();
        let placements = place_sets(&points, 3);
        assert!(placements[0].is_first && placements[0].to_first == IDENTITY);
        for (placement, truth) in placements.iter().zip(truth).skip(1) {
            assert!(placement.agreeing > 55 && placement.agreeing <= 70, "{placement:?}");
            assert!(placement.distance_share < 0.005, "{placement:?}");
            let off = placement.to_first.rotation.angle_between(truth.rotation).to_degrees();
            assert!(off < 0.2 && (placement.to_first.scale / truth.scale - 1.0).abs() < 0.003, "{off} {placement:?}");
        }
        assert_eq!(points.in_first(&placements).len(), 300);
    }

    #[test]
    fn a_set_that_shares_nothing_has_no_point_that_agrees() {
        let (mut points, _) = chain();
        for places in &mut points.places {
            if places[0].is_some() {
                places[1] = None;
            }
        }
        let placements = place_sets(&points, 3);
        assert_eq!((placements[1].shared, placements[1].agreeing, placements[1].is_sure()), (0, 0, false));
        assert!(!placements[2].is_sure(), "{:?}", placements[2]);
    }

    #[test]
    fn a_picture_of_another_point_is_left_out() {
        let point = DVec3::new(0.1, -0.2, 0.05);
        let eyes = [DVec3::new(4.0, 1.0, 0.0), DVec3::new(3.0, 1.0, 2.0), DVec3::new(1.0, 2.0, 4.0)];
        let cameras = eyes.map(|eye| Camera::look_at(640, 480, 700.0, eye, DVec3::ZERO, DVec3::Y));
        let shown = |camera: &Camera, point: DVec3| {
            let p = camera.rotation * point + camera.translation;
            p.truncate() / p.z
        };
        let mut sightings: Vec<Sighting> =
            cameras.iter().map(|camera| Sighting { camera, bearing: shown(camera, point) }).collect();
        sightings.push(Sighting { camera: &cameras[2], bearing: shown(&cameras[2], DVec3::new(-0.3, 0.4, 0.2)) });
        let placed = place(sightings.clone()).unwrap();
        assert!((placed.point - point).length() < 1e-6 && placed.errors_px.len() == 3, "{:?}", placed.errors_px);
        assert!(place(sightings[..1].to_vec()).is_none());
    }
}
