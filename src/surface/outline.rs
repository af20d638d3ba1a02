//! Convex polygons in a plane.

use nalgebra::{Point2, Vector2};

/// The convex hull of points, counter-clockwise; fewer than three corners for points on a line.
pub fn hull_2d(points: &[Point2<f64>]) -> Vec<Point2<f64>> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    // The lower chain, then the upper one back (Andrew 1979); the last corner of each is the first of the
    // other.
    let mut hull = hull_chain(sorted.iter());
    hull.extend(hull_chain(sorted.iter().rev()));
    hull
}

/// The left-turning chain of sorted points, without its last one.
fn hull_chain<'a>(points: impl Iterator<Item = &'a Point2<f64>>) -> Vec<Point2<f64>> {
    let mut chain: Vec<Point2<f64>> = Vec::new();
    for p in points {
        while let [.., a, b] = chain[..]
            && (b - a).perp(&(p - a)) <= 0.0
        {
            chain.pop();
        }
        chain.push(*p);
    }
    chain.pop();
    chain
}

/// Area of a polygon, positive if counter-clockwise.
pub(crate) fn polygon_area(polygon: &[Point2<f64>]) -> f64 {
    (0..polygon.len()).map(|k| polygon[k].coords.perp(&polygon[(k + 1) % polygon.len()].coords)).sum::<f64>()
        * 0.5
}

/// Extent of a polygon along a direction.
fn extent_along(polygon: &[Point2<f64>], direction: &Vector2<f64>) -> f64 {
    let all = polygon.iter().map(|p| p.coords.dot(direction));
    all.clone().fold(f64::NEG_INFINITY, f64::max) - all.fold(f64::INFINITY, f64::min)
}

/// Direction of a side of the smallest rectangle around a convex polygon.
pub(crate) fn rectangle_direction(polygon: &[Point2<f64>]) -> Vector2<f64> {
    let sides = (0..polygon.len())
        .filter_map(|k| (polygon[(k + 1) % polygon.len()] - polygon[k]).try_normalize(1e-12));
    // The smallest rectangle has a side along one of the polygon's (Freeman and Shapira 1975).
    let span = |d: &Vector2<f64>| extent_along(polygon, d) * extent_along(polygon, &Vector2::new(-d.y, d.x));
    sides.min_by(|a, b| span(a).total_cmp(&span(b))).unwrap_or_else(Vector2::x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_rectangle_is_found() {
        let (s, c) = 0.4f64.sin_cos();
        let turned = |x: f64, y: f64| Point2::new(c * x - s * y, s * x + c * y);
        let points: Vec<_> =
            (0..50).map(|i| turned(f64::from(i % 10) / 9.0, f64::from(i / 10) / 8.0)).collect();
        let hull = hull_2d(&points);
        assert!((polygon_area(&hull) - 0.5).abs() < 1e-9);
        let d = rectangle_direction(&hull);
        assert!((d.perp(&Vector2::new(c, s)).abs()).min(d.dot(&Vector2::new(c, s)).abs()) < 1e-9);
    }

    #[test]
    fn points_on_a_line_have_no_area() {
        let line: Vec<_> = (0..5).map(|i| Point2::new(f64::from(i), 0.0)).collect();
        assert!(hull_2d(&line).len() < 3);
        assert!(hull_2d(&[]).is_empty());
    }
}
