//! Narrow bays of a border.

use nalgebra::{Point3, Vector3};

use crate::TriangleMesh;

/// A bay's mouth is no wider than this, voxels.
/// tuned: made and recorded objects (docs/method.md 16): what teeth and lace leave
const MAX_MOUTH: f64 = 4.0;
/// A bay's rim is at least so many times as long as its mouth.
/// derived: the least of a bay that is half as deep as wide
const LEAST_RIM: f64 = 2.0;
/// The rim of a bay is no longer than this, voxels.
/// tuned: made and recorded objects (docs/method.md 16): the rim of a bay twice as deep as the widest hole
const MAX_RIM: f64 = 30.0;
/// What a mouth costs of the rim that it saves, per length: tuned; more than 1, so that it spans no straight
/// rim. tuned: made and recorded objects (docs/method.md 16); more than 1, so that it spans no straight rim
const COST: f64 = 1.5;
/// So far behind the mouth, along the rim at both sides, the rim must stand apart by as much more, voxels.
/// tuned: made and recorded objects (docs/method.md 16). The end of a slot, such as a gap beside a door, does
/// not open and is no bay
const OPENING: f64 = 3.0;

/// The deepest bay from each vertex of a rim: where it begins and how many sides it has. Those that save most
/// of the rim come first. `normals` are those of the mesh's vertices.
pub(super) fn bays(
    mesh: &TriangleMesh,
    rim: &[u32],
    normals: &[Vector3<f64>],
    voxel_m: f64,
) -> Vec<(usize, usize)> {
    let n = rim.len();
    let points: Vec<Point3<f64>> = rim.iter().map(|&v| mesh.vertices[v as usize].cast()).collect();
    let deepest = |from: usize| {
        let start = points[from];
        let mut length = 0.0;
        let mut sides = 0;
        // Twice the area that the rim so far goes around.
        let mut area = Vector3::zeros();
        let mut best: Option<(f64, usize)> = None;
        // A bay leaves one side of the rim at least.
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
            let normal = normals[rim[from] as usize] + normals[rim[(from + sides) % n] as usize];
            let is_bay = sides >= 2
                && mouth <= MAX_MOUTH * voxel_m
                && length >= LEAST_RIM * mouth
                && area.dot(&normal) < 0.0;
            // A mouth that grows along a straight rim is no gain.
            let saved = length - COST * mouth;
            let is_deeper = best.is_none_or(|(least, _)| saved > least);
            if is_bay && is_deeper && opens(&points, from, sides, OPENING * voxel_m) {
                best = Some((saved, sides));
            }
        }
        best.map(|(saved, sides)| (saved, from, sides))
    };
    let mut found: Vec<(f64, usize, usize)> = (0..n).filter_map(deepest).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found.into_iter().map(|(_, from, sides)| (from, sides)).collect()
}

/// Whether a rim behind the mouth of a bay stands apart by `opening_m` more than there, as far along it.
fn opens(points: &[Point3<f64>], from: usize, sides: usize, opening_m: f64) -> bool {
    let n = points.len();
    let to = (from + sides) % n;
    let far = |start: usize, step: usize| {
        let mut k = start;
        let mut length = 0.0;
        let mut left = n - sides;
        while length < opening_m && left > 0 {
            let next = (k + step) % n;
            length += (points[next] - points[k]).norm();
            (k, left) = (next, left - 1);
        }
        (left > 0).then_some(points[k])
    };
    let apart = |(a, b): (Point3<f64>, Point3<f64>)| (a - b).norm();
    far(from, n - 1)
        .zip(far(to, 1))
        .map(apart)
        .is_some_and(|d| d >= (points[from] - points[to]).norm() + opening_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::borders::{loops::border_loops, plates::plate};

    fn bays_of(mesh: &TriangleMesh) -> Vec<usize> {
        let up = vec![Vector3::z(); mesh.vertices.len()];
        let of = |rim: &Vec<u32>| bays(mesh, rim, &up, 1.0).into_iter().map(|(_, sides)| sides);
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
