//! Matching of found parts to true parts.

/// Most parts on either side of a matching.
pub(crate) const MAX_PARTS: usize = 20;

/// One-to-one pairs (row, column) of a cost table with the smallest sum, as many as the smaller side allows.
/// Exact, by dynamic programming over subsets of the larger side. Returned with increasing rows; `None`
/// beyond [`MAX_PARTS`].
pub(crate) fn cheapest_pairs(cost: &[Vec<f64>], columns: usize) -> Option<Vec<(usize, usize)>> {
    let rows = cost.len();
    if rows.max(columns) > MAX_PARTS {
        return None;
    }
    let transposed = rows > columns;
    let (few, many) = if transposed { (columns, rows) } else { (rows, columns) };
    let at = |a: usize, b: usize| if transposed { cost[b][a] } else { cost[a][b] };
    // best[set]: least cost of matching the first |set| members of the smaller side with the members of the
    // set.
    let mut best = vec![f64::INFINITY; 1 << many];
    let mut last = vec![usize::MAX; 1 << many];
    best[0] = 0.0;
    for set in 1..best.len() {
        let a = set.count_ones() as usize - 1;
        for b in (0..many).filter(|b| a < few && set >> b & 1 == 1) {
            let sum = best[set & !(1 << b)] + at(a, b);
            if sum < best[set] {
                (best[set], last[set]) = (sum, b);
            }
        }
    }
    // Every set of the smaller side's size is a full assignment; the cheapest one is traced back.
    let full = (0..best.len()).filter(|s| s.count_ones() as usize == few);
    let mut set = full.min_by(|a, b| best[*a].total_cmp(&best[*b]))?;
    let mut pairs = Vec::with_capacity(few);
    for a in (0..few).rev() {
        let b = last[set];
        if b == usize::MAX {
            return None;
        }
        pairs.push(if transposed { (b, a) } else { (a, b) });
        set &= !(1 << b);
    }
    pairs.sort_unstable();
    Some(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Least sum by trying everything.
    fn brute(cost: &[Vec<f64>], columns: usize, row: usize, used: u32, left: usize) -> f64 {
        if left == 0 {
            return 0.0;
        }
        if row == cost.len() {
            return f64::INFINITY;
        }
        let skip = brute(cost, columns, row + 1, used, left);
        let take = (0..columns).filter(|c| used >> c & 1 == 0);
        take.map(|c| cost[row][c] + brute(cost, columns, row + 1, used | 1 << c, left - 1))
            .fold(skip, f64::min)
    }

    proptest! {
        #[test]
        fn agrees_with_trying_everything(
            rows in 0usize..6,
            columns in 0usize..6,
            values in prop::collection::vec(0.0..1.0f64, 36),
        ) {
            let cost: Vec<Vec<f64>> = (0..rows).map(|r| values[6 * r..6 * r + columns].to_vec()).collect();
            let pairs = cheapest_pairs(&cost, columns).unwrap();
            prop_assert_eq!(pairs.len(), rows.min(columns));
            let sum: f64 = pairs.iter().map(|&(r, c)| cost[r][c]).sum();
            prop_assert!((sum - brute(&cost, columns, 0, 0, rows.min(columns))).abs() < 1e-12);
            let mut taken: Vec<_> = pairs.iter().map(|p| p.1).collect();
            taken.sort_unstable();
            taken.dedup();
            prop_assert_eq!(taken.len(), pairs.len());
        }
    }

    #[test]
    fn too_many_parts_are_refused() {
        assert_eq!(cheapest_pairs(&vec![vec![0.0; 21]; 2], 21), None);
    }
}
