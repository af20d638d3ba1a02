//! Real spherical harmonics of the view direction.

use nalgebra::RealField;

use super::VIEW_COEFFICIENTS;

/// The 16 orthonormal real spherical harmonics of bands 0 to 3 at a unit direction, band by band from order
/// `-l` to `l`, with the Condon-Shortley sign (odd orders negative).
pub fn view_coefficients<T: RealField + Copy>([x, y, z]: [T; 3]) -> [T; VIEW_COEFFICIENTS] {
    let c = |value: f64| nalgebra::convert::<f64, T>(value);
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    [
        // Band 0.
        c(0.282_094_8),
        // Band 1.
        c(-0.488_602_5) * y,
        c(0.488_602_5) * z,
        c(-0.488_602_5) * x,
        // Band 2.
        c(1.092_548_4) * x * y,
        c(-1.092_548_4) * y * z,
        c(0.946_174_7) * zz - c(0.315_391_57),
        c(-1.092_548_4) * x * z,
        c(0.546_274_2) * (xx - yy),
        // Band 3.
        c(0.590_043_6) * y * (yy - c(3.0) * xx),
        c(2.890_611_4) * x * y * z,
        c(0.457_045_8) * y * (c(1.0) - c(5.0) * zz),
        c(0.373_176_34) * z * (c(5.0) * zz - c(3.0)),
        c(0.457_045_8) * x * (c(1.0) - c(5.0) * zz),
        c(1.445_305_7) * z * (xx - yy),
        c(0.590_043_6) * x * (c(3.0) * yy - xx),
    ]
}

/// Gradient by the direction, given the gradient `by_coefficients` of a value by [`view_coefficients`]. The
/// polynomials are differentiated in three free coordinates, so only the part perpendicular to the direction
/// is meaningful.
pub(super) fn view_gradient([x, y, z]: [f64; 3], by_coefficients: &[f64; VIEW_COEFFICIENTS]) -> [f64; 3] {
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    // The rows of the Jacobian, in the order of the coefficients.
    let rows = [
        [0.0; 3],
        [0.0, -0.488_602_5, 0.0],
        [0.0, 0.0, 0.488_602_5],
        [-0.488_602_5, 0.0, 0.0],
        [y, x, 0.0].map(|v| 1.092_548_4 * v),
        [0.0, z, y].map(|v| -1.092_548_4 * v),
        [0.0, 0.0, 2.0 * 0.946_174_7 * z],
        [z, 0.0, x].map(|v| -1.092_548_4 * v),
        [x, -y, 0.0].map(|v| 2.0 * 0.546_274_2 * v),
        [-6.0 * x * y, 3.0 * (yy - xx), 0.0].map(|v| 0.590_043_6 * v),
        [y * z, x * z, x * y].map(|v| 2.890_611_4 * v),
        [0.0, 1.0 - 5.0 * zz, -10.0 * y * z].map(|v| 0.457_045_8 * v),
        [0.0, 0.0, 0.373_176_34 * (15.0 * zz - 3.0)],
        [1.0 - 5.0 * zz, 0.0, -10.0 * x * z].map(|v| 0.457_045_8 * v),
        [2.0 * x * z, -2.0 * y * z, xx - yy].map(|v| 1.445_305_7 * v),
        [3.0 * (yy - xx), 6.0 * x * y, 0.0].map(|v| 0.590_043_6 * v),
    ];
    let mut gradient = [0.0; 3];
    for (row, by) in rows.iter().zip(by_coefficients) {
        for k in 0..3 {
            gradient[k] += by * row[k];
        }
    }
    gradient
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gauss-Legendre nodes and weights on `[-1, 1]`, 4 points: exact to degree 7, more than the products' 6.
    const NODES: [(f64, f64); 4] = [
        (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
        (-0.339_981_043_584_856_26, 0.652_145_154_862_546_2),
        (0.339_981_043_584_856_26, 0.652_145_154_862_546_2),
        (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    ];

    #[test]
    fn they_are_orthonormal_on_the_sphere() {
        let mut gram = [[0.0f64; 16]; 16];
        let turns = 16;
        for (z, weight) in NODES {
            for k in 0..turns {
                let phi = std::f64::consts::TAU * f64::from(k) / f64::from(turns);
                let r = (1.0 - z * z).sqrt();
                let c = view_coefficients([(r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32]);
                for (i, row) in gram.iter_mut().enumerate() {
                    for (j, g) in row.iter_mut().enumerate() {
                        *g += weight * std::f64::consts::TAU / f64::from(turns)
                            * f64::from(c[i])
                            * f64::from(c[j]);
                    }
                }
            }
        }
        for (i, row) in gram.iter().enumerate() {
            for (j, &g) in row.iter().enumerate() {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((g - expected).abs() < 1e-5, "<{i}, {j}> = {g}");
            }
        }
    }

    #[test]
    fn the_gradient_is_that_of_the_coefficients() {
        let d = [0.3, -0.5, 0.81];
        let by = std::array::from_fn(|i| (1.7 * i as f64).sin());
        let value = |d: [f64; 3]| view_coefficients(d).iter().zip(&by).map(|(c, b)| c * b).sum::<f64>();
        let gradient = view_gradient(d, &by);
        for k in 0..3 {
            let mut up = d;
            let mut down = d;
            (up[k], down[k]) = (d[k] + 1e-6, d[k] - 1e-6);
            let numeric = (value(up) - value(down)) / 2e-6;
            assert!((numeric - gradient[k]).abs() < 1e-8, "{k}: {numeric} {}", gradient[k]);
        }
    }
}
