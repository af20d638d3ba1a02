//! Mutual best matches between the features of two images, by the inner products of their descriptors.

use crate::features::{
    descriptor::{DESCRIPTOR_NORM, descriptor_product},
    feature::Feature,
};
use numeric::vectorized;

/// Features closer than this to the best match count as the same point, pixels. tuned: shared/bags
const SAME_PLACE_PX: f32 = 2.0;

/// The best and second best match of a feature.
struct BestTwo {
    /// Index of the best match, the first of equals.
    best: usize,
    /// Its inner product.
    top: i32,
    /// Inner product of the best match at another point; 0 if there is none.
    second: i32,
}

impl BestTwo {
    /// The best match, if it passes the ratio test.
    fn clear_best(&self, ratio: f32) -> Option<usize> {
        (squared_distance(self.top) < ratio * ratio * squared_distance(self.second)).then_some(self.best)
    }
}

/// Squared distance of unit vectors from their inner product: 2 - 2 cosine.
fn squared_distance(product: i32) -> f32 {
    (2.0 - 2.0 * product as f32 / (DESCRIPTOR_NORM * DESCRIPTOR_NORM)).max(0.0)
}

/// The best two matches from a row of inner products; `None` for an empty row.
fn best_two(row: &[i32], partners: &[Feature]) -> Option<BestTwo> {
    let (best, &top) = row.iter().enumerate().rev().max_by_key(|(_, s)| **s)?;
    let [u, v] = partners[best].pixel;
    let far = |f: &Feature| (f.pixel[0] - u).abs() > SAME_PLACE_PX || (f.pixel[1] - v).abs() > SAME_PLACE_PX;
    // A feature found at two scales or orientations must not compete with itself.
    let second = row.iter().zip(partners).filter(|(_, f)| far(f)).map(|(s, _)| *s).max().unwrap_or(0);
    Some(BestTwo { best, top, second })
}

vectorized! {
    /// Inner products of the descriptors of all pairs of `a` and `b`. Integer products are exact on any
    /// instruction set.
    fn inner_products(a: &[Feature], b: &[Feature], products: &mut [i32]) = products_of
}

#[inline(always)]
fn products_of(a: &[Feature], b: &[Feature], products: &mut [i32]) {
    for (f, row) in a.iter().zip(products.chunks_exact_mut(b.len())) {
        for (g, product) in b.iter().zip(row) {
            *product = descriptor_product(&f.descriptor, &g.descriptor);
        }
    }
}

/// Index pairs of mutual best matches that pass the ratio test in both directions.
pub(crate) fn mutual_matches(a: &[Feature], b: &[Feature], ratio: f32) -> Vec<(usize, usize)> {
    if a.is_empty() || b.is_empty() {
        return Vec::new();
    }
    let mut products = vec![0; a.len() * b.len()];
    inner_products(a, b, &mut products);
    let mut column = vec![0; a.len()];
    let mut matches = Vec::new();
    for i in 0..a.len() {
        let row = &products[i * b.len()..(i + 1) * b.len()];
        let Some(j) = best_two(row, b).and_then(|found| found.clear_best(ratio)) else { continue };
        column.iter_mut().enumerate().for_each(|(r, c)| *c = products[r * b.len() + j]);
        let Some(back) = best_two(&column, a).and_then(|found| found.clear_best(ratio)) else { continue };
        // A feature appears in the list once per orientation.
        if back == i || a[back].pixel == a[i].pixel {
            matches.push((i, j));
        }
    }
    // So it may match several times.
    let key = |&(i, j): &(usize, usize)| (a[i].pixel.map(f32::to_bits), b[j].pixel.map(f32::to_bits));
    matches.sort_by_key(key);
    matches.dedup_by_key(|m| key(m));
    matches
}
