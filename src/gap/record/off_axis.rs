//! The position of a joint from measured poses of its part, and the off-axis part of these poses, impossible
//! for the joint.
//! See docs/method.md (14.2).
//!
//! The twin with its joint at `q` has `joint_from_part = motion(q)`. The remainder `E = joint_from_part *
//! motion(q)^-1` has a rotation and a translation. They are constant for an error of the twin's axis, and
//! rotate with the part for an error of the tracked frame. Perpendicular to the axis both are complex
//! numbers: `a + b exp(i q)` for a revolute joint, `a + b q` for a sliding one.

use nalgebra::{Complex, Matrix2, Matrix3, Matrix3x6, Matrix6, Vector2, Vector3, Vector6};

use crate::{
    record::{
        log::{JointLog, position_noise, rms},
        tracks::{PoseTrack, TrackError, frame_link, moved_link},
    },
    twin_tree::{Motion, TwinJoint, TwinTree},
};
use geometry::{Pose, log_so3, normals_of};

/// Translation and rotation off a joint's motion, root mean square over the samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Across {
    /// Meters.
    pub shift_m: f64,
    /// Radians.
    pub turn_rad: f64,
}

impl Across {
    /// Whether both stay below `factor` times the other's.
    fn is_within(&self, factor: f64, other: &Self) -> bool {
        self.shift_m <= factor * other.shift_m && self.turn_rad <= factor * other.turn_rad
    }
}

/// Suspected cause of the off-axis part of poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Suspect {
    /// None: the joint explains the poses.
    None,
    /// The axis differs from the twin's.
    AxisOffset,
    /// The tracked frame is not the link's frame.
    TrackedFrame,
    /// The part has an additional degree of freedom.
    SecondDof,
    /// The part moves by another type of joint.
    WrongJointType,
}

impl Suspect {
    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::AxisOffset => "axis_offset",
            Self::TrackedFrame => "tracked_frame",
            Self::SecondDof => "second_dof",
            Self::WrongJointType => "wrong_joint_type",
        }
    }
}

/// Evidence about a joint from poses of its part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OffAxis {
    /// Off-axis part of the poses.
    pub measured: Across,
    /// Noise of the poses.
    pub noise: Across,
    /// Off-axis part left with a corrected axis and tracked frame.
    pub left: Across,
    /// Deviation of the axis from the twin's: perpendicular offset and tilt.
    pub axis: Across,
    /// Deviation of the tracked frame from the link's.
    pub mount: Across,
    /// Suspected cause.
    pub suspect: Suspect,
}

/// A deviation below this multiple of the noise is not significant.
/// chosen: three standard deviations.
const NOISES: f64 = 3.0;
/// Least noise: the rounding of the numbers.
/// derived: six decimals, the least number in messages of poses.
const LEAST: Across = Across { shift_m: 1e-6, turn_rad: 1e-6 };
/// Largest share an explanation may leave: of off-axis poses, of the gain of a table over one variable, of
/// noise, of the gap and the windows of held-out runs. An effect explaining less than this beside others is
/// not needed.
/// tuned: tests/python/gap/generate.py.
pub const MAX_LEFT: f64 = 0.12;

/// Positions of a joint, with their evidence.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedJoint {
    /// Stamps, seconds.
    pub time_s: Vec<f64>,
    /// Positions, rad or m.
    pub position: Vec<f64>,
    /// Off-axis evidence.
    pub evidence: OffAxis,
}

/// A joint's positions from tracks of its part, either in a frame of its parent part or with a track of the
/// parent in the same frame. `None` without such a track.
///
/// # Errors
/// [`TrackError`] for links and frames missing in the twin.
pub fn posed_joint(
    tree: &TwinTree,
    joint: usize,
    tracks: &[&PoseTrack],
) -> Result<Option<PosedJoint>, TrackError> {
    let spec = &tree.joints[joint];
    let own = tree.carrying_link(spec.child);
    let base = tree.carrying_link(spec.parent);
    let rest = tree.link_poses(&vec![0.0; tree.joints.len()]);
    // Links fixed to each other move together: a track of any of them is converted to the carrying link.
    let on_carrier = |link: usize| rest[tree.carrying_link(link)].inverse() * rest[link];
    let mut found: Vec<(usize, usize, &PoseTrack, Pose, Pose)> = Vec::new();
    for track in tracks {
        let link = moved_link(tree, &track.topic, &track.link)?;
        let frame = frame_link(tree, &track.topic, &track.frame)?.unwrap_or(tree.root);
        found.push((
            tree.carrying_link(frame),
            tree.carrying_link(link),
            track,
            on_carrier(frame),
            on_carrier(link).inverse(),
        ));
    }
    let base_from_joint = on_carrier(spec.parent) * spec.parent_from_joint;
    let of_part = found.iter().filter(|f| f.1 == own);
    for (frame, _, track, carrier_from_frame, link_from_carrier) in of_part {
        let whole = |pose: &Pose| carrier_from_frame * pose * link_from_carrier;
        // In a frame of the parent part, only the joint lies between.
        if *frame == base {
            let poses: Vec<Pose> = track.pose.iter().map(|p| base_from_joint.inverse() * whole(p)).collect();
            return Ok(posed_positions(spec, &track.time_s, &poses));
        }
        // Else both parts must be tracked in one frame, and the joint is their relative pose.
        let Some(other) = found.iter().find(|o| o.1 == base && o.0 == *frame) else { continue };
        let mut time_s = Vec::new();
        let mut poses = Vec::new();
        for (t, pose) in track.time_s.iter().zip(&track.pose) {
            if let Some(carried) = pose_at(other.2, *t) {
                time_s.push(*t);
                poses.push(base_from_joint.inverse() * (other.3 * carried * other.4).inverse() * whole(pose));
            }
        }
        return Ok(posed_positions(spec, &time_s, &poses));
    }
    Ok(None)
}

/// The pose of a track at a time, interpolated between its samples.
fn pose_at(track: &PoseTrack, t: f64) -> Option<Pose> {
    let next = track.time_s.partition_point(|x| *x < t);
    let b = track.pose.get(next)?;
    let tb = track.time_s[next];
    if tb - t < 1e-9 {
        return Some(*b);
    }
    let a = track.pose.get(next.checked_sub(1)?)?;
    let ta = track.time_s[next - 1];
    a.try_lerp_slerp(b, (t - ta) / (tb - ta), 1e-9)
}

/// Positions and evidence from `joint_from_part` poses; `None` if there are none.
fn posed_positions(joint: &TwinJoint, time_s: &[f64], poses: &[Pose]) -> Option<PosedJoint> {
    let axis = joint.axis.into_inner();
    let mut position: Vec<f64> = Vec::with_capacity(poses.len());
    for p in poses {
        let q = match joint.motion {
            Motion::Fixed => 0.0,
            // The rotation about the axis closest to the pose's rotation.
            Motion::Turn => 2.0 * axis.dot(&p.rotation.imag()).atan2(p.rotation.w),
            Motion::Slide => axis.dot(&p.translation.vector),
        };
        let turns = std::f64::consts::TAU;
        // Unwrapped, so there is no jump by a full turn between samples.
        let near = position
            .last()
            .map_or_else(|| (q / turns).round() * turns, |last| ((q - last) / turns).round() * turns);
        position.push(if joint.motion == Motion::Turn { q - near } else { q });
    }
    let left: Vec<Pose> =
        poses.iter().zip(&position).map(|(p, q)| p * joint.motion_to(*q).inverse()).collect();
    let evidence = off_axis_evidence(joint, time_s, &position, poses, &left)?;
    Some(PosedJoint { time_s: time_s.to_vec(), position, evidence })
}

fn off_axis_evidence(
    joint: &TwinJoint,
    time_s: &[f64],
    position: &[f64],
    poses: &[Pose],
    left: &[Pose],
) -> Option<OffAxis> {
    if left.len() < 2 {
        return None;
    }
    let axis = joint.axis.into_inner();
    let [first, second] = normals_of(&axis);
    let flat = |v: &Vector3<f64>| Complex::new(first.dot(v), second.dot(v));
    let shifts: Vec<Vector3<f64>> = left.iter().map(|e| e.translation.vector).collect();
    let turns: Vec<Vector3<f64>> = left.iter().map(|e| log_so3(&e.rotation)).collect();
    // The basis rotating or translating with the part (14.2).
    let basis: Vec<Complex<f64>> =
        position
            .iter()
            .map(|q| {
                if joint.motion == Motion::Turn {
                    Complex::from_polar(1.0, *q)
                } else {
                    Complex::new(*q, 0.0)
                }
            })
            .collect();
    // Along the axis a translation is the same everywhere.
    let mean_along = shifts.iter().map(|s| axis.dot(s)).sum::<f64>() / shifts.len() as f64;
    let along: Vec<f64> = shifts
        .iter()
        .map(|s| if joint.motion == Motion::Turn { axis.dot(s) - mean_along } else { 0.0 })
        .collect();
    let (shift_still, shift_moving, shift_left) =
        constant_and_moving(&shifts.iter().map(flat).collect::<Vec<_>>(), &basis);
    let mean_about = turns.iter().map(|t| axis.dot(t)).sum::<f64>() / turns.len() as f64;
    let about: Vec<f64> = turns.iter().map(|t| axis.dot(t) - mean_about).collect();
    let (turn_still, turn_moving, turn_left) =
        constant_and_moving(&turns.iter().map(flat).collect::<Vec<_>>(), &basis);
    let whole = |v: &[Vector3<f64>]| rms(&v.iter().map(Vector3::norm).collect::<Vec<_>>());
    let measured = Across { shift_m: whole(&shifts), turn_rad: whole(&turns) };
    let left =
        Across { shift_m: rms(&shift_left).hypot(rms(&along)), turn_rad: rms(&turn_left).hypot(rms(&about)) };
    let noise = Across {
        shift_m: vector_noise(time_s, &shifts).max(LEAST.shift_m),
        turn_rad: vector_noise(time_s, &turns).max(LEAST.turn_rad),
    };
    let (axis, mount) = match joint.motion {
        Motion::Turn => (
            Across { shift_m: shift_still.norm(), turn_rad: turn_still.norm() },
            Across { shift_m: shift_moving.norm().hypot(mean_along), turn_rad: turn_moving.norm() },
        ),
        // A translation growing with the position is a tilt of the axis; a constant one may also come from
        // the tracked frame.
        _ => (
            Across { shift_m: 0.0, turn_rad: shift_moving.norm() },
            Across { shift_m: shift_still.norm(), turn_rad: turn_still.norm() },
        ),
    };
    let mut evidence = OffAxis { measured, noise, left, axis, mount, suspect: Suspect::None };
    evidence.suspect = suspected_cause(joint, position, poses, &evidence);
    Some(evidence)
}

fn suspected_cause(joint: &TwinJoint, position: &[f64], poses: &[Pose], e: &OffAxis) -> Suspect {
    if e.measured.is_within(NOISES, &e.noise) {
        return Suspect::None;
    }
    let ends = (f64::INFINITY, f64::NEG_INFINITY);
    let (low, high) = position.iter().fold(ends, |(l, h), q| (l.min(*q), h.max(*q)));
    let travel = high - low;
    // Neither another axis nor another tracked frame explains these poses.
    if !e.left.is_within(NOISES, &e.noise) && !e.left.is_within(MAX_LEFT, &e.measured) {
        // The type is called wrong only if the other type explains the poses; otherwise there is a second
        // motion.
        let is_other = match joint.motion {
            Motion::Turn => is_still(poses, &e.noise),
            _ => !is_still(poses, &e.noise) && is_one_turn(poses, &e.noise),
        };
        return if is_other { Suspect::WrongJointType } else { Suspect::SecondDof };
    }
    // Significant sizes only: over the travel, the axis error must move the part by more than the noise.
    let moved = if joint.motion == Motion::Turn {
        Across { shift_m: e.axis.shift_m * travel.min(1.0), turn_rad: e.axis.turn_rad * travel.min(1.0) }
    } else {
        Across { shift_m: e.axis.turn_rad * travel, turn_rad: 0.0 }
    };
    if !moved.is_within(NOISES, &e.noise) { Suspect::AxisOffset } else { Suspect::TrackedFrame }
}

/// Whether no pose is rotated against the mean by more than the noise.
fn is_still(poses: &[Pose], noise: &Across) -> bool {
    let first = poses[0].rotation.inverse();
    let turns: Vec<Vector3<f64>> = poses.iter().map(|p| log_so3(&(p.rotation * first))).collect();
    rms_from_mean(&turns) <= NOISES * noise.turn_rad
}

/// Root mean square deviation from the mean.
fn rms_from_mean(values: &[Vector3<f64>]) -> f64 {
    let mean = values.iter().sum::<Vector3<f64>>() / values.len() as f64;
    rms(&values.iter().map(|v| (v - mean).norm()).collect::<Vec<_>>())
}

/// Whether a rotation about one axis explains all poses within the noise: all rotations have one direction,
/// and one point `c` is fixed, so the translations are `a + (1 - rotation) c`.
fn is_one_turn(poses: &[Pose], noise: &Across) -> bool {
    let first = poses[0].rotation.inverse();
    let turns: Vec<Matrix3<f64>> =
        poses.iter().map(|p| (p.rotation * first).to_rotation_matrix().into_inner()).collect();
    let mut normal = Matrix6::zeros();
    let mut right = Vector6::zeros();
    for (turn, pose) in turns.iter().zip(poses) {
        let rows = design_rows(turn);
        normal += rows.transpose() * rows;
        right += rows.transpose() * pose.translation.vector;
    }
    // The point is free along the axis: the shortest solution is taken.
    let Ok(found) = normal.svd(true, true).solve(&right, 1e-9 * normal.norm()) else { return false };
    let lever_m = found.fixed_rows::<3>(3).norm();
    let left: Vec<f64> = turns
        .iter()
        .zip(poses)
        .map(|(turn, pose)| (pose.translation.vector - design_rows(turn) * found).norm())
        .collect();
    let logs: Vec<Vector3<f64>> = poses.iter().map(|p| log_so3(&(p.rotation * first))).collect();
    let scatter: Matrix3<f64> = logs.iter().map(|w| w * w.transpose()).sum();
    // Rotations about one axis scatter along a line; the two smaller eigenvalues measure the deviation.
    let across = {
        let mut spreads: Vec<f64> = scatter.symmetric_eigenvalues().iter().copied().collect();
        spreads.sort_unstable_by(f64::total_cmp);
        ((spreads[0] + spreads[1]).max(0.0) / logs.len() as f64).sqrt()
    };
    // An error of the rotation moves the end of the lever.
    rms(&left) <= NOISES * noise.shift_m.hypot(lever_m * noise.turn_rad) && across <= NOISES * noise.turn_rad
}

/// Derivative of the translation of a rotated pose with respect to (a, c), see [`is_one_turn`].
fn design_rows(turn: &Matrix3<f64>) -> Matrix3x6<f64> {
    let mut rows = Matrix3x6::zeros();
    rows.fixed_columns_mut::<3>(0).copy_from(&Matrix3::identity());
    rows.fixed_columns_mut::<3>(3).copy_from(&(Matrix3::identity() - turn));
    rows
}

/// Least variance of a varying basis, as a share of its mean square.
/// chosen: above rounding, below any motion.
const SPREAD: f64 = 1e-6;

/// Least squares fit of `a + b basis`: returns a, b and the absolute residuals. `b` is 0 if the basis hardly
/// varies.
fn constant_and_moving(
    values: &[Complex<f64>],
    basis: &[Complex<f64>],
) -> (Complex<f64>, Complex<f64>, Vec<f64>) {
    let n = values.len() as f64;
    let (sum_z, sum_b): (Complex<f64>, Complex<f64>) = (values.iter().sum(), basis.iter().sum());
    let (bb, bz) = values
        .iter()
        .zip(basis)
        .fold((0.0, Complex::new(0.0, 0.0)), |(bb, bz), (z, b)| (bb + b.norm_sqr(), bz + b.conj() * z));
    let normal = Matrix2::new(Complex::new(n, 0.0), sum_b, sum_b.conj(), Complex::new(bb, 0.0));
    let is_spread = n * bb - sum_b.norm_sqr() > SPREAD * n * bb;
    let solved = is_spread.then(|| normal.try_inverse()).flatten().map(|i| i * Vector2::new(sum_z, bz));
    let [a, b] = solved.map_or_else(|| [sum_z / n, Complex::new(0.0, 0.0)], |s| [s[0], s[1]]);
    (a, b, values.iter().zip(basis).map(|(z, x)| (z - a - b * x).norm()).collect())
}

/// White noise of vectors: the root of the summed variances.
fn vector_noise(time_s: &[f64], values: &[Vector3<f64>]) -> f64 {
    let mut variance = 0.0;
    for i in 0..3 {
        let position = values.iter().map(|v| v[i]).collect();
        let log = JointLog { time_s: time_s.to_vec(), position, ..JointLog::default() };
        variance += position_noise(&[log]).powi(2);
    }
    f64::sqrt(variance)
}

impl OffAxis {
    /// Largest off-axis deviation of the poses, as a multiple of the noise.
    #[must_use]
    pub fn largest_excess(&self) -> f64 {
        (self.measured.shift_m / self.noise.shift_m).max(self.measured.turn_rad / self.noise.turn_rad)
    }

    /// The evidence in words.
    #[must_use]
    pub fn in_words(&self) -> String {
        let say = |a: &Across| format!("{:.2} mm and {:.2} deg", 1e3 * a.shift_m, a.turn_rad.to_degrees());
        let measured =
            format!("the poses leave the joint by {} (noise {})", say(&self.measured), say(&self.noise));
        match self.suspect {
            Suspect::None => format!(
                "the poses stay on the joint: {} off it, noise {}",
                say(&self.measured),
                say(&self.noise)
            ),
            Suspect::AxisOffset => {
                format!("{measured}: the axis stands {} from the twin's (axis_offset)", say(&self.axis))
            }
            Suspect::TrackedFrame => {
                format!("{measured}: the tracked frame stands {} from the link's", say(&self.mount))
            }
            Suspect::SecondDof => format!(
                "{measured}, {} of it by no axis: the part moves in a further way (second_dof)",
                say(&self.left)
            ),
            Suspect::WrongJointType => {
                format!(
                    "{measured}, {} of it by no axis: the joint is of another type (wrong_joint_type)",
                    say(&self.left)
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Unit;

    use super::*;

    fn joint(motion: Motion) -> TwinJoint {
        TwinJoint {
            name: "j".into(),
            motion,
            parent: 0,
            child: 1,
            parent_from_joint: Pose::identity(),
            axis: Unit::new_normalize(Vector3::new(0.2, -0.3, 1.0)),
            damping: 0.0,
            friction: 0.0,
            limit: None,
            mimic: None,
            is_free: false,
        }
    }

    fn noisy(k: usize, i: usize) -> f64 {
        ((k * 7919 + i * 104_729) % 1009) as f64 / 1009.0 - 0.5
    }

    /// Poses over a sweep by 1.2 rad or m, with noise of about 0.1 mm and 0.1 mrad.
    fn sweep(pose: impl Fn(f64) -> Pose) -> (Vec<f64>, Vec<Pose>) {
        let time_s: Vec<f64> = (0..400).map(|k| 0.01 * f64::from(k)).collect();
        let one = |k: usize| {
            let q = 0.6 * (1.0 - (0.02 * k as f64).cos());
            let shake = |i: usize| 2e-4 * noisy(k, i);
            let noise = Pose::new(
                Vector3::new(shake(1), shake(2), shake(3)),
                Vector3::new(shake(4), shake(5), shake(6)),
            );
            noise * pose(q)
        };
        (time_s, (0..400).map(one).collect())
    }

    fn suspected(joint: &TwinJoint, pose: impl Fn(f64) -> Pose) -> PosedJoint {
        let (time_s, poses) = sweep(pose);
        posed_positions(joint, &time_s, &poses).unwrap()
    }

    #[test]
    fn what_the_joint_makes_has_its_position_and_no_suspect() {
        for motion in [Motion::Turn, Motion::Slide] {
            let joint = joint(motion);
            let posed = suspected(&joint, |q| joint.motion_to(q));
            assert_eq!(posed.evidence.suspect, Suspect::None, "{:?}", posed.evidence);
            let worst = posed
                .position
                .iter()
                .enumerate()
                .map(|(k, p)| (p - 0.6 * (1.0 - (0.02 * k as f64).cos())).abs())
                .fold(0.0, f64::max);
            assert!(worst < 5e-4, "{worst}");
        }
    }

    #[test]
    fn an_axis_a_mount_and_another_motion_are_distinguished() {
        let turn = joint(Motion::Turn);
        let slide = joint(Motion::Slide);
        let across = turn.axis.cross(&Vector3::x()).normalize();
        // The axis a centimeter off and tilted by 2 degrees, the part where the twin has it at zero.
        let off = Pose::new(0.01 * across, 0.035 * across);
        let axis = suspected(&turn, |q| off * turn.motion_to(q) * off.inverse()).evidence;
        assert_eq!(axis.suspect, Suspect::AxisOffset, "{axis:?}");
        assert!(
            (axis.axis.shift_m - 0.01).abs() < 1e-3 && (axis.axis.turn_rad - 0.035).abs() < 2e-3,
            "{axis:?}"
        );
        assert!(axis.in_words().contains("axis_offset"));
        let mount = suspected(&turn, |q| turn.motion_to(q) * off).evidence;
        assert_eq!(mount.suspect, Suspect::TrackedFrame, "{mount:?}");
        assert!((mount.mount.shift_m - 0.01).abs() < 1e-3, "{mount:?}");
        let tilt = suspected(&slide, |q| off * slide.motion_to(q) * off.inverse()).evidence;
        assert_eq!(tilt.suspect, Suspect::AxisOffset, "{tilt:?}");
        assert!((tilt.axis.turn_rad - 0.035).abs() < 2e-3, "{tilt:?}");
        let further = suspected(&turn, |q| {
            Pose::new(0.02 * (9.0 * q).sin() * across, Vector3::zeros()) * turn.motion_to(q)
        })
        .evidence;
        assert_eq!(further.suspect, Suspect::SecondDof, "{further:?}");
        let slides = suspected(&turn, |q| slide.motion_to(q)).evidence;
        assert_eq!(slides.suspect, Suspect::WrongJointType, "{slides:?}");
        let turns = suspected(&slide, |q| off * turn.motion_to(q)).evidence;
        assert_eq!(turns.suspect, Suspect::WrongJointType, "{turns:?}");
        // A part that rocks widely on its slide turns about no one axis.
        let rocks = suspected(&slide, |q| {
            Pose::new(Vector3::zeros(), 0.4 * (9.0 * q).sin() * across) * slide.motion_to(q)
        });
        assert_eq!(rocks.evidence.suspect, Suspect::SecondDof, "{:?}", rocks.evidence);
    }

    /// What is distinguished depends on the noise, not on an angle.
    #[test]
    fn a_travel_of_a_tenth_of_a_radian_shows_an_axis_and_a_type() {
        let turn = joint(Motion::Turn);
        let slide = joint(Motion::Slide);
        let across = turn.axis.cross(&Vector3::x()).normalize();
        let off = Pose::new(0.02 * across, Vector3::zeros());
        let short = |q: f64| off * turn.motion_to(0.08 * q) * off.inverse();
        assert_eq!(suspected(&turn, short).evidence.suspect, Suspect::AxisOffset);
        // A hinge of little travel where the twin has a slide.
        let arc = Pose::new(0.5 * across, Vector3::zeros());
        let hinge = |q: f64| arc * turn.motion_to(0.08 * q) * arc.inverse();
        assert_eq!(suspected(&slide, hinge).evidence.suspect, Suspect::WrongJointType);
    }
}
