//! Planes that the object stands on though they do not fill the images: a table with its edges, a rug.
//!
//! A wide plane that ends inside the images may be of the object. It is not where it is level, nothing that
//! changed lies below it, and more of it is seen away from what changed than what changed covers.

use nalgebra::Point3;
use rustc_hash::{FxHashMap, FxHashSet};

use super::{
    background::{Background, in_box},
    claim::frame_of,
    plane::{Plane, Sample, is_inlier, oriented_to_cameras, refitted_plane},
    voxels::{Cell, CellSet, center_of_cell},
};
use nalgebra::{Unit, Vector3};

/// Least cosine between the normal of a level plane and the vertical.
/// chosen: 10 deg; floors and tables lie better, worlds of SLAM may be tilted by some degrees
const LEVEL: f64 = 0.985;
/// Height of the slices in which level planes are looked for, meters.
/// chosen: finer than things that stand on each other, coarser than the noise near the camera
const SLICE_M: f64 = 0.01;
/// Number of slices that are tried, the fullest first.
/// chosen: more than an object has level faces of a table's size
const TRIED: usize = 12;
/// Rounds of refitting a plane to its readings. chosen: as for background planes
const ROUNDS: usize = 5;
/// Largest share of the changed cells below the plane.
/// chosen: some are errors at the object's foot
const BELOW: f64 = 0.05;

/// The widest plane that the object stands on, among readings off the background; `None` if there is none or
/// nothing changed. `changed` holds cells of `size_m`.
pub(super) fn stand_of_object(
    samples: &[Sample],
    cameras: &[Point3<f64>],
    changed: &CellSet,
    background: &Background<'_>,
    size_m: f64,
) -> Option<Plane> {
    if changed.is_empty() {
        return None;
    }
    let cells: Vec<Cell> = changed.iter().copied().collect();
    let object_box_m = frame_of(&cells, size_m);
    let off: Vec<Sample> = samples.iter().filter(|s| is_off(s, background)).cloned().collect();
    let mut widest: Option<(usize, Plane)> = None;
    for height_m in full_slices_m(&off) {
        let Some(plane) = level_plane(height_m, &off, cameras) else { continue };
        let is_below = |c: &&Cell| plane.height_m(&center_of_cell(c, size_m)) < -size_m;
        if cells.iter().filter(is_below).count() as f64 > BELOW * cells.len() as f64 {
            continue;
        }
        let [lower, upper] = object_box_m;
        let covered = ((upper[0] - lower[0]) * (upper[1] - lower[1]) / (size_m * size_m)).round() as usize;
        let squares: FxHashSet<[i32; 2]> = off
            .iter()
            .filter(|s| is_inlier(&plane, s) && !is_over(&object_box_m, &s.point))
            .map(|s| square_of_point(&s.point, size_m))
            .collect();
        let wide = area_of_squares(&squares);
        if wide > covered && widest.is_none_or(|(most, _)| wide > most) {
            widest = Some((wide, plane));
        }
    }
    widest.map(|(_, plane)| plane)
}

/// Whether a reading is clearly before all background planes.
fn is_off(sample: &Sample, background: &Background<'_>) -> bool {
    let clear_m = |p: usize| {
        let plane = &background.planes[p];
        plane.height_m(&sample.point) > 0.005 + 3.0 * plane.height_sigma_m(&sample.ray, sample.sigma_m)
    };
    in_box(background.config.isolate.workspace, &sample.point)
        && background.planes_at(&sample.point).all(clear_m)
}

/// Heights of the fullest slices, meters.
fn full_slices_m(samples: &[Sample]) -> Vec<f64> {
    let mut counts: FxHashMap<i32, usize> = FxHashMap::default();
    for sample in samples {
        *counts.entry((sample.point.z / SLICE_M).floor() as i32).or_default() += 1;
    }
    let mut slices: Vec<(usize, i32)> = counts.into_iter().map(|(slice, count)| (count, slice)).collect();
    slices.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
    slices.iter().take(TRIED).map(|(_, slice)| (f64::from(*slice) + 0.5) * SLICE_M).collect()
}

/// The level plane near a height, seen from above by all cameras.
fn level_plane(height_m: f64, samples: &[Sample], cameras: &[Point3<f64>]) -> Option<Plane> {
    let normal = Unit::new_unchecked(Vector3::z());
    let mut plane = oriented_to_cameras(Plane { normal, offset_m: height_m, object_box_m: None }, cameras)?;
    for _ in 0..ROUNDS {
        plane = refitted_plane(&plane, samples, cameras)?;
    }
    (plane.normal.z >= LEVEL).then_some(plane)
}

/// Whether a point lies over or under a box.
fn is_over([lower, upper]: &[[f64; 3]; 2], point: &Point3<f64>) -> bool {
    (0..2).all(|k| point[k] >= lower[k] && point[k] <= upper[k])
}

/// The square of a horizontal grid, twice the size of a cell, as samples are sparse.
fn square_of_point(point: &Point3<f64>, size_m: f64) -> [i32; 2] {
    [0, 1].map(|k| (point[k] / (2.0 * size_m)).floor() as i32)
}

/// Area of squares, in cells.
fn area_of_squares(squares: &FxHashSet<[i32; 2]>) -> usize {
    4 * squares.len()
}
