//! Finds surface that belongs to no part: another state saw empty space where its part would be.

use nalgebra::Point3;
use rayon::prelude::*;

use geometry::{Grid3, NearestPoints, Pose, all_about};

/// Another state, as evidence against a surface.
pub struct OtherState<'a> {
    /// Where it is certainly empty.
    pub free: &'a Grid3<bool>,
    /// Motion of every part from the state of the surface to this state.
    pub from_this: Vec<Pose>,
}

/// Number of neighboring samples that decide about one, itself included.
const TOGETHER: usize = 9;
/// Least number of these at empty places.
///
/// derived: errors move one in fifty true samples there (docs/method.md 7.2), and nine in ten others are
/// there; one of a hundred samples is of no part: 5 ln(0.9 / 0.02) + 4 ln(0.1 / 0.98) is more than ln 100,
/// for 4 of 9 it is not
const EMPTY: usize = 5;

/// Whether another state contradicts each of a state's surface points: it saw the place to which the point's
/// part would take it empty, and everything around within errors of `error_m`, meters. A surface seen in only
/// one state is explained if it was hidden in the others; no motion explains a contradicted one.
pub fn contradicted_points(
    points: &[Point3<f64>],
    labels: &[u8],
    others: &[OtherState<'_>],
    error_m: f64,
) -> Vec<bool> {
    let alone: Vec<bool> = points
        .par_iter()
        .zip(labels)
        .map(|(point, &label)| {
            others.iter().any(|other| {
                let place = other.from_this[usize::from(label)] * point;
                all_about(&place, error_m, |p| other.free.holds_around(p))
            })
        })
        .collect();
    let tree = NearestPoints::new(points);
    points
        .par_iter()
        .map(|point| tree.nearest_of(point, TOGETHER).into_iter().filter(|&i| alone[i]).count() >= EMPTY)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::SceneBox;

    #[test]
    fn surface_is_of_no_part_where_its_part_was_seen_to_be_absent() {
        let scene = SceneBox::around_box(&Point3::new(-1.0, -1.0, -1.0), &Point3::new(1.0, 1.0, 1.0));
        let mut free = Grid3::over_scene(&scene, 81, false);
        for i in 0..free.values.len() {
            free.values[i] = free.position_of_index(i).x > 0.0;
        }
        // Two sheets, at x = -0.3 and 0.3, the second with a sample of another label.
        let points: Vec<Point3<f64>> = [-0.3, 0.3]
            .into_iter()
            .flat_map(|x| {
                (0..100).map(move |i| Point3::new(x, 0.02 * (i % 10) as f64, 0.02 * (i / 10) as f64))
            })
            .collect();
        let mut labels = vec![0u8; 200];
        labels[155] = 1;
        let other = |shift: f64| OtherState {
            free: &free,
            from_this: vec![
                Pose::identity(),
                Pose::translation(-0.6, 0.0, 0.0),
                Pose::translation(shift, 0.0, 0.0),
            ],
        };
        let out = contradicted_points(&points, &labels, &[other(0.0)], 0.05);
        assert!(
            out[..100].iter().all(|o| !o) && out[100..].iter().all(|o| *o),
            "one among many is not asked"
        );
        // Hidden by its own motion, all of it stays; within the errors of a border, too.
        assert!(contradicted_points(&points, &[1; 200], &[other(0.0)], 0.05).iter().all(|o| !o));
        assert!(contradicted_points(&points, &[2; 200], &[other(-0.26)], 0.05).iter().all(|o| !o));
        assert!(contradicted_points(&points, &labels, &[], 0.05).iter().all(|o| !o));
    }
}
