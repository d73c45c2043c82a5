//! Real size: known lengths between two places of a photograph, and the factor that takes the units of the files to metres.

use dvr_core::mesh::Mesh;
use dvr_core::{Bvh, Mask, Scene, Similarity};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// A disagreement of known lengths that is worth a warning, per cent.
const DISAGREEMENT: f64 = 5.0;

/// How far a place may be from the mask that shows the object, pixels: masks are not exact.
const BESIDE: i64 = 3;

/// Two places of a photograph, and how far apart the points of the object are that it shows there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KnownLength {
    /// As the user wrote it.
    pub text: String,
    /// The view.
    pub view: String,
    /// Pixels of the view, from the top left corner of its picture.
    pub places: [[f64; 2]; 2],
    /// The distance, in metres.
    pub metres: f64,
}

/// A known length on a mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeasuredLength {
    /// As the user wrote it.
    pub text: String,
    /// The distance of the two points, in units of the scene's files.
    pub units: f64,
    /// The distance that they have, in metres.
    pub metres: f64,
    /// How much longer it is on the mesh in metres than it is, per cent; negative where it is shorter.
    pub error_percent: f64,
}

/// The real size of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RealSize {
    /// What takes units of the scene's files to metres: the mean of what the known lengths say, by least squares of logarithms.
    pub metres_per_unit: f64,
    /// Edges of the box around the mesh, along the axes of the files, in metres.
    pub size_metres: [f64; 3],
    /// The largest error of a known length, per cent; 0 where there is one.
    pub disagreement_percent: f64,
    /// The known lengths.
    pub lengths: Vec<MeasuredLength>,
}

impl KnownLength {
    /// Refuses a place at which the mask of its view shows no object, not even a few pixels beside it. `masks` are those of
    /// views by name; of a view without a mask nothing is known yet.
    ///
    /// # Errors
    /// [`Error::LengthMisses`].
    pub fn check_masks<'a>(&self, masks: impl IntoIterator<Item = (&'a str, &'a Mask)>) -> Result<()> {
        let Some((_, mask)) = masks.into_iter().find(|(view, _)| *view == self.view) else { return Ok(()) };
        let (width, height) = mask.size();
        let shows = |[x, y]: [f64; 2]| {
            let around = |at: f64, size: u32| {
                let at = at.floor() as i64;
                (at - BESIDE).max(0)..=(at + BESIDE).min(i64::from(size) - 1)
            };
            around(y, height).any(|v| around(x, width).any(|u| mask.is_object(u as u32, v as u32)))
        };
        match self.places.iter().position(|place| !shows(*place)) {
            Some(which) => Err(self.misses(which, "mask of the photograph")),
            None => Ok(()),
        }
    }

    fn misses(&self, which: usize, what: &'static str) -> Error {
        Error::LengthMisses { text: self.text.clone(), which: if which == 0 { "first" } else { "second" }, what }
    }

    /// The distance on a mesh in object space, in units of the files.
    fn on(&self, tree: &Bvh, scene: &Scene) -> Result<f64> {
        let view = scene.views.iter().find(|view| view.name == self.view);
        let view = view.ok_or_else(|| Error::ViewsGone { views: vec![self.view.clone()] })?;
        let hit = |which: usize| {
            let ray = view.camera.ray(self.places[which].into());
            let hit = tree.closest_hit(&ray, 0.0, f64::INFINITY).ok_or_else(|| self.misses(which, "mesh"))?;
            Ok::<_, Error>(ray.at(hit.ray_depth))
        };
        let units = hit(0)?.distance(hit(1)?) * scene.object_to_world.scale;
        if units > 0.0 { Ok(units) } else { Err(self.misses(1, "mesh beside the first")) }
    }
}

impl RealSize {
    /// Measures known lengths on a mesh in object space. At least one must be given.
    ///
    /// # Errors
    /// [`Error::LengthMisses`] where a place shows nothing of the mesh, [`Error::ViewsGone`] where a view is not in the scene.
    pub fn measure(lengths: &[KnownLength], mesh: &Mesh, scene: &Scene) -> Result<Self> {
        let tree = Bvh::new(mesh);
        let units: Vec<f64> = lengths.iter().map(|length| length.on(&tree, scene)).collect::<Result<_>>()?;
        let logarithms = lengths.iter().zip(&units).map(|(length, units)| (length.metres / units).ln());
        let metres_per_unit = (logarithms.sum::<f64>() / units.len().max(1) as f64).exp();
        let measured = lengths.iter().zip(&units).map(|(KnownLength { text, metres, .. }, &units)| MeasuredLength {
            text: text.clone(),
            units,
            metres: *metres,
            // One length agrees with itself, whatever rounding says.
            error_percent: if lengths.len() == 1 { 0.0 } else { 100.0 * (units * metres_per_unit / metres - 1.0) },
        });
        let lengths: Vec<MeasuredLength> = measured.collect();
        let mut size = Self {
            metres_per_unit,
            size_metres: [0.0; 3],
            disagreement_percent: lengths.iter().map(|length| length.error_percent.abs()).fold(0.0, f64::max),
            lengths,
        };
        size.look_at(mesh, &scene.object_to_world);
        Ok(size)
    }

    /// Takes the size of another mesh in object space, with the factor as it is.
    pub fn look_at(&mut self, mesh: &Mesh, object_to_world: &Similarity) {
        let to_metres = Self::to_export(Some(self), object_to_world);
        let box_of = mesh.clone().transformed(&to_metres).bounds();
        self.size_metres = box_of.map_or([0.0; 3], |(low, high)| (high - low).as_dvec3().to_array());
    }

    /// What takes object space to the coordinates of exported files: those of the scene's files, in metres about the same origin
    /// where the real size is known.
    pub fn to_export(size: Option<&Self>, object_to_world: &Similarity) -> Similarity {
        let scale = size.map_or(1.0, |size| size.metres_per_unit);
        Similarity { scale, ..Similarity::default() }.after(object_to_world)
    }

    /// What to warn of: lengths that disagree.
    pub fn warning(&self) -> Option<String> {
        (self.disagreement_percent > DISAGREEMENT).then(|| {
            let all = self.lengths.iter().map(|l| format!("{} is off by {:+.1} %", l.text, l.error_percent));
            format!("the known lengths disagree: {}", all.collect::<Vec<_>>().join("; "))
        })
    }
}

/// In a sentence without its full stop, for people.
impl std::fmt::Display for RealSize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y, z] = self.size_metres;
        write!(f, "{x:.4} x {y:.4} x {z:.4} m, {:.6} m per unit of the scene", self.metres_per_unit)?;
        match self.lengths.len() {
            1 => write!(f, ", by one known length"),
            n => write!(f, ", by {n} known lengths, which disagree by {:.1} % at most", self.disagreement_percent),
        }
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes;
    use dvr_core::{Camera, GroundTruth, Mask, Region, View, stored};
    use glam::{DVec3, Vec3};
    use image::{GrayImage, Luma, RgbImage};

    use super::*;

    /// A cube of edge 0.5 whose front is seen head on, in files of which an object unit is three units.
    fn scene() -> (Scene, Mesh) {
        let camera = Camera::look_at(100, 100, 100.0, DVec3::Z * 2.0, DVec3::ZERO, DVec3::Y);
        let inside = |at: u32| (35..65).contains(&at);
        let mask = GrayImage::from_fn(100, 100, |u, v| Luma([if inside(u) && inside(v) { 255 } else { 0 }]));
        let view = View::new("front", camera, stored(RgbImage::new(100, 100)), Mask::from(mask));
        let object_to_world = Similarity { scale: 3.0, translation: DVec3::X, ..Similarity::default() };
        let scene = Scene {
            name: "cube".into(),
            source: "cube".into(),
            format: "test",
            views: vec![view],
            object_to_world,
            region: Region::default(),
            sparse_points: None,
            ground_truth: GroundTruth::default(),
            warnings: Vec::new(),
        };
        (scene, shapes::cuboid(Vec3::splat(-0.25), Vec3::splat(0.25)))
    }

    fn masks(scene: &Scene) -> impl Iterator<Item = (&str, &Mask)> {
        scene.views.iter().filter_map(|view| Some((view.name.as_str(), view.training_mask()?)))
    }

    fn length(from: [f64; 2], to: [f64; 2], metres: f64) -> KnownLength {
        KnownLength { text: format!("{metres}m"), view: "front".into(), places: [from, to], metres }
    }

    #[test]
    fn the_factor_is_the_mean_of_logarithms_and_the_size_follows() {
        let (scene, mesh) = scene();
        // At the front, 1.75 from the eye, twenty pixels are .35 object units, hence 1.05 units of the files.
        let one = RealSize::measure(&[length([40.0, 50.0], [60.0, 50.0], 0.21)], &mesh, &scene).unwrap();
        assert!((one.lengths[0].units - 1.05).abs() < 1e-6 && (one.metres_per_unit - 0.2).abs() < 1e-6, "{one:?}");
        assert!(one.disagreement_percent == 0.0 && one.warning().is_none());
        assert!(one.size_metres.iter().all(|edge| (edge - 0.3).abs() < 1e-6), "{one}");
        let two = [length([40.0, 50.0], [60.0, 50.0], 0.21), length([50.0, 40.0], [50.0, 60.0], 0.84)];
        let two = RealSize::measure(&two, &mesh, &scene).unwrap();
        // Of .2 and .8 the mean is .4, which is twice the one and half of the other.
        assert!((two.metres_per_unit - 0.4).abs() < 1e-6 && (two.disagreement_percent - 100.0).abs() < 1e-4);
        assert!((two.lengths[1].error_percent + 50.0).abs() < 1e-4 && two.warning().unwrap().contains("-50.0 %"));
    }

    #[test]
    fn exports_are_scaled_about_the_origin_of_the_files() {
        let (scene, mesh) = scene();
        let size = RealSize::measure(&[length([40.0, 50.0], [60.0, 50.0], 0.21)], &mesh, &scene).unwrap();
        let point = DVec3::new(0.1, 0.2, 0.3);
        let files = RealSize::to_export(None, &scene.object_to_world).transform_point(point);
        let metres = RealSize::to_export(Some(&size), &scene.object_to_world).transform_point(point);
        assert_eq!(files, scene.object_to_world.transform_point(point));
        assert!(metres.distance(files * size.metres_per_unit) < 1e-12);
    }

    #[test]
    fn places_beside_the_object_are_refused_before_and_after() {
        let (scene, mesh) = scene();
        let beside = length([50.0, 50.0], [90.0, 50.0], 0.1);
        for error in [
            beside.check_masks(masks(&scene)),
            RealSize::measure(std::slice::from_ref(&beside), &mesh, &scene).map(|_| ()),
        ] {
            assert!(matches!(error, Err(Error::LengthMisses { which: "second", .. })), "{error:?}");
        }
        // Two pixels beside the mask, and a mask that is not there.
        length([33.5, 50.0], [60.0, 50.0], 0.1).check_masks(masks(&scene)).unwrap();
        KnownLength { view: "other".into(), ..beside }.check_masks(masks(&scene)).unwrap();
        let gone = KnownLength { view: "other".into(), ..length([40.0, 50.0], [60.0, 50.0], 1.0) };
        assert!(matches!(RealSize::measure(&[gone], &mesh, &scene), Err(Error::ViewsGone { .. })));
    }
}
