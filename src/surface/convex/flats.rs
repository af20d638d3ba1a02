//! Cuts a mesh into flat patches by joining neighbors (hierarchical face clustering, Garland, Willmott and
//! Heckbert 2001): a noisy wall stays one patch, and a round wall becomes as few as the error allows.

use std::{
    cmp::Reverse,
    collections::{BTreeSet, BinaryHeap},
};

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use crate::{TriangleMesh, edges::Edges, patches::Patch};

/// Least ratio of the length of the sum of a patch's normals to its area; below it, the patch bends. tuned:
/// made and recorded objects (docs/method.md 16)
const LEAST_STRAIGHT: f64 = 0.85;
/// Ratio of the variances across and along a patch from which its plane is fitted to its corners; a less flat
/// one takes the mean of its triangles' normals. chosen: five times, as lengths
const WIDE: f64 = 25.0;

/// Moments of the triangles of a patch.
#[derive(Clone, Copy, Default)]
struct Moments {
    area: f64,
    first: Vector3<f64>,
    second: Matrix3<f64>,
    normal: Vector3<f64>,
}

/// The plane of a patch.
struct FittedPlane {
    center: Vector3<f64>,
    /// Unit normal.
    normal: Vector3<f64>,
    /// Mean squared distance from the plane.
    mean_square: f64,
}

impl Moments {
    fn of_triangle(corners: &[Vector3<f64>; 3]) -> Self {
        let [a, b, c] = corners;
        let normal = (b - a).cross(&(c - a)) * 0.5;
        let area = normal.norm();
        let sum = a + b + c;
        let square = |v: &Vector3<f64>| v * v.transpose();
        // Exact on the triangle, as in `inertia`.
        let second = (square(&sum) + square(a) + square(b) + square(c)) * (area / 12.0);
        Self { area, first: sum * (area / 3.0), second, normal }
    }

    fn joined_with(&self, other: &Self) -> Self {
        Self {
            area: self.area + other.area,
            first: self.first + other.first,
            second: self.second + other.second,
            normal: self.normal + other.normal,
        }
    }

    fn fitted_plane(&self) -> FittedPlane {
        let center = self.first / self.area;
        let spread = self.second / self.area - center * center.transpose();
        let eigen = SymmetricEigen::new(spread);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let sizes = order.map(|k| eigen.eigenvalues[k].max(0.0));
        let mean = self.normal.try_normalize(0.0).unwrap_or_else(Vector3::z);
        let thin = eigen.eigenvectors.column(order[0]).into_owned();
        let thin = if thin.dot(&mean) < 0.0 { -thin } else { thin };
        if sizes[1] > WIDE * sizes[0] && thin.dot(&mean) > LEAST_STRAIGHT {
            FittedPlane { center, normal: thin, mean_square: sizes[0] }
        } else {
            FittedPlane { center, normal: mean, mean_square: mean.dot(&(spread * mean)).max(0.0) }
        }
    }
}

/// Mean squared distance of two patches from their common plane; `None` where together they are not flat.
fn joint_mean_square(a: &Moments, b: &Moments, flat_m: f64) -> Option<f64> {
    let both = a.joined_with(b);
    let FittedPlane { mean_square, .. } = both.fitted_plane();
    let straight = both.normal.norm() >= LEAST_STRAIGHT * both.area;
    (straight && mean_square <= flat_m * flat_m).then_some(mean_square)
}

/// Patches within `flat_m` (root mean square, meters) of their planes; largest area first.
pub(super) fn flat_patches(mesh: &TriangleMesh, flat_m: f64) -> Vec<Patch> {
    // Relative to a corner of the mesh: far from the origin the moments would lose digits.
    let origin = mesh.vertices.first().map(|p| p.coords.cast::<f64>()).unwrap_or_default();
    let mut moments: Vec<Moments> = (0..mesh.triangles.len())
        .map(|t| Moments::of_triangle(&mesh.corners(t).map(|p| p.coords.cast::<f64>() - origin)))
        .collect();
    let mut members: Vec<Vec<u32>> = (0..moments.len() as u32).map(|t| vec![t]).collect();
    let near = Edges::of_mesh(mesh).neighbors(moments.len(), |t| moments[t as usize].area > 0.0);
    let mut near: Vec<BTreeSet<u32>> = near.into_iter().map(BTreeSet::from_iter).collect();
    // Mean squares are not negative, so their bits sort like their values.
    let mut queue: BinaryHeap<Reverse<(u64, u32, u32)>> = BinaryHeap::new();
    for (a, all) in near.iter().enumerate() {
        for &b in all.iter().filter(|b| **b as usize > a) {
            let cost = joint_mean_square(&moments[a], &moments[b as usize], flat_m);
            queue.extend(cost.map(|c| Reverse((c.to_bits(), a as u32, b))));
        }
    }
    // A joined patch takes a new number: queue entries with old numbers are stale.
    let mut alive: Vec<bool> = moments.iter().map(|m| m.area > 0.0).collect();
    while let Some(Reverse((_, a, b))) = queue.pop() {
        let a = a as usize;
        let b = b as usize;
        if !alive[a] || !alive[b] {
            continue;
        }
        let new = moments.len();
        moments.push(moments[a].joined_with(&moments[b]));
        let mut all = std::mem::take(&mut members[a]);
        all.append(&mut members[b]);
        members.push(all);
        (alive[a], alive[b]) = (false, false);
        alive.push(true);
        let around: BTreeSet<u32> =
            near[a].iter().chain(&near[b]).copied().filter(|&k| alive[k as usize]).collect();
        for &k in &around {
            near[k as usize].insert(new as u32);
            let cost = joint_mean_square(&moments[k as usize], &moments[new], flat_m);
            queue.extend(cost.map(|c| Reverse((c.to_bits(), k, new as u32))));
        }
        near.push(around);
    }
    let mut found: Vec<Patch> = (0..moments.len())
        .filter(|&k| alive[k])
        .map(|k| {
            let FittedPlane { center, normal, .. } = moments[k].fitted_plane();
            let mut triangles = std::mem::take(&mut members[k]);
            triangles.sort_unstable();
            Patch { triangles, normal, center: Point3::from(center + origin), area_m2: moments[k].area }
        })
        .collect();
    found.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
    found
}
