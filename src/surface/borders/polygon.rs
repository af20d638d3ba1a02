//! Triangulates polygons in a plane.

use nalgebra::Point2;

/// Polygons with more corners are refused: the time grows with the third power of their number.
const MAX_CORNERS: usize = 256;

/// Triangles of a simple counter-clockwise polygon as indices of its corners; no side joins two corners for
/// which `is_taken` holds. `None` where sides cross or there is no such triangulation. Of all it has the
/// least sum of longest side squared per area (dynamic programming, Klincsek 1980). Its triangles turn as the
/// polygon does, and cover it once.
pub(super) fn triangulate(
    corners: &[Point2<f64>],
    is_taken: impl Fn(usize, usize) -> bool,
) -> Option<Vec<[usize; 3]>> {
    let n = corners.len();
    if !(3..=MAX_CORNERS).contains(&n) || sides_cross(corners) {
        return None;
    }
    // For the chain from corner i to corner j: the cost of cutting it off, and the third corner of its last
    // triangle.
    let mut best = vec![(0.0, 0); n * n];
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            let is_side = span + 1 == n;
            let cuts = (i + 1..j).map(|k| {
                let third = sliver_cost(&corners[i], &corners[k], &corners[j]);
                (best[i * n + k].0 + best[k * n + j].0 + third, k)
            });
            let least = cuts.min_by(|a, b| a.0.total_cmp(&b.0));
            let open = least.filter(|_| is_side || !is_taken(i, j));
            best[i * n + j] = open.unwrap_or((f64::INFINITY, 0));
        }
    }
    if !best[n - 1].0.is_finite() {
        return None;
    }
    let mut triangles = Vec::with_capacity(n - 2);
    let mut chains = vec![(0, n - 1)];
    while let Some((i, j)) = chains.pop() {
        if j > i + 1 {
            let k = best[i * n + j].1;
            triangles.push([i, k, j]);
            chains.extend([(i, k), (k, j)]);
        }
    }
    Some(triangles)
}

/// Longest side squared per twice the area, infinite for a flat or clockwise triangle.
fn sliver_cost(a: &Point2<f64>, b: &Point2<f64>, c: &Point2<f64>) -> f64 {
    let longest2 = (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
    let area2 = twice_area(a, b, c);
    // Rounding may turn over a triangle with a height below 1/1000 of its longest side.
    if area2 > 1e-3 * longest2 { longest2 / area2 } else { f64::INFINITY }
}

/// Twice the area of a triangle, positive if counter-clockwise.
fn twice_area(a: &Point2<f64>, b: &Point2<f64>, c: &Point2<f64>) -> f64 {
    (b - a).perp(&(c - a))
}

/// Whether a point lies in a polygon: a ray from it along x crosses an odd number of sides.
pub(super) fn is_inside(p: &Point2<f64>, polygon: &[Point2<f64>]) -> bool {
    let n = polygon.len();
    (0..n).filter(|&k| ray_crosses(p, &polygon[k], &polygon[(k + 1) % n])).count() % 2 == 1
}

/// Whether the ray from `p` along x crosses the side from `a` to `b`.
fn ray_crosses(p: &Point2<f64>, a: &Point2<f64>, b: &Point2<f64>) -> bool {
    (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
}

/// Whether two sides cross.
fn sides_cross(corners: &[Point2<f64>]) -> bool {
    let n = corners.len();
    let side = |k: usize| [&corners[k], &corners[(k + 1) % n]];
    (0..n).any(|i| (i + 2..n).filter(|&j| (j + 1) % n != i).any(|j| segments_cross(side(i), side(j))))
}

fn segments_cross([a, b]: [&Point2<f64>; 2], [c, d]: [&Point2<f64>; 2]) -> bool {
    twice_area(a, b, c) * twice_area(a, b, d) < 0.0 && twice_area(c, d, a) * twice_area(c, d, b) < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[Point2<f64>], triangles: &[[usize; 3]]) -> f64 {
        triangles.iter().map(|t| 0.5 * twice_area(&corners[t[0]], &corners[t[1]], &corners[t[2]])).sum()
    }

    #[test]
    fn a_star_is_covered_once() {
        let corner = |k: usize| {
            let radius = if k % 2 == 0 { 2.0 } else { 0.7 };
            let angle = k as f64 * std::f64::consts::TAU / 14.0;
            Point2::new(radius * angle.cos(), radius * angle.sin())
        };
        let corners: Vec<_> = (0..14).map(corner).collect();
        let triangles = triangulate(&corners, |_, _| false).unwrap();
        let step = std::f64::consts::TAU / 14.0;
        assert_eq!(triangles.len(), 12);
        assert!((area(&corners, &triangles) - 14.0 * 0.5 * 2.0 * 0.7 * step.sin()).abs() < 1e-12);
    }

    #[test]
    fn a_taken_side_is_not_used() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Point2::from);
        let taken = |i: usize, j: usize| (i.min(j), i.max(j)) == (0, 2);
        let triangles = triangulate(&square, taken).unwrap();
        assert!(triangles.iter().all(|t| !(t.contains(&0) && t.contains(&2))));
        assert_eq!(triangulate(&square, |i, j| i.abs_diff(j) == 2), None);
    }

    #[test]
    fn crossed_sides_and_clockwise_polygons_are_refused() {
        let bow = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]].map(Point2::from);
        assert_eq!(triangulate(&bow, |_, _| false), None);
        let clockwise = [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]].map(Point2::from);
        assert_eq!(triangulate(&clockwise, |_, _| false), None);
    }
}
