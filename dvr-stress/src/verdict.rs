//! Measures a reconstruction against the true shape, and gives a verdict.

use dvr_core::mesh::{Mesh, Topology};
use dvr_core::metrics::alignment::align_to_surface;
use dvr_core::metrics::shape::{score_surface, surface_floor};
use dvr_core::sampling::{SurfaceSamples, sample_surface};
use dvr_core::{PointCloud, Result};
use serde::{Deserialize, Serialize};

use crate::axis::Case;
use crate::scene::true_cameras;
use crate::sight::seen;

/// The verdict on a reconstruction. All but the first are failures, the gravest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Within the tolerances.
    Solved,
    /// The method stopped with an error.
    Refused,
    /// There is no surface.
    Empty,
    /// Coordinates that are not finite, or a surface with ten times the true area (foam).
    Exploded,
    /// The surface is not watertight.
    Open,
    /// Worse than the visual hull, which needs no training, by more than a tenth of a pixel's footprint.
    WorseThanHull,
    /// The part that the axis is about is missing.
    PartLost,
    /// More or fewer handles than the truth.
    WrongHandles,
    /// Farther from the true shape than half a pixel's footprint.
    Inaccurate,
}

impl Verdict {
    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Solved => "solved",
            Self::Refused => "refused",
            Self::Empty => "empty",
            Self::Exploded => "exploded",
            Self::Open => "not watertight",
            Self::WorseThanHull => "worse than hull",
            Self::PartLost => "part lost",
            Self::WrongHandles => "wrong handles",
            Self::Inaccurate => "inaccurate",
        }
    }
}

/// Figures of a reconstruction against the true shape. Lengths are in object units.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Faces of the mesh; 0 where there is none.
    pub faces: usize,
    /// Whether all coordinates are finite.
    pub finite: bool,
    /// Surface area, as a multiple of the true one.
    pub area_ratio: f64,
    /// Whether it is closed, its connected components and its handles.
    pub topology: Topology,
    /// Chamfer-L1 of the whole surfaces; `None` without a mesh.
    pub chamfer_l1: Option<f64>,
    /// Chamfer-L1 of the parts of both surfaces that at least two views see. This one is judged.
    pub seen_chamfer_l1: Option<f64>,
    /// Chamfer-L1 of two samplings of the true surface.
    pub floor: f64,
    /// Mean distance from the part that the axis is about to the nearest surface, where there is such a part.
    pub part_distance: Option<f64>,
}

/// Largest Chamfer-L1 above the floor, pixels' footprints.
const TOLERANCE: f64 = 0.5;

/// How much larger than the hull's the Chamfer-L1 may be, pixels' footprints.
const HULL_MARGIN: f64 = 0.1;

/// Largest distance of a part from the nearest surface to count as found, pixels' footprints.
const PART_REACH: f64 = 1.0;

/// A surface with more than this multiple of the true area has exploded.
const FOAM: f64 = 10.0;

/// Samples of each surface: their spacing, which the floor shows, is a tenth of a pixel's footprint.
const SAMPLES: usize = 30_000;

/// Samples whose visibility is computed.
const SIGHT_SAMPLES: usize = 6_000;

/// Measures a mesh in object space; `None` is a reconstruction without a mesh. With wrong cameras, the mesh is first
/// aligned with the true shape.
///
/// # Errors
/// When the true mesh has no area.
pub fn measure(case: &Case, seed: u64, mesh: Option<&Mesh>) -> Result<Figures> {
    let truth = &case.object.mesh;
    let floor = surface_floor(truth, SAMPLES, &[], seed)?.chamfer_l1;
    let empty = Mesh::default();
    let mesh = mesh.unwrap_or(&empty);
    let finite = mesh.vertices.iter().all(|vertex| vertex.is_finite());
    let figures = Figures {
        faces: mesh.faces.len(),
        finite,
        area_ratio: area(mesh) / area(truth),
        topology: Topology::of(mesh),
        floor,
        ..Figures::default()
    };
    if mesh.is_empty() || !finite {
        return Ok(figures);
    }
    let found = sample_surface(mesh, SAMPLES, seed.wrapping_add(2));
    if found.points.is_empty() {
        return Ok(figures);
    }
    let real = sample_surface(truth, SAMPLES, seed.wrapping_add(3));
    if case.faults.displace_cameras() {
        // Position, rotation and scale follow from the cameras, and these are wrong.
        let aligned = align_to_surface(&PointCloud::from(found), &PointCloud::from(real.clone()), f64::INFINITY)?;
        let mesh = mesh.clone().transformed(&aligned);
        return compared(case, seed, &mesh, &real, figures);
    }
    compared(case, seed, mesh, &real, figures)
}

/// Completes figures with the distances between a mesh and samples of the true shape.
fn compared(case: &Case, seed: u64, mesh: &Mesh, real: &SurfaceSamples, mut figures: Figures) -> Result<Figures> {
    let truth = &case.object.mesh;
    let found = sample_surface(mesh, SAMPLES, seed.wrapping_add(2));
    let cameras = true_cameras(case, seed);
    let visible = |mesh: &Mesh, samples: &SurfaceSamples| {
        let (points, normals) = (&samples.points[..SIGHT_SAMPLES], &samples.normals[..SIGHT_SAMPLES]);
        let seen = seen(mesh, points, normals, &cameras);
        cloud(points.iter().zip(seen).filter(|(_, seen)| *seen).map(|(&point, _)| point).collect())
    };
    let (found_seen, real_seen) = (visible(mesh, &found), visible(truth, real));
    let (found, real) = (cloud(found.points), cloud(real.points.clone()));
    figures.chamfer_l1 = Some(score_surface(&found, &real, &[])?.chamfer_l1);
    if !found_seen.points.is_empty() && !real_seen.points.is_empty() {
        let accuracy = score_surface(&found_seen, &real, &[])?.accuracy;
        let completeness = score_surface(&found, &real_seen, &[])?.completeness;
        figures.seen_chamfer_l1 = Some(0.5 * (accuracy + completeness));
    }
    if let Some(part) = &case.part {
        let part = cloud(sample_surface(part, SIGHT_SAMPLES, seed).points);
        figures.part_distance = Some(score_surface(&found, &part, &[])?.completeness);
    }
    Ok(figures)
}

/// Judges figures; `hull` are those of the visual hull of the same pictures.
pub fn judge(case: &Case, figures: &Figures, hull: Option<&Figures>) -> Verdict {
    let footprint = case.footprint();
    if figures.faces == 0 {
        return Verdict::Empty;
    }
    // Where nothing of the surface is seen, nothing of it is correct.
    let (true, Some(chamfer)) = (figures.finite, figures.seen_chamfer_l1.or(figures.chamfer_l1)) else {
        return Verdict::Exploded;
    };
    let hull = hull.and_then(|hull| hull.seen_chamfer_l1.or(hull.chamfer_l1));
    let wrong_handles = case.handles.is_some_and(|handles| figures.topology.handles() != Some(handles));
    match () {
        () if figures.area_ratio > FOAM => Verdict::Exploded,
        () if !figures.topology.closed => Verdict::Open,
        () if hull.is_some_and(|hull| chamfer > hull + HULL_MARGIN * footprint) => Verdict::WorseThanHull,
        () if figures.part_distance.is_some_and(|distance| distance > PART_REACH * footprint) => Verdict::PartLost,
        () if wrong_handles => Verdict::WrongHandles,
        () if chamfer - figures.floor > TOLERANCE * footprint => Verdict::Inaccurate,
        () => Verdict::Solved,
    }
}

fn cloud(points: Vec<glam::Vec3>) -> PointCloud {
    PointCloud { points, normals: None, colors: None }
}

fn area(mesh: &Mesh) -> f64 {
    let twice = |face: usize| {
        let [a, b, c] = mesh.triangle(face).map(|corner| corner.as_dvec3());
        (b - a).cross(c - a).length()
    };
    (0..mesh.faces.len()).map(twice).filter(|area| area.is_finite()).sum::<f64>() / 2.0
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes::icosphere;
    use glam::Vec3;

    use super::*;
    use crate::catalogue::axes;

    fn case(name: &str, difficulty: f64) -> Case {
        axes().into_iter().find(|axis| axis.name == name).unwrap().case(difficulty).unwrap()
    }

    fn verdict(case: &Case, mesh: Option<&Mesh>, hull: Option<&Figures>) -> Verdict {
        judge(case, &measure(case, 0, mesh).unwrap(), hull)
    }

    #[test]
    fn the_true_shape_is_solved_and_no_mesh_is_empty() {
        let case = case("views", 24.0);
        assert_eq!(verdict(&case, Some(&case.object.mesh), None), Verdict::Solved);
        assert_eq!(verdict(&case, None, None), Verdict::Empty);
        assert_eq!(verdict(&case, Some(&Mesh::default()), None), Verdict::Empty);
    }

    #[test]
    fn nan_and_foam_are_exploded() {
        let case = case("views", 24.0);
        let mut broken = case.object.mesh.clone();
        broken.vertices[7].x = f32::NAN;
        assert_eq!(verdict(&case, Some(&broken), None), Verdict::Exploded);
        let foam = dvr_core::mesh::shapes::union((0..12).map(|_| case.object.mesh.clone()));
        assert_eq!(verdict(&case, Some(&foam), None), Verdict::Exploded);
    }

    #[test]
    fn a_surface_with_a_hole_is_not_watertight() {
        let case = case("views", 24.0);
        let mut open = case.object.mesh.clone();
        open.faces.pop();
        assert_eq!(verdict(&case, Some(&open), None), Verdict::Open);
    }

    #[test]
    fn a_surface_off_by_a_pixel_is_inaccurate_and_worse_than_a_hull_that_is_not() {
        let case = case("views", 24.0);
        let mut swollen = case.object.mesh.clone();
        swollen.vertices.iter_mut().for_each(|v| *v += case.footprint() as f32 * v.normalize());
        assert_eq!(verdict(&case, Some(&swollen), None), Verdict::Inaccurate);
        let hull = measure(&case, 0, Some(&case.object.mesh)).unwrap();
        assert_eq!(verdict(&case, Some(&swollen), Some(&hull)), Verdict::WorseThanHull);
    }

    #[test]
    fn a_part_that_is_missing_is_lost_however_small() {
        let case = case("tiny-part", 1.0);
        let mut large = icosphere(4, 0.24);
        large.vertices.iter_mut().for_each(|v| *v -= 0.14 * Vec3::new(0.48, 0.6, 0.64));
        assert_eq!(verdict(&case, Some(&large), None), Verdict::PartLost);
        assert_eq!(verdict(&case, Some(&case.object.mesh), None), Verdict::Solved);
    }

    #[test]
    fn what_no_view_sees_is_not_judged() {
        let case = case("one-sided", 30.0);
        // Right on the side that is seen, far too deep on the other.
        let mut deep = case.object.mesh.clone();
        let toward = Vec3::new(0.0, 0.5, 0.75f32.sqrt());
        deep.vertices.iter_mut().for_each(|v| *v += (v.dot(toward) + 0.15).min(0.0) * toward);
        let figures = measure(&case, 0, Some(&deep)).unwrap();
        assert!(figures.chamfer_l1 > figures.seen_chamfer_l1, "{figures:?}");
        assert_eq!(judge(&case, &figures, None), Verdict::Solved, "{figures:?}");
    }
}
