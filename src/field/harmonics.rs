//! Real spherical harmonics of the view direction.

use super::VIEW_COEFFICIENTS;

/// The 16 orthonormal real spherical harmonics of bands 0 to 3 at a unit direction, band by band from order
/// `-l` to `l`, with the Condon-Shortley sign (odd orders negative).
#[must_use]
pub fn view_coefficients([x, y, z]: [f32; 3]) -> [f32; VIEW_COEFFICIENTS] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        // Band 0.
        0.282_094_8,
        // Band 1.
        -0.488_602_5 * y,
        0.488_602_5 * z,
        -0.488_602_5 * x,
        // Band 2.
        1.092_548_4 * x * y,
        -1.092_548_4 * y * z,
        0.946_174_7 * zz - 0.315_391_57,
        -1.092_548_4 * x * z,
        0.546_274_2 * (xx - yy),
        // Band 3.
        0.590_043_6 * y * (yy - 3.0 * xx),
        2.890_611_4 * x * y * z,
        0.457_045_8 * y * (1.0 - 5.0 * zz),
        0.373_176_34 * z * (5.0 * zz - 3.0),
        0.457_045_8 * x * (1.0 - 5.0 * zz),
        1.445_305_7 * z * (xx - yy),
        0.590_043_6 * x * (3.0 * yy - xx),
    ]
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
}
