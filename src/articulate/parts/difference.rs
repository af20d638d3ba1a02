//! Finds parts and motions in the cheap classical way: the surface found in only one state is cut into as
//! many clusters as parts move, and the iterated closest point moves each to the other state's. Evidence is
//! not weighed, and only inputs without an answer are refused; a baseline for comparisons.

use nalgebra::{Point3, Vector3};

use crate::{
    observations::SurfaceSamples,
    parts::{
        error::RegisterError,
        register::{MotionSupport, Registration, checked_extent_m},
        registrar::LAST_REACH,
    },
};
use geometry::{NearestPoints, Pose, rigid_fit};

/// Largest number of iterations, for closest points and for clusters.
const ROUNDS: usize = 100;
/// The search ends when an iteration moves the part by less than this share of its size.
/// chosen: far below the accuracy of surfaces
const STILL: f64 = 1e-6;

/// Finds the motions of `parts` parts, the static one included, and the part of every surface sample.
///
/// # Errors
/// [`RegisterError`] if a surface has no points or no part moved.
pub fn register_by_difference(
    surfaces: [&SurfaceSamples; 2],
    parts: usize,
) -> Result<Registration, RegisterError> {
    let reach_m = LAST_REACH * checked_extent_m(&surfaces, Some(parts))?;
    let moved = [0, 1].map(|s| in_one_state(&surfaces[s].points, &surfaces[1 - s].points, reach_m));
    let [from, to]: [Vec<Point3<f64>>; 2] =
        [0, 1].map(|s| moved[s].iter().map(|&i| surfaces[s].points[i]).collect());
    if from.len() < parts - 1 || to.is_empty() {
        let all = surfaces[0].points.len();
        let static_percent = 100.0 * (all - from.len()) as f64 / all.max(1) as f64;
        return Err(RegisterError::NoMotion { static_percent });
    }
    let cluster = clusters_of_points(&from, parts - 1);
    let target = NearestPoints::new(&to);
    let mut motions = vec![Pose::identity()];
    for k in 0..parts - 1 {
        let own: Vec<_> = from.iter().zip(&cluster).filter(|(_, c)| **c == k).map(|(p, _)| *p).collect();
        motions.push(closest_points(&own, &to, &target));
    }
    let mut labels = [0, 1].map(|s| vec![0u8; surfaces[s].points.len()]);
    for (&i, &c) in moved[0].iter().zip(&cluster) {
        labels[0][i] = c as u8 + 1;
    }
    // A moved sample of state 1 gets the motion of the nearest sample of state 0.
    let source = NearestPoints::new(&from);
    for &i in &moved[1] {
        let p = &surfaces[1].points[i];
        let gaps_m: Vec<f64> = motions
            .iter()
            .map(|m| source.nearest_one(&(m.inverse() * p)).map_or(f64::INFINITY, |(_, d)| d))
            .collect();
        let best = (1..parts).min_by(|&a, &b| gaps_m[a].total_cmp(&gaps_m[b]));
        labels[1][i] = best.unwrap_or(0) as u8;
    }
    let support = (0..parts).map(|k| {
        let samples = [0, 1].map(|s| labels[s].iter().filter(|l| usize::from(**l) == k).count());
        MotionSupport { samples, ..MotionSupport::default() }
    });
    Ok(Registration {
        support: support.collect(),
        motions,
        labels,
        match_labels: Vec::new(),
        proposals: Vec::new(),
        curve: Vec::new(),
        notes: Vec::new(),
        warnings: Vec::new(),
    })
}

/// Indices of the points farther than `reach_m` from all points of the other state.
fn in_one_state(points: &[Point3<f64>], others: &[Point3<f64>], reach_m: f64) -> Vec<usize> {
    let others = NearestPoints::new(others);
    (0..points.len()).filter(|&i| others.nearest_one(&points[i]).is_none_or(|(_, d)| d > reach_m)).collect()
}

/// The cluster of every point, by `count` means (Lloyd 1982); each starts at the point farthest from the
/// means before it.
fn clusters_of_points(points: &[Point3<f64>], count: usize) -> Vec<usize> {
    let mut means: Vec<Point3<f64>> = mean_point(points.iter()).into_iter().collect();
    while means.len() < count {
        let far = |p: &&Point3<f64>| nearest_mean(&means, p).1;
        let next = points.iter().max_by(|a, b| far(a).total_cmp(&far(b)));
        means.extend(next.copied());
    }
    let mut found: Vec<usize> = Vec::new();
    for _ in 0..ROUNDS {
        let nearest: Vec<usize> = points.iter().map(|p| nearest_mean(&means, p).0).collect();
        let before = std::mem::replace(&mut found, nearest);
        if before == found {
            break;
        }
        for (k, m) in means.iter_mut().enumerate() {
            let own = points.iter().zip(&found).filter(|(_, c)| **c == k).map(|(p, _)| p);
            *m = mean_point(own).unwrap_or(*m);
        }
    }
    found
}

/// Mean of points; `None` for none.
fn mean_point<'a>(points: impl Iterator<Item = &'a Point3<f64>>) -> Option<Point3<f64>> {
    let (sum, n) = points.fold((Vector3::zeros(), 0.0), |(sum, n), p| (sum + p.coords, n + 1.0));
    (n > 0.0).then(|| Point3::from(sum / n))
}

/// Index of the mean nearest to a point, and their squared distance.
fn nearest_mean(means: &[Point3<f64>], p: &Point3<f64>) -> (usize, f64) {
    let distances = means.iter().map(|m| (p - m).norm_squared()).enumerate();
    distances.fold((0, f64::INFINITY), |best, next| if next.1 < best.1 { next } else { best })
}

/// The motion of points found by the iterated closest point (Besl and McKay 1992), from the identity.
fn closest_points(points: &[Point3<f64>], targets: &[Point3<f64>], nearest: &NearestPoints) -> Pose {
    let size_m = points.iter().fold(0.0, |size, p| f64::max(size, (p - points[0]).norm()));
    let mut motion = Pose::identity();
    for _ in 0..ROUNDS {
        let pairs: Vec<_> = points
            .iter()
            .filter_map(|p| nearest.nearest_one(&(motion * p)).map(|(i, _)| (*p, targets[i], 1.0)))
            .collect();
        let Some(next) = rigid_fit(pairs.iter().copied()) else { break };
        let moved_m = points.iter().map(|p| (next * p - motion * p).norm()).fold(0.0, f64::max);
        motion = next;
        if moved_m < STILL * size_m {
            break;
        }
    }
    motion
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plate of 1 m at z = 0, and lids of 0.2 m above it.
    fn surface(lids: &[(Pose, f64)]) -> SurfaceSamples {
        let grid = |n: usize, side: f64| {
            (0..n * n).map(move |i| {
                let at = |k: usize| side * (k as f64 / (n - 1) as f64 - 0.5);
                // A bump, so the lid cannot slide in itself.
                let x = at(i % n);
                let y = at(i / n);
                Point3::new(x, y, 0.3 * (x * x + 3.0 * x * y))
            })
        };
        let plate = grid(60, 1.0).map(|p| Point3::new(p.x, p.y, 0.0));
        let lids = lids.iter().flat_map(|(pose, height)| {
            let lid = grid(30, 0.2).map(move |p| pose * (p + Vector3::z() * *height));
            lid.collect::<Vec<_>>()
        });
        let points: Vec<_> = plate.chain(lids).collect();
        let n = points.len();
        SurfaceSamples { points, normals: vec![Vector3::z(); n], colors: vec![[0.5; 3]; n] }
    }

    #[test]
    fn lifts_of_two_parts_are_found() {
        let rest = [Pose::translation(-0.3, 0.0, 0.0), Pose::translation(0.3, 0.1, 0.0)];
        // Along the surface the iterated closest point hardly moves: a lift, and a lift with a tilt.
        let tilt = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.04);
        let about = rest[1] * Point3::new(0.0, 0.0, 0.2);
        let lift = Vector3::new(0.0, 0.0, 0.025) + about.coords - tilt * about.coords;
        let moves = [Pose::translation(0.0, 0.0, 0.03), Pose::from_parts(lift.into(), tilt)];
        let before = surface(&[(rest[0], 0.2), (rest[1], 0.2)]);
        let after = surface(&[(moves[0] * rest[0], 0.2), (moves[1] * rest[1], 0.2)]);
        let found = register_by_difference([&before, &after], 3).unwrap();
        for (rest, expected) in rest.iter().zip(&moves) {
            let middle = rest * Point3::new(0.0, 0.0, 0.2);
            let off = |m: &Pose| (m * middle - expected * middle).norm();
            let best = found.motions[1..].iter().map(off).fold(f64::INFINITY, f64::min);
            assert!(best < 0.004, "{best}");
        }
        assert!(found.support[0].samples[0] >= 3600 && found.support[1].samples[0] == 900);
        let still = register_by_difference([&before, &before], 2);
        assert!(matches!(still, Err(RegisterError::NoMotion { .. })));
    }
}
