//! The convex hull of points.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};

use super::{ConvexSolid, Plane};
use geometry::bounding_box;

/// Least distance outside a face that counts, as a share of the extent. chosen: above the rounding of a
/// double
const OUTSIDE_SHARE: f64 = 1e-9;
/// Points are moved out of common planes by up to this share of the extent: thin faces between corners of
/// one plane would have arbitrary normals. chosen: above rounding, below any tolerance
const JITTER_SHARE: f64 = 1e-5;
/// Point sets flatter than this share of their extent have no hull. chosen: ten times [`JITTER_SHARE`]
const FLAT_SHARE: f64 = 1e-4;

/// A face of the growing hull.
struct HullFace {
    corners: [u32; 3],
    plane: Plane,
}

impl HullFace {
    fn sides(&self) -> [[u32; 2]; 3] {
        let [a, b, c] = self.corners;
        [[a, b], [b, c], [c, a]]
    }
}

/// The convex hull; `None` for points in a plane, on a line or in a point. Faces are triangles; corners are
/// given points, exact to a hundred-thousandth of their extent. Points are added one by one, the farthest
/// first (quadratic in the corners of the hull).
pub fn convex_hull(points: &[Point3<f64>]) -> Option<ConvexSolid> {
    let (lower, upper) = bounding_box(points.iter().copied())?;
    let extent_m = (upper - lower).norm();
    if !(extent_m > 0.0 && extent_m.is_finite()) {
        return None;
    }
    let points = &jittered_points(points, JITTER_SHARE * extent_m)[..];
    let mut faces = tetrahedron(points, FLAT_SHARE * extent_m)?;
    let slack_m = OUTSIDE_SHARE * extent_m;
    // Rounding can leave a joined point outside its faces; as no point is joined twice, the loop ends.
    let mut joined = vec![false; points.len()];
    while let Some((_, apex)) = farthest_outside(points, &joined, &faces, slack_m) {
        joined[apex as usize] = true;
        let (seen, kept): (Vec<HullFace>, Vec<HullFace>) =
            faces.into_iter().partition(|f| f.plane.distance_m(&points[apex as usize]) > slack_m);
        // A side of a seen face is on the rim unless another seen face has it in the opposite direction; the
        // new corner is joined to the rim. A sorted set keeps the order of the faces.
        let all: BTreeSet<[u32; 2]> = seen.iter().flat_map(HullFace::sides).collect();
        let rim = all.iter().filter(|[a, b]| !all.contains(&[*b, *a]));
        let count = kept.len();
        faces = kept;
        faces.extend(rim.filter_map(|&[a, b]| face_of_corners(points, [a, b, apex])));
        if faces.len() <= count {
            break;
        }
    }
    let mut used: Vec<u32> = faces.iter().flat_map(|f| f.corners).collect();
    used.sort_unstable();
    used.dedup();
    let faces = faces
        .iter()
        .map(|f| f.corners.iter().map(|i| used.binary_search(i).unwrap_or_default() as u32).collect())
        .collect();
    Some(ConvexSolid { vertices: used.iter().map(|&i| points[i as usize]).collect(), faces })
}

/// Points moved by up to `by_m` along every axis; deterministic.
fn jittered_points(points: &[Point3<f64>], by_m: f64) -> Vec<Point3<f64>> {
    // The generalised golden ratio of three dimensions (Roberts 2018). derived: 1/x, 1/x^2 and 1/x^3 with x
    // the real root of x^4 = x + 1
    const STEPS: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3];
    let numbered = points.iter().zip(1_u32..);
    numbered
        .map(|(p, i)| p + by_m * Vector3::from(STEPS.map(|s| 2.0 * (s * f64::from(i)).fract() - 1.0)))
        .collect()
}

/// Distance and index of the point farthest outside any face, among those not `joined` yet.
fn farthest_outside(
    points: &[Point3<f64>],
    joined: &[bool],
    faces: &[HullFace],
    slack_m: f64,
) -> Option<(f64, u32)> {
    let free = points.iter().enumerate().filter(|(i, _)| !joined[*i]);
    let distances = free.map(|(i, p)| {
        (faces.iter().map(|f| f.plane.distance_m(p)).fold(f64::NEG_INFINITY, f64::max), i as u32)
    });
    distances.filter(|(d, _)| *d > slack_m).max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))
}

fn face_of_corners(points: &[Point3<f64>], corners: [u32; 3]) -> Option<HullFace> {
    let [a, b, c] = corners.map(|i| points[i as usize].coords);
    let normal = (b - a).cross(&(c - a)).try_normalize(1e-18)?;
    Some(HullFace { corners, plane: Plane { normal, offset_m: normal.dot(&a) } })
}

/// Index and measure of the first point with the largest measure; `None` where it is `least` or less.
fn largest_by(
    points: &[Point3<f64>],
    least: f64,
    measure: impl Fn(&Point3<f64>) -> f64,
) -> Option<(u32, Point3<f64>)> {
    let indexed = points.iter().enumerate();
    let (i, p) = indexed.max_by(|a, b| measure(a.1).total_cmp(&measure(b.1)).then(b.0.cmp(&a.0)))?;
    (measure(p) > least).then_some((i as u32, *p))
}

/// Four points that span a volume, as outward faces.
fn tetrahedron(points: &[Point3<f64>], flat_m: f64) -> Option<Vec<HullFace>> {
    let a = 0;
    let pa = points[0];
    let (b, pb) = largest_by(points, flat_m, |p| (p - pa).norm())?;
    let line = (pb - pa).normalize();
    let (c, pc) = largest_by(points, flat_m, |p| (p - pa).cross(&line).norm())?;
    let normal: Vector3<f64> = (pb - pa).cross(&(pc - pa)).normalize();
    let (d, pd) = largest_by(points, flat_m, |p| (p - pa).dot(&normal).abs())?;
    // Orients the four faces outward whichever side the last point is on.
    let [b, c] = if (pd - pa).dot(&normal) > 0.0 { [c, b] } else { [b, c] };
    [[a, b, c], [a, c, d], [c, b, d], [b, a, d]].into_iter().map(|f| face_of_corners(points, f)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn holds_all_points(points in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 5..60)) {
            let points: Vec<Point3<f64>> = points.into_iter().map(Point3::from).collect();
            let hull = convex_hull(&points).unwrap();
            let planes = hull.face_planes();
            let worst =
                |p: &Point3<f64>| planes.iter().map(|q| q.distance_m(p)).fold(f64::NEG_INFINITY, f64::max);
            prop_assert!(points.iter().all(|p| worst(p) < 1e-4));
            prop_assert!(hull.vertices.iter().all(|v| points.iter().any(|p| (p - v).norm() < 1e-4)));
            prop_assert_eq!(2 * hull.vertices.len() - 4, hull.faces.len());
        }
    }

    #[test]
    fn a_box_with_points_on_its_faces_has_its_volume() {
        let line = [-0.3, 0.0, 0.1, 0.3];
        let points: Vec<_> = line
            .iter()
            .flat_map(|&x| line.iter().flat_map(move |&y| line.map(|z| Point3::new(x, 0.5 * y, 2.0 * z))))
            .collect();
        let volume_m3 = convex_hull(&points).unwrap().volume_m3();
        assert!((volume_m3 - 0.6f64.powi(3)).abs() < 1e-4, "{volume_m3}");
    }

    #[test]
    fn a_prism_with_rounded_corners_is_as_thick_as_it_was() {
        // Two caps of corners on nearly straight sides, rounded as in a file.
        let side = [
            (-0.0692, -0.0063),
            (0.2010, -0.0025),
            (0.2350, 0.0011),
            (0.2491, 0.0049),
            (0.2500, 0.1404),
            (0.2496, 0.2048),
        ];
        let round = |x: f64| (1e7 * x).round() / 1e7;
        let tilt = |x: f64, z: f64, y: f64| {
            Point3::new(round(x + 0.003 * y), round(y + 0.0031 * x), round(z - 0.0049 * y))
        };
        let points: Vec<_> =
            side.iter().flat_map(|&(x, z)| [tilt(x, z, -0.195), tilt(x, z, -0.204)]).collect();
        let hull = convex_hull(&points).unwrap();
        assert!((0.008..0.01).contains(&hull.thickness_m()), "{}", hull.thickness_m());
    }

    #[test]
    fn flat_points_have_none() {
        let flat: Vec<_> = (0..9).map(|i| Point3::new(f64::from(i % 3), f64::from(i / 3), 1.0)).collect();
        assert!(
            convex_hull(&flat).is_none() && convex_hull(&flat[..3]).is_none() && convex_hull(&[]).is_none()
        );
    }
}
