//! Inverse of a large matrix from its Cholesky factor by matrix products; nalgebra solves column by column,
//! which takes several times as long.

use nalgebra::{Cholesky, DMatrix, Dyn};

/// Largest triangle inverted column by column.
const SMALL: usize = 24;

/// The inverse of a matrix from its Cholesky factor.
pub(super) fn inverse_by_factor(factor: &Cholesky<f64, Dyn>) -> DMatrix<f64> {
    let triangle = triangle_inverse(&factor.l());
    // Transposed first: matrix products are fast.
    triangle.transpose() * triangle
}

/// The inverse of a lower triangle, by halves: for [A 0; B C] it is [a 0; -c B a, c] with a and c the
/// inverses of A and C.
fn triangle_inverse(lower: &DMatrix<f64>) -> DMatrix<f64> {
    let n = lower.nrows();
    let mut inverse = DMatrix::zeros(n, n);
    if n <= SMALL {
        for column in 0..n {
            inverse[(column, column)] = 1.0 / lower[(column, column)];
            for row in column + 1..n {
                let known = (column..row).map(|k| lower[(row, k)] * inverse[(k, column)]).sum::<f64>();
                inverse[(row, column)] = -known / lower[(row, row)];
            }
        }
        return inverse;
    }
    let half = n / 2;
    let above = triangle_inverse(&lower.view((0, 0), (half, half)).into_owned());
    let below = triangle_inverse(&lower.view((half, half), (n - half, n - half)).into_owned());
    let beside = -(&below * lower.view((half, 0), (n - half, half)).into_owned() * &above);
    inverse.view_mut((0, 0), (half, half)).copy_from(&above);
    inverse.view_mut((half, 0), (n - half, half)).copy_from(&beside);
    inverse.view_mut((half, half), (n - half, n - half)).copy_from(&below);
    inverse
}

#[cfg(test)]
mod tests {
    use rand_core::Rng;

    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn it_is_the_inverse_at_every_size() {
        let mut rng = stage_rng(1, "inverse", 0);
        for n in [0, 1, 5, SMALL, SMALL + 1, 100, 187] {
            let roots = DMatrix::from_fn(n, n, |_, _| rng.next_u64() as f64 / u64::MAX as f64 - 0.5);
            let matrix = &roots * roots.transpose() + DMatrix::identity(n, n);
            let found = inverse_by_factor(&matrix.clone().cholesky().unwrap());
            let off = (&matrix * &found - DMatrix::identity(n, n)).amax();
            assert!(n == 0 || off < 1e-12, "{n}: {off}");
            assert!(n == 0 || (&found - found.transpose()).amax() < 1e-14);
        }
    }
}
