//! What can be turned about a synthetic dataset.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::number_range::{NumberRange, OutOfRange, above, check_config, real, whole};

/// How a mesh is turned into a dataset. The defaults are those of the scenes that DVR implementations are compared on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SynthConfig {
    /// How many views; 24.
    pub views: usize,
    /// Image width in pixels; 64.
    pub width: u32,
    /// Image height in pixels; 64.
    pub height: u32,
    /// Where the cameras stand; all over the sphere.
    pub placement: CameraPlacement,
    /// How far, at most, a camera leaves its regular place, as a share of the cameras' mean distance; 0.25.
    pub jitter: f64,
    /// Distance of the cameras from the middle of the object, in object units; 1.5.
    pub distance: f64,
    /// Focal length in halves of the image's shorter side; 1.75. At the default distance a ball of diameter 0.9 fills
    /// half of the frame, and only a box that is as wide as it is high and deep may reach past the frame with a corner.
    pub focal: f64,
    /// Longest edge of the object's bounding box in object units, i.e. within the cube of edge 1; 0.9.
    pub object_edge: f64,
    /// Samples along each axis of a pixel: 4 gives 16 a pixel.
    pub samples_per_axis: u32,
    /// What the colour of a pixel on the silhouette is made of; the object alone.
    pub edge_color: EdgeColor,
    /// sRGB background in `[0, 1]`; white.
    pub background: [f32; 3],
    /// The light.
    pub lighting: Lighting,
    /// Standard deviation of the noise that is added to sRGB values in `[0, 1]`; 0.
    pub noise: f32,
    /// Standard deviation of the exposure from view to view, in stops (factors of two of the light); 0.
    pub exposure_jitter: f32,
    /// Standard deviation of the white balance from view to view: of the gains of red and of blue against that of green,
    /// in stops; 0.
    pub white_balance_jitter: f32,
    /// Whether depth maps are written; yes.
    pub depth_maps: bool,
    /// Points on the surface in `pointcloud.npz`; 100 000, 0 leaves the file out.
    pub surface_points: usize,
    /// Points of the padded unit cube in `points.npz`; 100 000, 0 leaves the file out.
    pub occupancy_points: usize,
    /// Seed of everything random; equal seeds give equal files.
    pub seed: u64,
}

/// Bytes of a pixel while a view is rendered and written.
const PIXEL_BYTES: u64 = 80;

/// Bytes of a sample of the true shape while it is drawn and written.
const SAMPLE_BYTES: u64 = 80;

impl Default for SynthConfig {
    fn default() -> Self {
        Self {
            views: 24,
            width: 64,
            height: 64,
            placement: CameraPlacement::Sphere,
            jitter: 0.25,
            distance: 1.5,
            focal: 1.75,
            object_edge: 0.9,
            samples_per_axis: 4,
            edge_color: EdgeColor::Object,
            background: [1.0; 3],
            lighting: Lighting::default(),
            noise: 0.0,
            exposure_jitter: 0.0,
            white_balance_jitter: 0.0,
            depth_maps: true,
            surface_points: 100_000,
            occupancy_points: 100_000,
            seed: 0,
        }
    }
}

impl SynthConfig {
    /// The range of every number.
    pub const RANGES: &[NumberRange] = &[
        whole("views", 1, 10_000),
        whole("width", 1, 16_384),
        whole("height", 1, 16_384),
        real("placement.ring.elevation", -90.0, 90.0),
        above("placement.cap.half_angle", 0.0, 180.0),
        real("placement.arc.elevation", -90.0, 90.0),
        above("placement.arc.angle", 0.0, 360.0),
        real("jitter", 0.0, 1.0),
        above("distance", 0.0, 1000.0),
        above("focal", 0.0, 1000.0),
        above("object_edge", 0.0, 1.0),
        whole("samples_per_axis", 1, 64),
        real("background[]", 0.0, 1.0),
        real("lighting.ambient", 0.0, 1000.0),
        real("lighting.lights[].direction[]", -1e6, 1e6),
        real("lighting.lights[].intensity", 0.0, 1000.0),
        real("lighting.headlight", 0.0, 1000.0),
        real("lighting.specular", 0.0, 1000.0),
        real("lighting.shininess", 0.0, 1e6),
        above("lighting.gloss.roughness", 0.0, 1.0),
        real("lighting.gloss.metallic", 0.0, 1.0),
        above("lighting.gloss.light_half_angle", 0.0, 90.0),
        real("noise", 0.0, 10.0),
        real("exposure_jitter", 0.0, 10.0),
        real("white_balance_jitter", 0.0, 10.0),
        whole("surface_points", 0, 100_000_000),
        whole("occupancy_points", 0, 100_000_000),
        whole("seed", 0, u64::MAX),
    ];

    /// Bytes that rendering takes at most, about: a view per thread, and the samples of the true shape.
    pub fn memory_estimate(&self) -> u64 {
        let pixels = u64::from(self.width) * u64::from(self.height);
        let threads = rayon::current_num_threads().min(self.views) as u64;
        threads * pixels * PIXEL_BYTES + (self.surface_points + self.occupancy_points) as u64 * SAMPLE_BYTES
    }

    /// Refuses what cannot be rendered, before anything is.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) with the key, the value and the range.
    pub fn check(&self) -> Result<()> {
        check_config(self, Self::RANGES)?;
        // The corner of the cube is sqrt(3)/2 away: a camera inside the object's ball sees no silhouette.
        if self.distance <= 0.5 * 3f64.sqrt() * self.object_edge {
            let range = "at least 1, so that cameras stand outside the object";
            return Err(OutOfRange::new("distance", self.distance, range).into());
        }
        Ok(())
    }
}

/// Where cameras stand. All look at the middle of the object; the mesh's y axis points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum CameraPlacement {
    /// All over the sphere, on a Fibonacci spiral.
    #[default]
    Sphere,
    /// The upper half of that: a thing on a table.
    UpperHemisphere,
    /// A ring around the y axis: a turntable.
    Ring {
        /// Height of the ring in degrees above the object's middle.
        elevation: f64,
    },
    /// One side only: all within an angle of a slightly raised direction, on a Fibonacci spiral.
    Cap {
        /// The angle in degrees; 180 is the whole sphere.
        half_angle: f64,
    },
    /// A part of a ring, in front of the object: somebody walks around it, but not all the way.
    Arc {
        /// Height of the arc in degrees above the object's middle.
        elevation: f64,
        /// How far the arc goes around the y axis, degrees; 360 is the ring.
        angle: f64,
    },
}

/// What the colour of a pixel that the object fills only partly is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EdgeColor {
    /// The object's colour, where it fills half of the pixel or more, and else the background's. Image and mask agree,
    /// and no background bleeds into what the texture is learned from.
    #[default]
    Object,
    /// Object and background in proportion, as a camera and most renderers have it.
    Mixed,
}

/// Light that is fixed to the object, so that its colours are the same from everywhere (but for `headlight`, `specular`
/// and `gloss`).
///
/// Intensities are linear: a white surface that faces a light of intensity 1 reflects 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Lighting {
    /// Light from everywhere; 0.4.
    pub ambient: f32,
    /// Lights from far away; a bright one from above on one side and a dim one from below on the other.
    pub lights: Vec<DirectionalLight>,
    /// Light from the camera; 0.
    pub headlight: f32,
    /// Strength of white highlights (Blinn 1977); 0, a matt surface.
    pub specular: f32,
    /// Sharpness of the highlights, Blinn's exponent; 40.
    pub shininess: f32,
    /// A surface that mirrors ambient light and lights, both with a size; none.
    pub gloss: Option<Gloss>,
    /// Whether the lights throw shadows; no.
    pub shadows: bool,
}

impl Default for Lighting {
    fn default() -> Self {
        Self {
            ambient: 0.4,
            lights: vec![
                DirectionalLight { direction: DVec3::new(0.5, 0.8, 0.4), intensity: 0.5 },
                DirectionalLight { direction: DVec3::new(-0.6, -0.3, -0.7), intensity: 0.2 },
            ],
            headlight: 0.0,
            specular: 0.0,
            shininess: 40.0,
            gloss: None,
            shadows: false,
        }
    }
}

/// How a surface mirrors its surroundings: the metallic-roughness material of glTF 2.0 (GGX), under lights that are
/// discs. Unlike Blinn's highlights, which lights without a size give, what is mirrored gets sharper with a lower
/// roughness and not smaller, down to a mirror. What is mirrored throws no shadow and is never the object itself.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Gloss {
    /// Roughness, whose square is GGX's alpha; 0.3.
    pub roughness: f64,
    /// 0 is a dielectric: paint, plastic. 1 is metal: all of its light is mirrored, in its base colour. 0.
    pub metallic: f32,
    /// Half of the angle across which each light is seen, degrees; 20, a lamp with a shade. The light that falls on a
    /// surface is that of its intensity, whatever the angle.
    pub light_half_angle: f64,
}

impl Default for Gloss {
    fn default() -> Self {
        Self { roughness: 0.3, metallic: 0.0, light_half_angle: 20.0 }
    }
}

/// A light that is far away.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DirectionalLight {
    /// Where it comes from, of any length but zero, in the mesh's axes.
    pub direction: DVec3,
    /// Linear intensity.
    pub intensity: f32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_can_be_rendered_and_nonsense_cannot() {
        assert!(SynthConfig::default().check().is_ok());
        for broken in [
            SynthConfig { views: 0, ..SynthConfig::default() },
            SynthConfig { focal: f64::NAN, ..SynthConfig::default() },
            SynthConfig { noise: -0.1, ..SynthConfig::default() },
            SynthConfig { object_edge: 1.5, distance: 9.0, ..SynthConfig::default() },
            SynthConfig { distance: 0.5, ..SynthConfig::default() },
        ] {
            assert!(broken.check().is_err(), "{broken:?}");
        }
    }

    #[test]
    fn a_file_may_name_only_what_it_changes_and_nothing_else() {
        let config: SynthConfig = serde_json::from_str(
            r#"{"views": 3, "placement": {"ring": {"elevation": 20}}, "lighting": {"ambient": 1}}"#,
        )
        .unwrap();
        assert_eq!((config.views, config.width, config.lighting.ambient), (3, 64, 1.0));
        assert_eq!(config.placement, CameraPlacement::Ring { elevation: 20.0 });
        assert!(serde_json::from_str::<SynthConfig>(r#"{"vews": 3}"#).is_err());
    }
}
