//! Rules of overlap: at rest, and along the path of every joint.

use nalgebra::{Translation3, UnitQuaternion, Vector3};

use super::{
    Findings,
    description::{Description, JointText},
};
use crate::{geometry::Pose, surface::ConvexSolid};

/// Deeper overlap at rest is an error, metres.
const REST_M: f64 = 1e-5;
/// Deeper overlap along a path is an error, metres.
const SWEEP_M: f64 = 1e-3;
/// Positions along a path.
const STEPS: usize = 60;

pub(super) fn check(description: &Description, solids: &[Vec<ConvexSolid>], found: &mut Findings) {
    let rest: Vec<f64> = description.joints.iter().map(rest_position).collect();
    let poses = poses(description, &rest);
    let count = solids.len();
    for a in 0..count {
        for b in a + 1..count {
            if let Some(depth) = deepest(&solids[a], &poses[a], &solids[b], &poses[b]).filter(|d| *d > REST_M) {
                let pair = format!("{} and {}", description.links[a].name, description.links[b].name);
                let message =
                    format!("overlap by {:.2} mm at rest: MuJoCo throws them apart; cut or shrink the collision solids", 1e3 * depth);
                found.error("overlap", &pair, message);
            }
        }
    }
    for (j, joint) in description.joints.iter().enumerate().filter(|(_, joint)| leader(description, joint).is_none()) {
        sweep(description, solids, j, joint, &rest, found);
    }
}

/// 0, or the limit nearest to it.
fn rest_position(joint: &JointText) -> f64 {
    interval(joint).map_or(0.0, |[lower, upper]| 0f64.clamp(lower, upper))
}

fn interval(joint: &JointText) -> Option<[f64; 2]> {
    let limit = joint.limit.as_ref()?;
    let bounds = [limit.lower.unwrap_or(0.0), limit.upper.unwrap_or(0.0)];
    (["revolute", "prismatic"].contains(&joint.kind.as_str()) && bounds[0] < bounds[1]).then_some(bounds)
}

/// The joint that a joint follows.
fn leader(description: &Description, joint: &JointText) -> Option<usize> {
    let mimic = joint.mimic.as_ref()?;
    description.joints.iter().position(|other| other.name == mimic.joint && other.name != joint.name)
}

/// Poses of all links in the root's frame; joints that follow another one have its position.
fn poses(description: &Description, positions: &[f64]) -> Vec<Pose> {
    let position = |(own, joint): (&f64, &JointText)| match (leader(description, joint), &joint.mimic) {
        (Some(l), Some(mimic)) => mimic.multiplier * positions[l] + mimic.offset,
        _ => *own,
    };
    let positions: Vec<f64> = positions.iter().zip(&description.joints).map(position).collect();
    let positions = &positions;
    (0..description.links.len()).map(|l| pose(description, l, positions, 0)).collect()
}

fn pose(description: &Description, link: usize, positions: &[f64], depth: usize) -> Pose {
    let name = &description.links[link].name;
    let Some(j) = description.joints.iter().position(|j| j.child == *name).filter(|_| depth <= description.links.len()) else {
        return Pose::identity();
    };
    let joint = &description.joints[j];
    let axis = joint.axis.unwrap_or_else(Vector3::x).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    let step = match joint.kind.as_str() {
        "prismatic" => Pose::from_parts(Translation3::from(axis * positions[j]), UnitQuaternion::identity()),
        "fixed" => Pose::identity(),
        _ => Pose::rotation(axis * positions[j]),
    };
    let parent = description.link(&joint.parent).map_or_else(Pose::identity, |p| pose(description, p, positions, depth + 1));
    parent * joint.parent_from_joint * step
}

fn deepest(a: &[ConvexSolid], pose_a: &Pose, b: &[ConvexSolid], pose_b: &Pose) -> Option<f64> {
    let a_from_b = pose_a.inverse() * pose_b;
    let bounds: Vec<_> = a.iter().map(ConvexSolid::bounds).collect();
    let mut worst: Option<f64> = None;
    for solid in b {
        let moved = solid.transformed(&a_from_b);
        let (lo, hi) = moved.bounds();
        for (other, (l, h)) in a.iter().zip(&bounds) {
            if (0..3).all(|k| lo[k] <= h[k] && l[k] <= hi[k]) {
                worst = worst.into_iter().chain(moved.penetration_m(other)).max_by(f64::total_cmp);
            }
        }
    }
    worst
}

/// Moves one joint over its range, the others at rest. The link that is met deepest is told; one that carries the joint
/// before others.
fn sweep(description: &Description, solids: &[Vec<ConvexSolid>], j: usize, joint: &JointText, rest: &[f64], found: &mut Findings) {
    let (Some([lower, upper]), Some(child)) = (interval(joint), description.link(&joint.child)) else { return };
    let followers = description.joints.iter().filter(|f| leader(description, f) == Some(j));
    let carried: Vec<usize> = followers.filter_map(|f| description.link(&f.child)).chain([child]).collect();
    let moved: Vec<bool> = (0..solids.len()).map(|l| carried.iter().any(|&c| hangs_on(description, l, c))).collect();
    let mut worst: Option<(bool, f64, f64, usize)> = None;
    for k in 0..=STEPS {
        let q = lower + (upper - lower) * k as f64 / STEPS as f64;
        let mut positions = rest.to_vec();
        positions[j] = q;
        let poses = poses(description, &positions);
        for a in (0..solids.len()).filter(|&l| moved[l]) {
            for b in (0..solids.len()).filter(|&l| !moved[l]) {
                let depth = deepest(&solids[b], &poses[b], &solids[a], &poses[a]);
                let met = depth.filter(|d| *d > SWEEP_M).map(|d| (carrying(description, solids, a) == Some(b), d, q, b));
                worst = worst.into_iter().chain(met).max_by(|x, y| x.0.cmp(&y.0).then(x.1.total_cmp(&y.1)));
            }
        }
    }
    if let Some((carries, depth, q, link)) = worst {
        let other = &description.links[link].name;
        let message = format!("at position {q:.4} it drives {:.2} mm into {other}: the joint jams; cut what is in the way", 1e3 * depth);
        if joint.threaded {
            let advance = format!("a screw without its advance: at position {q:.4} it drives {:.2} mm into {other}", 1e3 * depth);
            found.warn("sweep", &joint.name, format!("{advance}; `--set export.urdf_screw=pair` writes a slide that follows the turn"));
        // Another link may truly stand in the way, as a closed door before a drawer, or the frame of a folding door.
        } else if carries {
            found.error("sweep", &joint.name, message);
        } else {
            found.warn("sweep", &joint.name, message);
        }
    }
}

/// The nearest link above a link that has solids.
fn carrying(description: &Description, solids: &[Vec<ConvexSolid>], link: usize) -> Option<usize> {
    upwards(description, link).skip(1).find(|&l| !solids[l].is_empty())
}

fn hangs_on(description: &Description, link: usize, above: usize) -> bool {
    upwards(description, link).any(|l| l == above)
}

/// A link and those above it up to the root; ends where the links form a ring.
fn upwards(description: &Description, link: usize) -> impl Iterator<Item = usize> {
    let parent = |l: usize| description.carrier(l).and_then(|j| description.link(&j.parent));
    std::iter::successors(Some(link), move |&l| parent(l)).take(description.links.len() + 1)
}
