//! Narrow bays of a border.

use nalgebra::{Point3, Vector3};

use crate::TriangleMesh;

/// A bay's mouth is no wider than this, voxels.
/// tuned: made and recorded objects (docs/method.md 16): teeth and lace leave such bays
const MAX_MOUTH: f64 = 4.0;
/// A bay's rim is at least this many times as long as its mouth. derived: the ratio of a bay half as deep as
/// wide
const LEAST_RIM: f64 = 2.0;
/// The rim of a bay is no longer than this, voxels.
/// tuned: made and recorded objects (docs/method.md 16): the rim of a bay twice as deep as the widest hole
const MAX_RIM: f64 = 30.0;
/// Cost of a mouth per length, to set against the length of its rim. tuned: made and recorded objects
/// (docs/method.md 16); above 1, so no mouth spans a straight rim
const COST: f64 = 1.5;
/// Distance behind the mouth, along the rim at both sides, after which the two sides of a bay must have
/// opened by as much more, voxels. tuned: made and recorded objects (docs/method.md 16). The end of a slot,
/// such as a gap beside a door, does not open and is no bay
const OPENING: f64 = 3.0;

/// A narrow bay of a rim.
pub(super) struct Bay {
    /// Length of its rim less the cost of its mouth, meters.
    saved_m: f64,
    /// Index in the rim of its first vertex.
    pub from: usize,
    /// Number of sides of its rim.
    pub sides: usize,
}

/// The deepest bay from each vertex of a rim, sorted by the saved length of rim, largest first. `normals` are
/// those of the mesh's vertices.
pub(super) fn bays_of_rim(
    mesh: &TriangleMesh,
    rim: &[u32],
    normals: &[Vector3<f64>],
    voxel_m: f64,
) -> Vec<Bay> {
    let points: Vec<Point3<f64>> = rim.iter().map(|&v| mesh.vertices[v as usize].cast()).collect();
    let rim_normals: Vec<Vector3<f64>> = rim.iter().map(|&v| normals[v as usize]).collect();
    let mut found: Vec<Bay> =
        (0..rim.len()).filter_map(|from| deepest_bay(&points, &rim_normals, from, voxel_m)).collect();
    found.sort_by(|a, b| b.saved_m.total_cmp(&a.saved_m).then(a.from.cmp(&b.from)));
    found
}

/// The deepest bay from one vertex of a rim. `points` and `normals` are those of the rim's vertices.
fn deepest_bay(points: &[Point3<f64>], normals: &[Vector3<f64>], from: usize, voxel_m: f64) -> Option<Bay> {
    let n = points.len();
    let start = points[from];
    let mut length = 0.0;
    let mut sides = 0;
    // Twice the area within the rim so far.
    let mut area = Vector3::zeros();
    let mut best: Option<Bay> = None;
    // A bay leaves at least one side of the rim.
    while sides + 2 < n {
        let p = points[(from + sides) % n];
        let q = points[(from + sides + 1) % n];
        length += (q - p).norm();
        area += (p - start).cross(&(q - start));
        sides += 1;
        if length > MAX_RIM * voxel_m {
            break;
        }
        let mouth = (q - start).norm();
        // Around surface the rim turns the other way.
        let normal = normals[from] + normals[(from + sides) % n];
        let is_bay = sides >= 2
            && mouth <= MAX_MOUTH * voxel_m
            && length >= LEAST_RIM * mouth
            && area.dot(&normal) < 0.0;
        // A mouth that grows along a straight rim must gain nothing.
        let saved_m = length - COST * mouth;
        let is_deeper = best.as_ref().is_none_or(|least| saved_m > least.saved_m);
        if is_bay && is_deeper && opens_behind(points, from, sides, OPENING * voxel_m) {
            best = Some(Bay { saved_m, from, sides });
        }
    }
    best
}

/// Whether the two sides of a rim, `opening_m` behind the mouth of a bay, are farther apart by as much.
fn opens_behind(points: &[Point3<f64>], from: usize, sides: usize, opening_m: f64) -> bool {
    let n = points.len();
    let to = (from + sides) % n;
    let before = point_along(points, from, n - 1, n - sides, opening_m);
    let behind = point_along(points, to, 1, n - sides, opening_m);
    let (Some(a), Some(b)) = (before, behind) else { return false };
    (a - b).norm() >= (points[from] - points[to]).norm() + opening_m
}

/// The first point at least `length_m` from `start` along a closed rim, in strides of `step` vertices; `None`
/// where this takes `most_sides` or more.
fn point_along(
    points: &[Point3<f64>],
    start: usize,
    step: usize,
    most_sides: usize,
    length_m: f64,
) -> Option<Point3<f64>> {
    let mut k = start;
    let mut length = 0.0;
    let mut left = most_sides;
    while length < length_m && left > 0 {
        let next = (k + step) % points.len();
        length += (points[next] - points[k]).norm();
        k = next;
        left -= 1;
    }
    (left > 0).then_some(points[k])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::borders::{loops::border_loops, plates::plate};

    fn bays_of(mesh: &TriangleMesh) -> Vec<usize> {
        let up = vec![Vector3::z(); mesh.vertices.len()];
        let of = |rim: &Vec<u32>| bays_of_rim(mesh, rim, &up, 1.0).into_iter().map(|bay| bay.sides);
        border_loops(mesh).unwrap().iter().flat_map(of).collect()
    }

    #[test]
    fn a_notch_is_a_bay_and_a_tooth_is_not() {
        let notched = plate(20, 10, |x, y| !((9..11).contains(&x) && y >= 7));
        assert_eq!(bays_of(&notched)[0], 8, "three down, two across, three up");
        let toothed = plate(20, 10, |x, y| y < 7 || (9..11).contains(&x));
        assert!(bays_of(&toothed).is_empty());
    }

    #[test]
    fn slots_and_wide_mouths_are_none() {
        assert!(bays_of(&plate(60, 20, |x, y| !((10..50).contains(&x) && y == 9))).is_empty());
        assert!(bays_of(&plate(30, 10, |x, y| !((9..16).contains(&x) && y >= 7))).is_empty());
    }
}
