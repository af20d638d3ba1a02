//! Turns of a round part, such as a cap or a knob: its shape allows any turn; marks on it decide. See
//! docs/method.md 6.8.

use std::f64::consts::TAU;

use rayon::prelude::*;

use crate::{propose::search::Search, samples::slip::round_axis};
use geometry::Pose;

/// Number of turns tried, all around.
const TURNS: usize = 72;
/// Number of the best turns that are polished.
const PEAKS: usize = 4;
/// Share by which a turn must explain more than no turn.
/// tuned: random objects (eval/random_objects.md)
const MORE: f64 = 0.02;

/// The motion of a round part after the best turn about its axis, if this explains more than no turn. Such a
/// turn needs no hinge beside the part.
pub(crate) fn round_turn(search: &Search<'_, '_>, motion: &Pose) -> Option<Pose> {
    let (points, normals) = search.moved_surface(motion);
    let axis = round_axis(&points, &normals)?;
    let total = |m: &Pose| search.sharp_total(m).0;
    let turned: Vec<Pose> =
        (0..TURNS).map(|k| axis.motion_by(TAU * k as f64 / TURNS as f64, 0.0) * motion).collect();
    let totals: Vec<f64> = turned.par_iter().map(total).collect();
    // Marks repeat around a part, and the highest coarse peak need not be the highest after polishing.
    let mut peaks: Vec<usize> = (0..TURNS)
        .filter(|&k| totals[k] >= totals[(k + 1) % TURNS].max(totals[(k + TURNS - 1) % TURNS]))
        .collect();
    peaks.sort_by(|a, b| totals[*b].total_cmp(&totals[*a]));
    let mut best: Option<(f64, Pose)> = None;
    for start in peaks.into_iter().take(PEAKS).map(|k| &turned[k]) {
        let Some(slips) = search.slips_of(start) else { continue };
        let polished = search.climbed_motion(start, slips, total, |pose| search.slips_of(pose));
        if best.as_ref().is_none_or(|b| polished.0 > b.0) {
            best = Some(polished);
        }
    }
    let best = best?;
    // Without marks, turns differ only by noise, and the motion stays as it is.
    (best.0 > (1.0 + MORE) * totals[0]).then_some(best.1)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::{SurfaceSamples, pair::surface_pair::SurfacePair};
    use geometry::Screw;

    const RADIUS_M: f64 = 0.04;
    const HEIGHT_M: f64 = 0.025;

    /// Whether a point in the cap's own coordinates is in the bar on its top.
    fn in_bar(p: &Point3<f64>) -> bool {
        (-0.01..0.035).contains(&p.x) && p.y.abs() < 0.008 && (HEIGHT_M..HEIGHT_M + 0.012).contains(&p.z)
    }

    /// Surface of a round cap with a bar on it, on a table, and whether a point was seen empty, with the cap
    /// in a pose.
    fn cap(pose: Pose) -> (SurfaceSamples, impl Fn(&Point3<f64>) -> bool + Sync) {
        let mut all: Vec<(Point3<f64>, Vector3<f64>)> = Vec::new();
        let rows = |count: i32, step_m: f64| (0..count).map(move |k| f64::from(k) * step_m);
        for angle in rows(120, TAU / 120.0) {
            let out = Vector3::new(angle.cos(), angle.sin(), 0.0);
            all.extend(rows(12, 0.002).map(|z| (Point3::new(0.0, 0.0, z + 0.001) + out * RADIUS_M, out)));
        }
        for (x, y) in rows(40, 0.002).flat_map(|x| rows(40, 0.002).map(move |y| (x - 0.039, y - 0.039))) {
            let above = Point3::new(x, y, HEIGHT_M + 0.006);
            let height_m = if in_bar(&above) { HEIGHT_M + 0.012 } else { HEIGHT_M };
            if x.hypot(y) < RADIUS_M {
                all.push((Point3::new(x, y, height_m), Vector3::z()));
            }
        }
        for z in rows(6, 0.002).map(|z| HEIGHT_M + 0.001 + z) {
            all.extend(rows(22, 0.002).flat_map(|x| {
                [0.008, -0.008].map(|y| (Point3::new(x - 0.009, y, z), Vector3::y() * f64::signum(y)))
            }));
            all.extend(rows(8, 0.002).flat_map(|y| {
                [-0.01, 0.035].map(|x| (Point3::new(x, y - 0.007, z), Vector3::x() * f64::signum(x)))
            }));
        }
        let mut samples = SurfaceSamples::default();
        let table = rows(50, 0.004).flat_map(|x| {
            rows(50, 0.004).map(move |y| (Point3::new(x - 0.1, y - 0.1, -0.001), Vector3::z()))
        });
        for (p, n) in all.into_iter().map(|(p, n)| (pose * p, pose * n)).chain(table) {
            samples.points.push(p);
            samples.normals.push(n);
            samples.colors.push([0.5; 3]);
        }
        let free = move |p: &Point3<f64>| {
            let own = pose.inverse_transform_point(p);
            let in_cap = (0.0..HEIGHT_M).contains(&own.z) && own.x.hypot(own.y) < RADIUS_M;
            p.z > 0.001 && !in_cap && !in_bar(&own)
        };
        (samples, free)
    }

    #[test]
    fn a_bar_shows_how_far_a_cap_turned() {
        let screw =
            Screw { direction: Vector3::z_axis(), point: Point3::origin(), angle_rad: 2.2, advance_m: 0.02 };
        let [(s0, free0), (s1, free1)] = [Pose::identity(), screw.to_motion()].map(cap);
        let pair = SurfacePair::new([&s0, &s1], [Some(&free0), Some(&free1)], 0.008);
        let end = Point3::new(0.035, 0.0, HEIGHT_M);
        for start in [Pose::translation(0.0, 0.0, 0.02), screw.to_motion()] {
            let found = round_turn(&Search::new(&pair, &[Pose::identity()], 0.2), &start).unwrap_or(start);
            let off_m = (found * end - screw.to_motion() * end).norm();
            assert!(off_m < 0.002, "{off_m}");
        }
    }
}
