//! Where a lens puts a direction, and which direction a place comes from.

use glam::{DMat2, DVec2};

/// Iterations of Newton's method, which takes five or six where a lens is one.
const ITERATIONS: usize = 50;

/// What is left of a root in ideal coordinates: a millionth of a pixel at focal lengths of some thousand pixels.
const TOLERANCE: f64 = 1e-10;

/// How a lens moves points in ideal coordinates.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Distortion {
    Polynomial(Polynomial),
    /// Devernay and Faugeras 2001, with the angle `omega`.
    FieldOfView(f64),
    /// Fitzgibbon 2001, with one parameter.
    Division(f64),
    /// The enhanced unified camera model; Khomutenko, Garcia and Martinet.
    Unified {
        alpha: f64,
        beta: f64,
    },
}

/// Radial, tangential and thin-prism terms (Brown 1966; Weng and others 1992), of the tangent of the angle to the axis or,
/// for a fisheye, of the angle itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Polynomial {
    pub fisheye: bool,
    /// Factors of `r^2`, `r^4`, ...
    pub radial: [f64; 6],
    /// The same below the line.
    pub denominator: [f64; 3],
    /// `p1` and `p2` of OpenCV.
    pub tangential: [f64; 2],
    /// Factors of `r^2` and `r^4` in x, then in y.
    pub prism: [f64; 4],
    /// Tangential and prism terms are taken where the radial ones put the point.
    pub compound: bool,
}

impl Distortion {
    /// Of a model of COLMAP; `terms` are its parameters behind the principal point, as many as the model has.
    pub fn of_colmap(model: &str, terms: &[f64]) -> Self {
        let fisheye = model.ends_with("FISHEYE");
        let polynomial = Polynomial { fisheye, ..Polynomial::default() };
        let radial = |terms: &[f64]| {
            let mut radial = [0.0; 6];
            radial.iter_mut().zip(terms).for_each(|(to, from)| *to = *from);
            radial
        };
        let polynomial = match (model, terms) {
            ("FOV", &[omega]) => return Self::FieldOfView(omega),
            ("SIMPLE_DIVISION" | "DIVISION", &[k]) => return Self::Division(k),
            ("EUCM", &[alpha, beta]) => return Self::Unified { alpha, beta },
            ("OPENCV", &[k1, k2, p1, p2]) => {
                Polynomial { radial: radial(&[k1, k2]), tangential: [p1, p2], ..polynomial }
            }
            ("FULL_OPENCV", &[k1, k2, p1, p2, k3, k4, k5, k6]) => Polynomial {
                radial: radial(&[k1, k2, k3]),
                denominator: [k4, k5, k6],
                tangential: [p1, p2],
                ..polynomial
            },
            ("THIN_PRISM_FISHEYE", &[k1, k2, p1, p2, k3, k4, sx1, sy1]) => Polynomial {
                radial: radial(&[k1, k2, k3, k4]),
                tangential: [p1, p2],
                prism: [sx1, 0.0, sy1, 0.0],
                ..polynomial
            },
            ("RAD_TAN_THIN_PRISM_FISHEYE", &[k0, k1, k2, k3, k4, k5, p0, p1, s0, s1, s2, s3]) => Polynomial {
                radial: [k0, k1, k2, k3, k4, k5],
                // Its p0 stands where OpenCV's p2 does.
                tangential: [p1, p0],
                prism: [s0, s1, s2, s3],
                compound: true,
                ..polynomial
            },
            // All others have radial terms alone, or none.
            _ => Polynomial { radial: radial(terms), ..polynomial },
        };
        Self::Polynomial(polynomial)
    }

    /// Whether it moves nothing.
    pub fn is_none(&self) -> bool {
        match self {
            Self::Polynomial(polynomial) => *polynomial == Polynomial::default(),
            Self::FieldOfView(_) => false,
            Self::Division(k) => *k == 0.0,
            Self::Unified { alpha, .. } => *alpha == 0.0,
        }
    }

    pub fn is_finite(&self) -> bool {
        match self {
            Self::Polynomial(p) => {
                [&p.radial[..], &p.denominator, &p.tangential, &p.prism].iter().all(|terms| all_finite(terms))
            }
            Self::FieldOfView(omega) => omega.is_finite(),
            Self::Division(k) => k.is_finite(),
            Self::Unified { alpha, beta } => alpha.is_finite() && *beta > 0.0 && beta.is_finite(),
        }
    }

    /// Where the lens puts a direction.
    pub fn distort(&self, ideal: DVec2) -> Option<DVec2> {
        let distorted = match self {
            Self::Polynomial(polynomial) => polynomial.distort(polynomial.bent(ideal)),
            Self::FieldOfView(omega) => {
                let r = ideal.length();
                // The limits are those at omega = 0, and at the axis.
                let factor = match (omega.abs() < 1e-6, r < 1e-9) {
                    (true, _) => 1.0,
                    (_, true) => 2.0 * (0.5 * omega).tan() / omega,
                    _ => (2.0 * r * (0.5 * omega).tan()).atan() / (r * omega),
                };
                ideal * factor
            }
            Self::Division(k) => {
                let under_root = 1.0 - 4.0 * k * ideal.length_squared();
                if under_root < 0.0 {
                    return None;
                }
                ideal * (2.0 / (1.0 + under_root.sqrt()))
            }
            Self::Unified { alpha, beta } => {
                ideal / (alpha * (beta * ideal.length_squared() + 1.0).sqrt() + 1.0 - alpha)
            }
        };
        distorted.is_finite().then_some(distorted)
    }

    /// Which direction the lens puts there.
    pub fn undistort(&self, distorted: DVec2) -> Option<DVec2> {
        let r2 = distorted.length_squared();
        let ideal = match self {
            Self::Polynomial(polynomial) => polynomial.unbent(polynomial.undistort(distorted)?)?,
            Self::FieldOfView(omega) => {
                let r = r2.sqrt();
                let angle = r * omega;
                if angle.abs() >= 0.5 * std::f64::consts::PI {
                    return None;
                }
                let factor = match (omega.abs() < 1e-6, r < 1e-9) {
                    (true, _) => 1.0,
                    (_, true) => omega / (2.0 * (0.5 * omega).tan()),
                    _ => angle.tan() / (2.0 * r * (0.5 * omega).tan()),
                };
                distorted * factor
            }
            Self::Division(k) => {
                let denominator = 1.0 + k * r2;
                if denominator <= 0.0 {
                    return None;
                }
                distorted / denominator
            }
            Self::Unified { alpha, beta } => {
                let under_root = 1.0 - (2.0 * alpha - 1.0) * beta * r2;
                let above = 1.0 - alpha * alpha * beta * r2;
                if under_root < 0.0 || above <= 0.0 {
                    return None;
                }
                distorted * ((alpha * under_root.sqrt() + 1.0 - alpha) / above)
            }
        };
        ideal.is_finite().then_some(ideal)
    }
}

impl Polynomial {
    /// A direction as the terms take it: for a fisheye, as long as its angle to the axis.
    fn bent(&self, ideal: DVec2) -> DVec2 {
        let r = ideal.length();
        if self.fisheye && r > 0.0 { ideal * (r.atan() / r) } else { ideal }
    }

    /// The inverse; `None` beside or behind the camera.
    fn unbent(&self, point: DVec2) -> Option<DVec2> {
        let angle = point.length();
        match self.fisheye {
            true if angle >= 0.5 * std::f64::consts::PI => None,
            true if angle > 0.0 => Some(point * (angle.tan() / angle)),
            _ => Some(point),
        }
    }

    fn distort(&self, p: DVec2) -> DVec2 {
        let series = |factors: &[f64], r2: f64| factors.iter().rev().fold(0.0, |sum, k| (sum + k) * r2);
        let r2 = p.length_squared();
        let radial = p * ((1.0 + series(&self.radial, r2)) / (1.0 + series(&self.denominator, r2)));
        let q = if self.compound { radial } else { p };
        let (q2, [p1, p2]) = (q.length_squared(), self.tangential);
        let tangential = DVec2::new(
            2.0 * p1 * q.x * q.y + p2 * (q2 + 2.0 * q.x * q.x),
            2.0 * p2 * q.x * q.y + p1 * (q2 + 2.0 * q.y * q.y),
        );
        let prism = DVec2::new(series(&self.prism[..2], q2), series(&self.prism[2..], q2));
        radial + tangential + prism
    }

    /// Newton's method from the distorted point; `None` where it finds no point, or one beyond a fold.
    fn undistort(&self, distorted: DVec2) -> Option<DVec2> {
        let mut p = distorted;
        for _ in 0..ITERATIONS {
            let error = self.distort(p) - distorted;
            let jacobian = self.jacobian(p);
            if error.length() < TOLERANCE {
                return (jacobian.determinant() > 0.0).then_some(p);
            }
            let step = jacobian.inverse() * error;
            if !step.is_finite() {
                return None;
            }
            // Beyond a fold, steps grow: none is longer than the point is far from the axis.
            p -= step.clamp_length_max(0.5 * p.length().max(0.1));
        }
        None
    }

    /// By central differences.
    fn jacobian(&self, p: DVec2) -> DMat2 {
        let h = 1e-6 * p.length().max(1.0);
        let column = |axis: DVec2| (self.distort(p + h * axis) - self.distort(p - h * axis)) / (2.0 * h);
        DMat2::from_cols(column(DVec2::X), column(DVec2::Y))
    }
}

fn all_finite(terms: &[f64]) -> bool {
    terms.iter().all(|term| term.is_finite())
}
