//! Makes the columns of a window orthogonal to its start state.

use crate::fit::acting::{MAX_COLUMNS, Row};

/// For each sample: residual, two orthonormal start columns, and the parameter columns orthogonal to these.
#[must_use]
pub fn orthogonal_columns(rows: &[Row], free: usize) -> Vec<Row> {
    let mut out: Vec<Row> = rows
        .iter()
        .map(|r| {
            let mut o = [0.0; MAX_COLUMNS];
            (o[0], o[1], o[2]) = (r[2 + free], r[0], r[1]);
            o[3..3 + free].copy_from_slice(&r[2..2 + free]);
            o
        })
        .collect();
    // Gram-Schmidt: the second start column minus its part along the first, all others minus both parts.
    for basis in [1, 2] {
        let norm = out.iter().map(|r| r[basis] * r[basis]).sum::<f64>().sqrt();
        let scale = if norm > 1e-12 { 1.0 / norm } else { 0.0 };
        out.iter_mut().for_each(|r| r[basis] *= scale);
        let mut sums: Row = [0.0; MAX_COLUMNS];
        for r in &out {
            for c in 0..3 + free {
                sums[c] += r[c] * r[basis];
            }
        }
        for r in &mut out {
            let b = r[basis];
            for c in (0..3 + free).filter(|&c| c != basis && !(basis == 2 && c == 1)) {
                r[c] -= b * sums[c];
            }
        }
    }
    out
}
