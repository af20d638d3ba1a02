//! Planes that the object stands on though they do not fill the images: a table with its edges, a rug.
//!
//! A wide plane that ends inside the images may be of the object. It is not where it is level, nothing that
//! changed lies below it, it has the size of furniture, and more of it is seen away from what changed than
//! what changed covers.

use nalgebra::{Point3, UnitQuaternion, Vector3};
use rand_core::Rng;
use rustc_hash::FxHashMap;
use tracing::debug;

use super::{
    background::{Background, in_box},
    claim::FRAME,
    plane::{Plane, Sample, drawn_plane, is_inlier},
    select::CLEARLY,
    voxels::{Cell, CellSet, cell_of_point, center_of_cell, groups},
};
use common::stop::{Stop, Stopped};
use geometry::bounding_box;

/// Least cosine between the normal of a level plane and the vertical, where poses were recorded ...
/// chosen: 5 deg; floors and tables lie better, worlds of SLAM may be tilted by a degree or two
const LEVEL: f64 = 0.996;
/// ... and where only the images say how the camera was held.
/// chosen: 45 deg, nearer to the vertical than to a wall
const LEVEL_BY_IMAGES: f64 = 0.707;
/// Number of hypotheses. derived: a plane of a fifth of the readings is drawn ten times
const TRIALS: usize = 1200;
/// Largest share of the changed cells below the plane.
/// chosen: some are errors at the object's foot
const BELOW: f64 = 0.05;
/// Least area of a stand, square meters: the top of a smaller thing is rather the object's, as of a box with
/// a cap.
/// chosen: side tables are 0.4 m square at least
const LEAST_M2: f64 = 0.16;
/// Side of the squares by which planes are measured, meters.
/// derived: of some 1000 readings a view, ten fall on it at 2 m in 60 views
const SQUARE_M: f64 = 0.03;
/// Fewest readings of a square of a plane. chosen: a surface has tens of them, strays one or two
const LEAST_READINGS: usize = 4;
/// A reading is before a plane from this height on, meters and standard deviations more.
/// chosen: hardly a reading of the plane itself lies higher
const CLEAR_M: f64 = 0.005;
const CLEAR_SIGMAS: f64 = 3.0;
/// Most changed cells that are held against a hypothesis. chosen: a share of 0.05 is known to 0.005
const PROBED: usize = 2_000;

/// What stands on planes: the changed cells, and the box about them, turned about the vertical so that it
/// covers the least.
pub(super) struct Standers {
    middles: Vec<Point3<f64>>,
    /// Rotation from the world to the box.
    box_from_world: UnitQuaternion<f64>,
    /// Lengths of the box about what changed, meters.
    sides_m: [f64; 3],
    /// That box with a margin for the rest of the object: lower and upper corner in its frame, meters.
    object_box_m: [[f64; 3]; 2],
    size_m: f64,
    least_level: f64,
}

impl Standers {
    /// From what changed, in cells of `size_m`; `None` if nothing did.
    pub(super) fn new(
        changed: &CellSet,
        size_m: f64,
        is_tracked: bool,
        stop: &Stop,
    ) -> Result<Option<Self>, Stopped> {
        let cells = large_patches(changed, stop)?;
        let step = cells.len().div_ceil(PROBED).max(1);
        let middles: Vec<Point3<f64>> =
            cells.iter().step_by(step).map(|c| center_of_cell(c, size_m)).collect();
        let Some((box_from_world, [lower, upper])) = least_box(&middles) else { return Ok(None) };
        let sides_m = [0, 1, 2].map(|k| upper[k] - lower[k] + size_m);
        let margin_m = FRAME * sides_m.iter().copied().fold(0.0, f64::max);
        Ok(Some(Self {
            middles,
            box_from_world,
            sides_m,
            object_box_m: [[0, 1, 2].map(|k| lower[k] - margin_m), [0, 1, 2].map(|k| upper[k] + margin_m)],
            size_m,
            least_level: if is_tracked { LEVEL_BY_IMAGES } else { LEVEL },
        }))
    }

    /// Whether the object may stand on a plane: it is level, and hardly anything that changed is below it.
    fn may_stand_on(&self, plane: &Plane) -> bool {
        let is_below = |p: &&Point3<f64>| plane.height_m(p) < -self.size_m;
        plane.normal.z >= self.least_level
            && self.middles.iter().filter(is_below).count() as f64 <= BELOW * self.middles.len() as f64
    }

    /// Number of readings on a plane away from the object; `None` where it may not stand on it.
    fn score(&self, plane: &Plane, samples: &[&Sample]) -> Option<u32> {
        let is_counted = |s: &&&Sample| is_inlier(plane, s) && self.is_away(s);
        self.may_stand_on(plane).then(|| samples.iter().filter(is_counted).count() as u32)
    }

    /// Whether a reading lies away from the object.
    fn is_away(&self, sample: &Sample) -> bool {
        !in_box(Some(self.object_box_m), &(self.box_from_world * sample.point))
    }

    /// Area of the box about what changed as seen along a normal, square meters.
    fn covered_m2(&self, plane: &Plane) -> f64 {
        let side = self.sides_m;
        let normal = self.box_from_world * plane.normal;
        (0..3).map(|k| normal[k].abs() * side[(k + 1) % 3] * side[(k + 2) % 3]).sum()
    }

    /// Area of a plane that was seen away from the object, square meters.
    fn away_m2(&self, plane: &Plane, samples: &[Sample]) -> f64 {
        let side_m = SQUARE_M.max(self.size_m);
        let on_plane = samples.iter().filter(|s| is_inlier(plane, s) && self.is_away(s));
        let mut squares: FxHashMap<Cell, usize> = FxHashMap::default();
        for square in on_plane.filter_map(|s| cell_of_point(&s.point, side_m)) {
            *squares.entry(square).or_default() += 1;
        }
        let seen = squares.values().filter(|count| **count >= LEAST_READINGS).count();
        seen as f64 * side_m * side_m
    }
}

/// The widest plane that the object stands on, among readings off the background; `None` if there is none.
pub(super) fn stand_of_object(
    samples: &[Sample],
    cameras: &[Point3<f64>],
    standers: &Standers,
    background: &Background<'_>,
    rng: &mut impl Rng,
) -> Option<Plane> {
    let off: Vec<Sample> = samples.iter().filter(|s| is_off(s, background)).cloned().collect();
    if off.len() < 3 {
        return None;
    }
    let plane = drawn_plane(&off, cameras, TRIALS, rng, |plane, scored| standers.score(plane, scored))?;
    let may_stand = standers.may_stand_on(&plane);
    let away_m2 = standers.away_m2(&plane, &off);
    let covered_m2 = standers.covered_m2(&plane);
    debug!(%plane, away_m2, covered_m2, may_stand, "stand of the object");
    (may_stand && away_m2 > covered_m2 && away_m2 + covered_m2 >= LEAST_M2).then_some(plane)
}

/// The box about points whose footprint is the least of those turned about the vertical by whole degrees: the
/// rotation to its frame, and its lower and upper corner there, meters. `None` without points.
fn least_box(points: &[Point3<f64>]) -> Option<(UnitQuaternion<f64>, [Point3<f64>; 2])> {
    let mut least: Option<(f64, UnitQuaternion<f64>, [Point3<f64>; 2])> = None;
    for degrees in 0..90 {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), f64::from(degrees).to_radians());
        let (lower, upper) = bounding_box(points.iter().map(|p| turn * p))?;
        let footprint_m2 = (upper.x - lower.x) * (upper.y - lower.y);
        if least.as_ref().is_none_or(|(area_m2, ..)| footprint_m2 < *area_m2) {
            least = Some((footprint_m2, turn, [lower, upper]));
        }
    }
    least.map(|(_, turn, corners)| (turn, corners))
}

/// The cells of the large patches of what changed; errors at edges make many small ones.
fn large_patches(changed: &CellSet, stop: &Stop) -> Result<Vec<Cell>, Stopped> {
    let mut cells: Vec<Cell> = changed.iter().copied().collect();
    cells.sort_unstable();
    let patches = groups(&cells, 1, stop)?;
    let most = patches.iter().map(Vec::len).max().unwrap_or(0);
    Ok(patches.into_iter().filter(|p| CLEARLY * p.len() as f64 >= most as f64).flatten().collect())
}

/// Whether a reading is clearly before all background planes.
fn is_off(sample: &Sample, background: &Background<'_>) -> bool {
    in_box(background.config.isolate.workspace, &sample.point)
        && background.planes_at(&sample.point).all(|p| is_before(sample, &background.planes[p]))
}

/// Whether a reading is clearly before a plane.
fn is_before(sample: &Sample, plane: &Plane) -> bool {
    let clear_m = CLEAR_M + CLEAR_SIGMAS * plane.height_sigma_m(&sample.ray, sample.sigma_m);
    plane.height_m(&sample.point) > clear_m
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_about_what_changed_turns_with_it() {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.61);
        let points: Vec<Point3<f64>> = (0..600)
            .map(|i| turn * Point3::new(0.01 * f64::from(i % 30), 0.01 * f64::from(i / 30 % 10), 0.1))
            .collect();
        let (box_from_world, [lower, upper]) = least_box(&points).unwrap();
        // Sides of 0.29 and 0.09 m; a box along the axes of the world would cover four times as much.
        assert!((upper.x - lower.x) * (upper.y - lower.y) < 1.05 * 0.29 * 0.09);
        let direction = box_from_world * turn * Vector3::x();
        assert!(direction.x.abs().max(direction.y.abs()) > 0.999, "{direction}");
        assert!(least_box(&[]).is_none());
    }
}
