//! One joint of a chain, with the others moving as recorded: their effect on its inertia and load.
//!
//! From `M(q) a + h(q, v) = u`, the row of joint `j` reads `I a_j + dI/dt v_j + load(q_j) = u_j - friction`.
//! `I` is the diagonal of the mass matrix and does not depend on `q_j`. The load holds gravity and the
//! accelerations, Coriolis and centrifugal efforts of the other joints; it is a trigonometric polynomial of
//! second order in the angle of a revolute joint, and linear in the position of a sliding one.

use nalgebra::DVector;

use crate::{
    record::{
        carried::Carried,
        command::{EffortUnit, Told},
        drive::Hold,
        jitter::reading_noise,
        log::JointLog,
        motion::SmoothMotion,
        recording::{Recording, RecordingError},
    },
    twin_tree::{Motion, TwinTree},
};

/// Time step for the rate of an inertia, seconds.
/// chosen: the error of a central difference is its square, plus rounding divided by it: both below 1e-8.
const RATE_STEP_S: f64 = 1e-4;

/// Effects of the joints `others` on a joint, from each stamp to the next.
#[must_use]
pub fn carried_by_stamp(
    tree: &TwinTree,
    joint: usize,
    others: &[(usize, SmoothMotion)],
    stamps: &[f64],
) -> Vec<Carried> {
    let n = tree.joints.len();
    let zero = vec![0.0; n];
    let mut unit = zero.clone();
    unit[joint] = 1.0;
    // With unit acceleration of this joint alone: the diagonal of the mass matrix.
    let inertia = |position: &[f64]| tree.inverse_dynamics(position, &zero, &unit, false)[joint];
    let mut all = Vec::with_capacity(stamps.len());
    // Values apply from stamp to stamp, so they are evaluated halfway.
    for (from, to) in stamps.iter().zip(stamps.iter().skip(1).chain(stamps.last())) {
        let mut q = zero.clone();
        let mut v = zero.clone();
        let mut a = zero.clone();
        for (o, motion) in others {
            let state = motion.state_at(0.5 * (from + to));
            (q[*o], v[*o], a[*o]) = (state[0], state[1], state[2]);
        }
        let moved = |by: f64| -> Vec<f64> { q.iter().zip(&v).map(|(q, v)| q + by * v).collect() };
        let inertia_rate =
            (inertia(&moved(RATE_STEP_S)) - inertia(&moved(-RATE_STEP_S))) / (2.0 * RATE_STEP_S);
        all.push(Carried { inertia: inertia(&q), inertia_rate, load: load_factors(tree, joint, q, &v, &a) });
    }
    all
}

/// Factors of a joint's load ([`Carried::load`]) under the motion of all others; `q`, `v`, `a` by joint.
fn load_factors(tree: &TwinTree, joint: usize, mut q: Vec<f64>, v: &[f64], a: &[f64]) -> [f64; 6] {
    let mut load_at = |own: f64| load_at_position(tree, joint, own, &mut q, v, a);
    match tree.joints[joint].motion {
        Motion::Turn => load_harmonics(load_at),
        Motion::Slide | Motion::Fixed => {
            let at_zero = load_at(0.0);
            let at_one = load_at(1.0);
            [at_zero, at_one - at_zero, 0.0, 0.0, 0.0, 0.0]
        }
    }
}

/// Load of a joint with its own position set to `own`, N m or N.
fn load_at_position(tree: &TwinTree, joint: usize, own: f64, q: &mut [f64], v: &[f64], a: &[f64]) -> f64 {
    q[joint] = own;
    tree.inverse_dynamics(q, v, a, true)[joint]
}

/// Fits a trigonometric polynomial of second order through five angles.
fn load_harmonics(mut load_at: impl FnMut(f64) -> f64) -> [f64; 6] {
    let mut load = [0.0; 6];
    for i in 0..5 {
        // derived: five angles.
        let angle = std::f64::consts::TAU * f64::from(i) / 5.0;
        let value = load_at(angle);
        let (s, c) = angle.sin_cos();
        let (ss, cc) = (2.0 * angle).sin_cos();
        // derived: over five equal angles the five terms are orthogonal, so plain sums solve for them.
        load[0] += value / 5.0;
        for (place, factor) in [(2, s), (3, c), (4, ss), (5, cc)] {
            // derived: two fifths, as a square is a half in the mean.
            load[place] += 0.4 * value * factor;
        }
    }
    load
}

/// Motion of each of the `joints` over a run. If all of them have efforts at the same stamps, accelerations
/// are those of the twin under these efforts, following them without lag, plus a smooth remainder.
///
/// # Errors
/// [`RecordingError`] if the run has no position of one of them.
pub fn joint_motions(
    tree: &TwinTree,
    joints: &[usize],
    run: &Recording,
    hold: Hold,
    told: &Told,
) -> Result<Vec<(usize, SmoothMotion)>, RecordingError> {
    let name = |j: &usize| tree.joints[*j].name.as_str();
    let free = joints.iter().map(|j| run.motion(name(j)).map(|m| (*j, m))).collect::<Result<Vec<_>, _>>()?;
    let logs: Option<Vec<JointLog>> =
        joints.iter().map(|j| run.joint(name(j), &[], told, &mut Vec::new()).ok()).collect();
    // Without efforts, or with different stamps, there is no common acceleration; then only the positions are
    // used.
    let logs = logs.filter(|logs| {
        let is_usable = |l: &JointLog| l.time_s == logs[0].time_s && l.commanded.is_empty();
        told.unit != EffortUnit::Unknown && logs.iter().all(is_usable)
    });
    let Some(logs) = logs else { return Ok(free) };
    let expected = expected_accelerations(tree, &free, &logs, hold);
    let mut motions = Vec::with_capacity(joints.len());
    for ((j, log), expected) in joints.iter().zip(&logs).zip(&expected) {
        let noise = reading_noise(std::slice::from_ref(log));
        motions.push((*j, SmoothMotion::of_positions(&log.time_s, &log.position, &noise, expected)));
    }
    Ok(motions)
}

/// Accelerations of the twin from each stamp to the next, by joint.
fn expected_accelerations(
    tree: &TwinTree,
    motions: &[(usize, SmoothMotion)],
    logs: &[JointLog],
    hold: Hold,
) -> Vec<Vec<f64>> {
    let n = tree.joints.len();
    let time_s = &logs[0].time_s;
    let zero = vec![0.0; n];
    let mut expected = vec![Vec::with_capacity(time_s.len()); motions.len()];
    for k in 0..time_s.len() {
        let next = (k + 1).min(time_s.len() - 1);
        let mut q = zero.clone();
        let mut v = zero.clone();
        for (j, motion) in motions {
            let state = motion.state_at(0.5 * (time_s[k] + time_s[next]));
            (q[*j], v[*j]) = (state[0], state[1]);
        }
        // M a = u - h - damping - friction, at the motion from the positions.
        let bias = tree.inverse_dynamics(&q, &v, &zero, true);
        let whole = tree.mass_matrix(&q);
        // Rows of fixed joints are zero, so the full matrix would be singular.
        let mass = nalgebra::DMatrix::from_fn(motions.len(), motions.len(), |a, b| {
            whole[(motions[a].0, motions[b].0)]
        });
        let push = DVector::from_fn(motions.len(), |a, _| {
            let j = motions[a].0;
            let log = &logs[a];
            let effort = match hold {
                Hold::Zero => log.effort[k],
                Hold::Sampled => 0.5 * (log.effort[k] + log.effort[next]),
            };
            let joint = &tree.joints[j];
            effort - bias[j] - joint.damping * v[j] - joint.friction * v[j].signum()
        });
        let acceleration = mass.cholesky().map_or_else(|| DVector::zeros(motions.len()), |m| m.solve(&push));
        for (own, a) in expected.iter_mut().zip(acceleration.iter()) {
            own.push(*a);
        }
    }
    expected
}
