//! Nearest points in space.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Point3;

/// A fixed set of points for queries of the nearest ones.
pub struct NearestPoints {
    tree: Option<ImmutableKdTree<f64, 3>>,
}

impl NearestPoints {
    /// Builds the search tree; non-finite points are never found.
    pub fn new(points: &[Point3<f64>]) -> Self {
        /// chosen: beyond any point, and its square is finite
        const NOWHERE: f64 = 1e12;
        let entries: Vec<[f64; 3]> = points
            .iter()
            // Moved out of reach, not left out, so the caller's indices stay valid.
            .map(|p| if p.iter().all(|x| x.is_finite()) { [p.x, p.y, p.z] } else { [NOWHERE; 3] })
            .collect();
        Self { tree: if entries.is_empty() { None } else { ImmutableKdTree::new_from_slice(&entries).ok() } }
    }

    /// Index of the nearest point and its distance in meters; `None` without points.
    pub fn nearest_one(&self, point: &Point3<f64>) -> Option<(usize, f64)> {
        let found = self
            .tree
            .as_ref()?
            .query(&[point.x, point.y, point.z])
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute();
        Some((found.item as usize, found.distance.sqrt()))
    }

    /// Indices of the `count` nearest points, or of all if there are fewer, nearest first.
    pub fn nearest_of(&self, point: &Point3<f64>, count: usize) -> Vec<usize> {
        let (Some(tree), Some(count)) = (self.tree.as_ref(), NonZero::new(count)) else { return Vec::new() };
        let found =
            tree.query(&[point.x, point.y, point.z]).nearest_n::<SquaredEuclidean<f64>>(count).execute();
        found.into_iter().map(|f| f.item as usize).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_what_a_full_search_finds() {
        let points: Vec<_> = (0..500)
            .map(|i| Point3::new((i * 37 % 101) as f64, (i * 53 % 89) as f64, (i * 71 % 97) as f64))
            .collect();
        let tree = NearestPoints::new(&points);
        for i in 0..50 {
            let q = Point3::new(i as f64 * 1.9, i as f64 * 1.3, 90.0 - i as f64);
            let best = points.iter().map(|p| (p - q).norm()).fold(f64::INFINITY, f64::min);
            let (found, distance) = tree.nearest_one(&q).unwrap();
            assert!((distance - best).abs() < 1e-9 && ((points[found] - q).norm() - best).abs() < 1e-9);
            let mut all: Vec<f64> = points.iter().map(|p| (p - q).norm()).collect();
            all.sort_by(f64::total_cmp);
            let several = tree.nearest_of(&q, 9);
            assert_eq!(several.len(), 9);
            assert!(several.iter().zip(all).all(|(&i, d)| ((points[i] - q).norm() - d).abs() < 1e-9));
        }
        assert_eq!(tree.nearest_of(&Point3::origin(), 501).len(), 500);
        assert!(NearestPoints::new(&[]).nearest_one(&Point3::origin()).is_none());
    }
}
