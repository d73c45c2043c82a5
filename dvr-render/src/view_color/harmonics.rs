//! Real spherical harmonics.

use glam::Vec3;

/// Those of degree 0 to 2.
pub(super) const TERMS: usize = 9;

/// Their values for a unit direction: orthonormal on the sphere, as Sloan (2008) lists them but for signs.
#[inline]
pub(super) fn harmonics(Vec3 { x, y, z }: Vec3) -> [f32; TERMS] {
    const CONSTANT: f32 = 0.282_094_8;
    const LINEAR: f32 = 0.488_602_5;
    const PRODUCT: f32 = 1.092_548_4;
    const POLAR: f32 = 0.315_391_57;
    [
        CONSTANT,
        LINEAR * y,
        LINEAR * z,
        LINEAR * x,
        PRODUCT * x * y,
        PRODUCT * y * z,
        POLAR * (3.0 * z * z - 1.0),
        PRODUCT * x * z,
        0.5 * PRODUCT * (x * x - y * y),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_orthonormal_on_the_sphere() {
        // A Fibonacci lattice: all of its points stand for as much of the sphere.
        const POINTS: usize = 100_000;
        let mut products = [[0.0f64; TERMS]; TERMS];
        for i in 0..POINTS {
            let z = 1.0 - (2 * i + 1) as f64 / POINTS as f64;
            let (radius, turn) = ((1.0 - z * z).sqrt(), i as f64 * 2.399_963_229_728_653);
            let terms = harmonics(glam::DVec3::new(radius * turn.cos(), radius * turn.sin(), z).as_vec3());
            for (row, a) in products.iter_mut().zip(terms) {
                row.iter_mut().zip(terms).for_each(|(sum, b)| *sum += f64::from(a * b));
            }
        }
        let area = 4.0 * std::f64::consts::PI / POINTS as f64;
        for (i, row) in products.iter().enumerate() {
            for (j, product) in row.iter().enumerate() {
                let expected = f64::from(u8::from(i == j));
                assert!((product * area - expected).abs() < 1e-3, "{i}, {j}: {}", product * area);
            }
        }
    }
}
