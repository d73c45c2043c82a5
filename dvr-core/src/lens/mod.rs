//! Lenses that distort, and pictures as a pinhole would have taken them.
//!
//! ```
//! use dvr_core::lens::Lens;
//! use image::RgbImage;
//!
//! // COLMAP's RADIAL: f, cx, cy, k1, k2.
//! let lens = Lens::from_colmap("RADIAL", 640, 480, &[500.0, 320.0, 240.0, -0.12, 0.01])?;
//! let undistortion = lens.undistortion()?;
//! let photograph = RgbImage::new(640, 480);
//! let pinhole_picture = undistortion.picture(&photograph);
//! println!("{} pixels wide, K = {}", pinhole_picture.width(), undistortion.intrinsics());
//! # Ok::<(), dvr_core::LensError>(())
//! ```
//!
//! Image coordinates are pixels from the top left corner, as everywhere; ideal coordinates are `(x / z, y / z)` in camera
//! space. The models are COLMAP's, with its names and orders of parameters:
//! <https://github.com/colmap/colmap/blob/main/src/colmap/sensor/models.h>, described at
//! <https://colmap.github.io/cameras.html>.

mod distortion;
mod undistortion;

use glam::{DMat3, DVec2, DVec3};

use crate::error::LensError;
use distortion::{Distortion, Polynomial};
pub use undistortion::Undistortion;

/// Names of COLMAP's camera models, by their number in its binary files, with the number of their parameters.
pub const COLMAP_MODELS: [(&str, usize); 18] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    (PANORAMA, 2),
];

/// The one model that no part of is a pinhole's picture: all directions around the camera.
const PANORAMA: &str = "EQUIRECTANGULAR";

/// The intrinsics of a camera whose lens may distort.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    /// Width and height of the picture in pixels.
    pub size: (u32, u32),
    /// Focal lengths in pixels.
    pub focal: DVec2,
    /// Principal point in pixels.
    pub principal_point: DVec2,
    distortion: Distortion,
}

impl Lens {
    /// A lens by one of COLMAP's camera models, for pictures of `width` x `height` pixels.
    ///
    /// # Errors
    /// [`LensError`] where the model is unknown or a panorama, or its parameters are not as many as they should be, not
    /// finite, or without a positive focal length.
    pub fn from_colmap(model: &str, width: u32, height: u32, parameters: &[f64]) -> Result<Self, LensError> {
        let known = COLMAP_MODELS.iter().find(|(name, _)| *name == model);
        let &(_, expected) = known.ok_or_else(|| LensError::UnknownModel { model: model.to_owned() })?;
        if model == PANORAMA {
            return Err(LensError::Panorama);
        }
        if parameters.len() != expected {
            let (model, found) = (model.to_owned(), parameters.len());
            return Err(LensError::Parameters { model, found, expected });
        }
        // Models with one focal length begin with `f cx cy`, the others with `fx fy cx cy`.
        let one_focal = ["SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"];
        let one_focal = one_focal.contains(&model) || ["SIMPLE_DIVISION", "SIMPLE_FISHEYE"].contains(&model);
        let (focal, center, terms) = match parameters {
            [f, cx, cy, terms @ ..] if one_focal => (DVec2::splat(*f), DVec2::new(*cx, *cy), terms),
            [fx, fy, cx, cy, terms @ ..] => (DVec2::new(*fx, *fy), DVec2::new(*cx, *cy), terms),
            _ => return Err(LensError::Parameters { model: model.to_owned(), found: parameters.len(), expected }),
        };
        Self::new((width, height), focal, center, Distortion::of_colmap(model, terms))
    }

    /// A lens by a polynomial in the distance from the axis and two tangential terms, as OpenCV and nerfstudio have it:
    /// a point at the distance `r` moves by the factor `1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8`. With `fisheye`, `r` is the
    /// angle to the axis in place of its tangent.
    ///
    /// # Errors
    /// [`LensError::NotFinite`] where a number is not finite, or a focal length not positive.
    pub fn polynomial(
        size: (u32, u32),
        focal: DVec2,
        principal_point: DVec2,
        radial: [f64; 4],
        tangential: [f64; 2],
        fisheye: bool,
    ) -> Result<Self, LensError> {
        let [k1, k2, k3, k4] = radial;
        let polynomial =
            Polynomial { fisheye, radial: [k1, k2, k3, k4, 0.0, 0.0], tangential, ..Polynomial::default() };
        Self::new(size, focal, principal_point, Distortion::Polynomial(polynomial))
    }

    fn new(size: (u32, u32), focal: DVec2, principal_point: DVec2, distortion: Distortion) -> Result<Self, LensError> {
        let usable = focal.is_finite() && focal.min_element() > 0.0 && principal_point.is_finite();
        if !usable || !distortion.is_finite() || size.0 == 0 || size.1 == 0 {
            return Err(LensError::NotFinite);
        }
        Ok(Self { size, focal, principal_point, distortion })
    }

    /// Whether straight lines are straight in its pictures.
    pub fn is_pinhole(&self) -> bool {
        self.distortion.is_none()
    }

    /// The matrix `K` of the lens without its distortion.
    pub fn intrinsics(&self) -> DMat3 {
        DMat3::from_cols(
            DVec3::new(self.focal.x, 0.0, 0.0),
            DVec3::new(0.0, self.focal.y, 0.0),
            self.principal_point.extend(1.0),
        )
    }

    /// The pixel that shows the direction `(x / z, y / z)`; `None` where the model shows it nowhere.
    pub fn pixel_of(&self, ideal: DVec2) -> Option<DVec2> {
        Some(self.distortion.distort(ideal)? * self.focal + self.principal_point)
    }

    /// The direction `(x / z, y / z)` that a pixel shows; `None` where it shows none in front of the camera.
    pub fn direction_of(&self, pixel: DVec2) -> Option<DVec2> {
        self.distortion.undistort((pixel - self.principal_point) / self.focal)
    }

    /// The same lens for a scaled copy of its pictures.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let scale = DVec2::new(f64::from(width), f64::from(height))
            / DVec2::new(f64::from(self.size.0), f64::from(self.size.1));
        Self {
            size: (width, height),
            focal: self.focal * scale,
            principal_point: self.principal_point * scale,
            distortion: self.distortion.clone(),
        }
    }

    /// What makes its pictures those of a pinhole.
    ///
    /// # Errors
    /// [`LensError::CannotBeUndone`] where the model folds the picture over, or leaves less than a fifth of it.
    pub fn undistortion(&self) -> Result<Undistortion, LensError> {
        Undistortion::new(self.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every model with a distortion as lenses have it, at 640x480.
    pub(super) fn every_model() -> Vec<Lens> {
        let parameters: [(&str, &[f64]); 17] = [
            ("SIMPLE_PINHOLE", &[520.0, 322.0, 238.0]),
            ("PINHOLE", &[520.0, 515.0, 322.0, 238.0]),
            ("SIMPLE_RADIAL", &[520.0, 322.0, 238.0, -0.11]),
            ("RADIAL", &[520.0, 322.0, 238.0, -0.13, 0.04]),
            ("OPENCV", &[520.0, 515.0, 322.0, 238.0, -0.13, 0.04, 0.002, -0.003]),
            ("OPENCV_FISHEYE", &[420.0, 415.0, 322.0, 238.0, -0.03, 0.01, -0.004, 0.001]),
            ("FULL_OPENCV", &[520.0, 515.0, 322.0, 238.0, 0.2, -0.05, 0.001, 0.002, 0.01, 0.3, -0.02, 0.004]),
            ("FOV", &[520.0, 515.0, 322.0, 238.0, 0.7]),
            ("SIMPLE_RADIAL_FISHEYE", &[420.0, 322.0, 238.0, -0.04]),
            ("RADIAL_FISHEYE", &[420.0, 322.0, 238.0, -0.04, 0.01]),
            (
                "THIN_PRISM_FISHEYE",
                &[420.0, 415.0, 322.0, 238.0, -0.03, 0.01, 0.002, -0.001, 0.003, -0.001, 0.002, -0.003],
            ),
            (
                "RAD_TAN_THIN_PRISM_FISHEYE",
                &[
                    420.0, 415.0, 322.0, 238.0, -0.03, 0.01, 0.002, -0.001, 0.0004, -0.0001, 0.001, -0.002, 0.001,
                    -0.0005, 0.002, 0.0003,
                ],
            ),
            ("SIMPLE_DIVISION", &[520.0, 322.0, 238.0, -0.12]),
            ("DIVISION", &[520.0, 515.0, 322.0, 238.0, -0.12]),
            ("SIMPLE_FISHEYE", &[420.0, 322.0, 238.0]),
            ("FISHEYE", &[420.0, 415.0, 322.0, 238.0]),
            ("EUCM", &[520.0, 515.0, 322.0, 238.0, 0.6, 1.1]),
        ];
        parameters.iter().map(|(model, parameters)| Lens::from_colmap(model, 640, 480, parameters).unwrap()).collect()
    }

    #[test]
    fn every_model_of_colmap_leads_from_pixels_to_directions_and_back() {
        let lenses = every_model();
        assert_eq!(lenses.len() + 1, COLMAP_MODELS.len(), "all but the panorama");
        for (lens, (model, _)) in lenses.iter().zip(COLMAP_MODELS) {
            for (u, v) in (0..=16).flat_map(|u| (0..=12).map(move |v| (40.0 * f64::from(u), 40.0 * f64::from(v)))) {
                let pixel = DVec2::new(u, v);
                let direction = lens.direction_of(pixel).unwrap_or_else(|| panic!("{model} at {pixel}"));
                let back = lens.pixel_of(direction).unwrap();
                assert!((back - pixel).length() < 1e-6, "{model}: {pixel} became {back}");
            }
            assert_eq!(lens.is_pinhole(), model.ends_with("PINHOLE"), "{model}");
        }
    }

    /// Figures by hand of the formulas of `models.h`, at the direction (0.3, -0.2).
    #[test]
    fn the_models_are_those_of_colmap() {
        let (u, v) = (0.3f64, -0.2f64);
        let pixel = |model: &str, parameters: &[f64]| {
            Lens::from_colmap(model, 200, 200, parameters).unwrap().pixel_of(DVec2::new(u, v)).unwrap()
        };
        let close =
            |found: DVec2, x: f64, y: f64| assert!((found - DVec2::new(x, y)).length() < 1e-9, "{found} {x} {y}");
        let r2 = u * u + v * v;
        let f = 1.0 + 0.1 * r2 - 0.2 * r2 * r2;
        close(pixel("RADIAL", &[100.0, 50.0, 60.0, 0.1, -0.2]), 50.0 + 100.0 * f * u, 60.0 + 100.0 * f * v);
        let (p1, p2) = (0.01, 0.02);
        let x = u * f + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u);
        let y = v * f + 2.0 * p2 * u * v + p1 * (r2 + 2.0 * v * v);
        let opencv = [100.0, 90.0, 50.0, 60.0, 0.1, -0.2, p1, p2];
        close(pixel("OPENCV", &opencv), 50.0 + 100.0 * x, 60.0 + 90.0 * y);
        let ratio = f / (1.0 + 0.3 * r2);
        let full = [100.0, 90.0, 50.0, 60.0, 0.1, -0.2, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0];
        close(pixel("FULL_OPENCV", &full), 50.0 + 100.0 * u * ratio, 60.0 + 90.0 * v * ratio);
        let theta = r2.sqrt().atan();
        let g = theta * (1.0 + 0.1 * theta * theta) / r2.sqrt();
        close(pixel("SIMPLE_RADIAL_FISHEYE", &[100.0, 50.0, 60.0, 0.1]), 50.0 + 100.0 * g * u, 60.0 + 100.0 * g * v);
        let omega = 0.8f64;
        let h = (2.0 * r2.sqrt() * (omega / 2.0).tan()).atan() / (r2.sqrt() * omega);
        close(pixel("FOV", &[100.0, 90.0, 50.0, 60.0, omega]), 50.0 + 100.0 * h * u, 60.0 + 90.0 * h * v);
        let d = 2.0 / (1.0 + (1.0 + 4.0 * 0.1 * r2).sqrt());
        close(pixel("SIMPLE_DIVISION", &[100.0, 50.0, 60.0, -0.1]), 50.0 + 100.0 * d * u, 60.0 + 100.0 * d * v);
        let e = 1.0 / (0.4 * (1.2 * r2 + 1.0).sqrt() + 0.6);
        close(pixel("EUCM", &[100.0, 90.0, 50.0, 60.0, 0.4, 1.2]), 50.0 + 100.0 * e * u, 60.0 + 90.0 * e * v);
    }

    #[test]
    fn what_is_no_lens_is_refused() {
        let lens = |model: &str, parameters: &[f64]| Lens::from_colmap(model, 64, 48, parameters).unwrap_err();
        assert!(matches!(lens("KANNALA", &[1.0]), LensError::UnknownModel { .. }));
        assert!(matches!(lens("RADIAL", &[1.0; 4]), LensError::Parameters { found: 4, expected: 5, .. }));
        assert!(matches!(lens("PINHOLE", &[50.0, f64::NAN, 1.0, 1.0]), LensError::NotFinite));
        assert!(matches!(lens("SIMPLE_PINHOLE", &[-5.0, 1.0, 1.0]), LensError::NotFinite));
        assert!(matches!(lens("EQUIRECTANGULAR", &[64.0, 48.0]), LensError::Panorama));
    }
}
