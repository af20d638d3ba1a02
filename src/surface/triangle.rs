//! The point of a triangle closest to a given point (Ericson, Real-Time Collision Detection, 5.1.5).

use nalgebra::Vector3;

/// Where on its triangle a closest point lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Feature {
    /// In its interior.
    Face,
    /// On the side from corner `i` to corner `(i + 1) % 3`.
    Edge(u8),
    /// At a corner.
    Corner(u8),
}

/// Closest point of the triangle with corners `a, b, c`, and where on it the point lies. A triangle without
/// area has only sides.
pub(super) fn closest_on_triangle(p: &Vector3<f32>, corners: &[Vector3<f32>; 3]) -> (Vector3<f32>, Feature) {
    let [a, b, c] = corners;
    let ab = b - a;
    let ac = c - a;
    let ap = p - a;
    let d1 = ab.dot(&ap);
    let d2 = ac.dot(&ap);
    // The regions of corners and sides are tried in turn; the interior is what is left.
    if d1 <= 0.0 && d2 <= 0.0 {
        return (*a, Feature::Corner(0));
    }
    let bp = p - b;
    let d3 = ab.dot(&bp);
    let d4 = ac.dot(&bp);
    if d3 >= 0.0 && d4 <= d3 {
        return (*b, Feature::Corner(1));
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (a + ab * (d1 / (d1 - d3)), Feature::Edge(0));
    }
    let cp = p - c;
    let d5 = ab.dot(&cp);
    let d6 = ac.dot(&cp);
    if d6 >= 0.0 && d5 <= d6 {
        return (*c, Feature::Corner(2));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (a + ac * (d2 / (d2 - d6)), Feature::Edge(2));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return (b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))), Feature::Edge(1));
    }
    let sum = va + vb + vc;
    // Without area, rounding decides the regions above; only the sides are left.
    let area2 = ab.cross(&ac).norm_squared();
    if sum > 0.0 && area2 > 1e-12 * ab.norm_squared() * ac.norm_squared() {
        (a + ab * (vb / sum) + ac * (vc / sum), Feature::Face)
    } else {
        closest_on_sides(p, corners)
    }
}

/// Closest point of the three sides.
fn closest_on_sides(p: &Vector3<f32>, corners: &[Vector3<f32>; 3]) -> (Vector3<f32>, Feature) {
    let mut best = (f32::INFINITY, corners[0], Feature::Corner(0));
    for i in 0..3u8 {
        let from = corners[i as usize];
        let to = corners[(i as usize + 1) % 3];
        let along = to - from;
        let length2 = along.norm_squared();
        let share = if length2 > 0.0 { ((p - from).dot(&along) / length2).clamp(0.0, 1.0) } else { 0.0 };
        let q = from + along * share;
        let distance2 = (p - q).norm_squared();
        if distance2 < best.0 {
            let feature = if share <= 0.0 {
                Feature::Corner(i)
            } else if share >= 1.0 {
                Feature::Corner((i + 1) % 3)
            } else {
                Feature::Edge(i)
            };
            best = (distance2, q, feature);
        }
    }
    (best.1, best.2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vectors() -> impl Strategy<Value = [[f32; 3]; 4]> {
        prop::array::uniform4(prop::array::uniform3(-1.0..1.0f32))
    }

    proptest! {
        #[test]
        fn no_sampled_point_of_the_triangle_is_closer(v in vectors()) {
            let [p, a, b, c] = v.map(Vector3::from);
            let (q, feature) = closest_on_triangle(&p, &[a, b, c]);
            let distance = (p - q).norm();
            for i in 0..=20u8 {
                for j in 0..=20 - i {
                    let s = f32::from(i) / 20.0;
                    let t = f32::from(j) / 20.0;
                    prop_assert!(distance <= (p - (a + (b - a) * s + (c - a) * t)).norm() + 1e-5);
                }
            }
            let corners = [a, b, c];
            let on_feature = match feature {
                Feature::Face => (b - a).cross(&(c - a)).normalize().dot(&(q - a)).abs(),
                Feature::Edge(i) => {
                    let from = corners[i as usize];
                    let to = corners[(i as usize + 1) % 3];
                    (q - from).norm() + (q - to).norm() - (to - from).norm()
                }
                Feature::Corner(i) => (q - corners[i as usize]).norm(),
            };
            prop_assert!(on_feature.abs() < 1e-4);
        }

        #[test]
        fn a_triangle_without_area_is_its_sides(v in vectors(), share in 0.0..1.0f32) {
            let [p, a, b, _] = v.map(Vector3::from);
            let (q, _) = closest_on_triangle(&p, &[a, b, a + (b - a) * share]);
            for i in 0..=50u8 {
                prop_assert!((p - q).norm() <= (p - (a + (b - a) * (f32::from(i) / 50.0))).norm() + 1e-3);
            }
        }
    }
}
