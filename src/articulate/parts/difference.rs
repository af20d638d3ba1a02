//! Parts and motions the cheap classical way: the surface that is in one state only is cut into as many
//! clusters as parts move, and each is carried to the other state's by the iterated closest point. Nothing is
//! weighed and nothing refused but what has no answer; a baseline for the tables of trials.

use nalgebra::{Point3, Vector3};

use crate::{
    observations::SurfaceSamples,
    parts::{
        config::RegisterConfig,
        error::RegisterError,
        register::{MotionSupport, Registration, checked_extent_m},
    },
};
use geometry::{NearestPoints, Pose, rigid_fit};

/// Most rounds of closest points, and of clusters.
const ROUNDS: usize = 100;
/// A round that moves a part by less than this share of its size ends the search.
/// chosen: far below what surfaces are measured to.
const STILL: f64 = 1e-6;

/// Finds the motions of `parts` parts, the static one included, and the part of every surface sample.
///
/// # Errors
/// [`RegisterError`]: a surface without points, or nothing that moved.
pub fn register_by_difference(
    surfaces: [&SurfaceSamples; 2],
    parts: usize,
    config: &RegisterConfig,
) -> Result<Registration, RegisterError> {
    let reach_m = config.last_reach * checked_extent_m(&surfaces, Some(parts))?;
    let moved = [0, 1].map(|s| in_one_state(&surfaces[s].points, &surfaces[1 - s].points, reach_m));
    let points = |s: usize| moved[s].iter().map(|&i| surfaces[s].points[i]).collect::<Vec<_>>();
    let from = points(0);
    let to = points(1);
    if from.len() < parts - 1 || to.is_empty() {
        let all = surfaces[0].points.len();
        let static_percent = 100.0 * (all - from.len()) as f64 / all.max(1) as f64;
        return Err(RegisterError::NoMotion { static_percent });
    }
    let cluster = clusters(&from, parts - 1);
    let target = NearestPoints::new(&to);
    let motion = |k: usize| {
        let own: Vec<_> = from.iter().zip(&cluster).filter(|(_, c)| **c == k).map(|(p, _)| *p).collect();
        closest_points(&own, &to, &target)
    };
    let motions: Vec<Pose> = std::iter::once(Pose::identity()).chain((0..parts - 1).map(motion)).collect();
    let mut labels = [0, 1].map(|s| vec![0u8; surfaces[s].points.len()]);
    for (&i, &c) in moved[0].iter().zip(&cluster) {
        labels[0][i] = c as u8 + 1;
    }
    // A moved sample of state 1 belongs to the motion that brings one of state 0 nearest to it.
    let source = NearestPoints::new(&from);
    let gap_m = |p: &Point3<f64>, k: usize| {
        source.nearest(&(motions[k].inverse() * p)).map_or(f64::INFINITY, |(_, d)| d)
    };
    for &i in &moved[1] {
        let p = &surfaces[1].points[i];
        let best = (1..parts).min_by(|&a, &b| gap_m(p, a).total_cmp(&gap_m(p, b)));
        labels[1][i] = best.unwrap_or(0) as u8;
    }
    let support = (0..parts).map(|k| {
        let count = |s: usize| labels[s].iter().filter(|l| usize::from(**l) == k).count();
        MotionSupport { samples: [count(0), count(1)], ..MotionSupport::default() }
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

/// The points farther than `reach_m` from all of the other state's.
fn in_one_state(points: &[Point3<f64>], others: &[Point3<f64>], reach_m: f64) -> Vec<usize> {
    let others = NearestPoints::new(others);
    let is_far = |p: &Point3<f64>| others.nearest(p).is_none_or(|(_, d)| d > reach_m);
    (0..points.len()).filter(|&i| is_far(&points[i])).collect()
}

/// The cluster of every point: means of `count` clusters (Lloyd 1982), each started from the point farthest
/// from the means before it.
fn clusters(points: &[Point3<f64>], count: usize) -> Vec<usize> {
    let mean = |own: &mut dyn Iterator<Item = &Point3<f64>>| -> Option<Point3<f64>> {
        let (sum, n) = own.fold((Vector3::zeros(), 0.0), |(sum, n), p| (sum + p.coords, n + 1.0));
        (n > 0.0).then(|| Point3::from(sum / n))
    };
    let mut means: Vec<Point3<f64>> = mean(&mut points.iter()).into_iter().collect();
    let nearest = |means: &[Point3<f64>], p: &Point3<f64>| -> (usize, f64) {
        let distances = means.iter().map(|m| (p - m).norm_squared()).enumerate();
        distances.fold((0, f64::INFINITY), |best, next| if next.1 < best.1 { next } else { best })
    };
    while means.len() < count {
        let far = |p: &&Point3<f64>| nearest(&means, p).1;
        let next = points.iter().max_by(|a, b| far(a).total_cmp(&far(b)));
        means.extend(next.copied());
    }
    let mut found: Vec<usize> = Vec::new();
    for _ in 0..ROUNDS {
        let before = std::mem::replace(&mut found, points.iter().map(|p| nearest(&means, p).0).collect());
        if before == found {
            break;
        }
        for (k, m) in means.iter_mut().enumerate() {
            let mut own = points.iter().zip(&found).filter(|(_, c)| **c == k).map(|(p, _)| p);
            *m = mean(&mut own).unwrap_or(*m);
        }
    }
    found
}

/// The motion of points by the iterated closest point (Besl and McKay 1992), from the identity.
fn closest_points(points: &[Point3<f64>], targets: &[Point3<f64>], nearest: &NearestPoints) -> Pose {
    let size_m = points.iter().fold(0.0, |size, p| f64::max(size, (p - points[0]).norm()));
    let mut motion = Pose::identity();
    for _ in 0..ROUNDS {
        let pair = |p: &Point3<f64>| nearest.nearest(&(motion * p)).map(|(i, _)| (*p, targets[i], 1.0));
        let pairs: Vec<_> = points.iter().filter_map(pair).collect();
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
                // A bump, so that the lid cannot slide in itself.
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
        let found = register_by_difference([&before, &after], 3, &RegisterConfig::default()).unwrap();
        for (rest, expected) in rest.iter().zip(&moves) {
            let middle = rest * Point3::new(0.0, 0.0, 0.2);
            let off = |m: &Pose| (m * middle - expected * middle).norm();
            let best = found.motions[1..].iter().map(off).fold(f64::INFINITY, f64::min);
            assert!(best < 0.004, "{best}");
        }
        assert!(found.support[0].samples[0] >= 3600 && found.support[1].samples[0] == 900);
        let still = register_by_difference([&before, &before], 2, &RegisterConfig::default());
        assert!(matches!(still, Err(RegisterError::NoMotion { .. })));
    }
}
