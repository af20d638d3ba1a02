//! How the frame of recorded poses stands to the camera, and how their lengths relate to those of depth, by
//! what the camera sees between its images.
//!
//! With `B` the motion of the posed frame between two images and `M` that of the camera by the images, the
//! pose `X` of the camera in the posed frame holds `B X = X M` (hand-eye calibration: Tsai and Lenz 1989).
//! Frames of a camera's body, of its optics and of graphics differ by quarter turns (REP 103, OpenGL), so the
//! rotation is one of the 24 that take axes to axes; the position and the ratio of lengths follow by least
//! squares. See docs/method.md (2.2).

use nalgebra::{Matrix3, Matrix4, Rotation3, UnitQuaternion, Vector3, Vector4};

use geometry::Pose;
use numeric::statistics::median;

/// Motions by the images with a smaller turn and a smaller way, radians and share of the depth, say nothing
/// of the mounting. chosen: about five deviations of a motion by landmarks
const LEAST_TURN_RAD: f64 = 0.015;
const LEAST_WAY_SHARE: f64 = 0.01;
/// Largest difference of two motions that agree: of the turn, radians and as its share, and of the way, as
/// a share of it and of the depth.
/// chosen: about twice the error of a motion by images, where a wrong mounting is off by the motion itself
const TURN_RAD: f64 = 0.01;
const TURN_SHARE: f64 = 0.1;
const WAY_SHARE: f64 = 0.15;
const WAY_DEPTH_SHARE: f64 = 0.01;
/// Fewest motions that tell. chosen: fewer are agreed with by chance
const LEAST_MOTIONS: usize = 4;
/// Expected distance between a camera and the frame that its poses are of, meters.
/// chosen: the size of a hand and of a camera's housing
const ARM_M: f64 = 0.1;
/// Rounds of fitting without the motions that disagree.
const ROUNDS: usize = 4;

/// A motion of the camera between two images, by them and by recorded poses.
#[derive(Clone, Copy, Debug)]
pub struct MotionPair {
    /// The first camera in the second one, by the images, lengths by depth.
    pub by_images: Pose,
    /// The first posed frame in the second one, lengths of the poses.
    pub by_poses: Pose,
    /// Median depth of the images, lengths by depth.
    pub depth: f64,
}

/// How a camera stands in the frame that its poses are of.
#[derive(Clone, Copy, Debug)]
pub struct Mounting {
    /// Pose of the camera in the posed frame, lengths of the poses.
    pub posed_from_camera: Pose,
    /// Ratio of lengths of the poses to those of depth.
    pub scale: f64,
    /// Share of the motions that agree.
    pub share: f64,
    /// Number of motions that tell.
    pub motions: usize,
}

impl Mounting {
    /// The mounting of poses that are the camera's own, but for the lengths; `None` where too little moves.
    #[must_use]
    pub fn of_camera(pairs: &[MotionPair]) -> Option<Self> {
        Self::turned(&telling(pairs), &UnitQuaternion::identity(), false, None)
    }

    /// The mounting that most motions agree with; `None` where too little moves.
    #[must_use]
    pub fn best(pairs: &[MotionPair]) -> Option<Self> {
        let telling = telling(pairs);
        let mut best: Option<Self> = None;
        for turn in quarter_turns() {
            let found = Self::turned(&telling, &turn, true, None);
            best = found.filter(|m| best.as_ref().is_none_or(|b| m.is_better_than(b))).or(best);
        }
        best
    }

    /// Whether more motions agree with this one; of equals, the one with the smaller arm is the simpler
    /// explanation.
    fn is_better_than(&self, other: &Self) -> bool {
        let arm_m = |m: &Self| m.posed_from_camera.translation.vector.norm();
        self.share > other.share || (self.share == other.share && arm_m(self) < arm_m(other))
    }

    /// The same mounting where the ratio of lengths is known.
    #[must_use]
    pub fn at_scale(&self, pairs: &[MotionPair], scale: f64) -> Option<Self> {
        Self::turned(&telling(pairs), &self.posed_from_camera.rotation, true, Some(scale))
    }

    fn turned(
        pairs: &[MotionPair],
        turn: &UnitQuaternion<f64>,
        has_arm: bool,
        known_scale: Option<f64>,
    ) -> Option<Self> {
        (pairs.len() >= LEAST_MOTIONS).then_some(())?;
        // Turns do not depend on the arm or the lengths.
        let turning: Vec<&MotionPair> = pairs.iter().filter(|p| turns_alike(p, turn)).collect();
        let mut used: Vec<&MotionPair> = turning.clone();
        let mut arm = Vector3::zeros();
        let mut scale = known_scale.or_else(|| median_ratio_of_ways(&used))?;
        for _ in 0..ROUNDS {
            (arm, scale) = match known_scale {
                Some(known) => (arm_at_scale(&used, turn, known)?, known),
                None => fitted(&used, turn, has_arm, scale)?,
            };
            used = turning.iter().copied().filter(|p| is_on_way(p, turn, &arm, scale)).collect();
            if used.is_empty() {
                break;
            }
        }
        (scale > 0.0).then(|| Self {
            posed_from_camera: Pose::from_parts(arm.into(), *turn),
            scale,
            share: used.len() as f64 / pairs.len() as f64,
            motions: pairs.len(),
        })
    }
}

/// The motions by the images that are more than their errors.
fn telling(pairs: &[MotionPair]) -> Vec<MotionPair> {
    pairs.iter().filter(|p| exceeds_errors(p)).copied().collect()
}

fn exceeds_errors(pair: &MotionPair) -> bool {
    pair.by_images.rotation.angle() > LEAST_TURN_RAD
        || pair.by_images.translation.vector.norm() > LEAST_WAY_SHARE * pair.depth
}

fn turns_alike(pair: &MotionPair, turn: &UnitQuaternion<f64>) -> bool {
    let expected = turn * pair.by_images.rotation * turn.inverse();
    let off = expected.angle_to(&pair.by_poses.rotation);
    off <= TURN_RAD.max(TURN_SHARE * pair.by_images.rotation.angle())
}

/// How far the way of the poses is from the expected one.
fn off_way(pair: &MotionPair, turn: &UnitQuaternion<f64>, arm: &Vector3<f64>, scale: f64) -> f64 {
    let by_poses = pair.by_poses.rotation * arm + pair.by_poses.translation.vector;
    let by_images = turn * pair.by_images.translation.vector * scale + arm;
    (by_poses - by_images).norm()
}

fn is_on_way(pair: &MotionPair, turn: &UnitQuaternion<f64>, arm: &Vector3<f64>, scale: f64) -> bool {
    let way = pair.by_images.translation.vector.norm() * scale;
    off_way(pair, turn, arm, scale) <= (WAY_SHARE * way).max(WAY_DEPTH_SHARE * pair.depth * scale)
}

/// Position of the camera in the posed frame by least squares, where the ratio of lengths is known: a camera
/// that circles a thing shows an arm along its axis apart from that ratio by nothing else.
fn arm_at_scale(pairs: &[&MotionPair], turn: &UnitQuaternion<f64>, scale: f64) -> Option<Vector3<f64>> {
    let mut normal = Matrix3::identity() * ARM_M.powi(-2);
    let mut right = Vector3::zeros();
    for pair in pairs {
        let by_arm = Matrix3::identity() - pair.by_poses.rotation.to_rotation_matrix().into_inner();
        let left_over = pair.by_poses.translation.vector - turn * pair.by_images.translation.vector * scale;
        let weight = (WAY_DEPTH_SHARE * pair.depth * scale).powi(-2);
        normal += by_arm.transpose() * by_arm * weight;
        right += by_arm.transpose() * left_over * weight;
    }
    Some(normal.cholesky()?.solve(&right))
}

/// Median ratio of the ways by poses to those by images; `None` without a way.
fn median_ratio_of_ways(pairs: &[&MotionPair]) -> Option<f64> {
    let way = |pose: &Pose| pose.translation.vector.norm();
    let ratios = pairs.iter().map(|p| way(&p.by_poses) / way(&p.by_images).max(1e-9));
    median(ratios.collect()).filter(|ratio| *ratio > 0.0)
}

/// Position of the camera in the posed frame and ratio of lengths by least squares:
/// `(1 - R_B) arm + scale R_X t_M = t_B`.
fn fitted(
    pairs: &[&MotionPair],
    turn: &UnitQuaternion<f64>,
    has_arm: bool,
    scale: f64,
) -> Option<(Vector3<f64>, f64)> {
    let mut normal = Matrix4::zeros();
    let mut right = Vector4::zeros();
    for pair in pairs {
        let by_arm = Matrix3::identity() - pair.by_poses.rotation.to_rotation_matrix().into_inner();
        let by_scale = turn * pair.by_images.translation.vector;
        // Errors are a share of the depth, in lengths of the poses.
        let weight = (WAY_DEPTH_SHARE * pair.depth * scale).powi(-2);
        for k in 0..3 {
            let row = Vector4::new(by_arm[(k, 0)], by_arm[(k, 1)], by_arm[(k, 2)], by_scale[k]);
            normal += row * row.transpose() * weight;
            right += row * pair.by_poses.translation.vector[k] * weight;
        }
    }
    for k in 0..3 {
        // Without an arm it is held at zero.
        normal[(k, k)] += if has_arm { ARM_M.powi(-2) } else { 1e12 };
    }
    let found = normal.cholesky()?.solve(&right);
    Some((found.xyz(), found.w))
}

/// The 24 rotations that take axes to axes, the one that changes nothing first.
fn quarter_turns() -> Vec<UnitQuaternion<f64>> {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let signed: Vec<Vector3<f64>> = axes.iter().flat_map(|a| [*a, -a]).collect();
    let mut turns = Vec::new();
    for x in &signed {
        for y in signed.iter().filter(|y| y.dot(x) == 0.0) {
            let columns = Matrix3::from_columns(&[*x, *y, x.cross(y)]);
            turns.push(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns)));
        }
    }
    turns
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Motions of a camera about a thing, and of a frame in which it is mounted.
    fn pairs(posed_from_camera: &Pose, scale: f64) -> Vec<MotionPair> {
        let camera = |k: usize| {
            let a = 0.13 * k as f64;
            let eye = nalgebra::Point3::new(0.9 * a.cos(), 0.8 * a.sin(), 0.4 + 0.1 * (2.0 * a).sin());
            Pose::face_towards(&eye, &nalgebra::Point3::origin(), &Vector3::new(0.1 * a, 0.0, 1.0))
        };
        let posed = |k: usize| camera(k) * posed_from_camera.inverse();
        let pair = |k: usize| {
            let mut by_images = camera(k + 1).inverse() * camera(k);
            by_images.translation.vector /= scale;
            MotionPair { by_images, by_poses: posed(k + 1).inverse() * posed(k), depth: 1.0 / scale }
        };
        (0..9).map(pair).collect()
    }

    #[test]
    fn the_turn_of_a_body_its_arm_and_the_lengths_are_found() {
        assert_eq!(quarter_turns().len(), 24);
        assert_eq!(quarter_turns()[0], UnitQuaternion::identity());
        // REP 103: x ahead, y left, z up.
        let columns = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        let body = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns));
        let mounted = Pose::from_parts(Vector3::new(0.02, 0.015, -0.03).into(), body);
        for scale in [1.0, 0.2] {
            let pairs = pairs(&mounted, scale);
            let own = Mounting::of_camera(&pairs);
            assert!(own.is_none_or(|m| m.share < 0.3), "{own:?}");
            let found = Mounting::best(&pairs).unwrap();
            assert!(
                found.share == 1.0 && found.posed_from_camera.rotation.angle_to(&body) < 1e-9,
                "{found:?}"
            );
            assert!((found.scale / scale - 1.0).abs() < 0.05, "{found:?}");
        }
        let pairs = pairs(&mounted, 1.0);
        let found = Mounting::best(&pairs).unwrap().at_scale(&pairs, 1.0).unwrap().posed_from_camera;
        // An arm along the axis of all turns moves the world alone: motions are compared.
        for pair in &pairs {
            let motion = found.inverse() * pair.by_poses * found;
            let off_m = (motion.translation.vector - pair.by_images.translation.vector).norm();
            assert!(off_m < 0.001, "{off_m}");
        }
    }

    #[test]
    fn poses_of_the_camera_itself_are_told_and_a_camera_at_rest_tells_nothing() {
        let own = Mounting::of_camera(&pairs(&Pose::identity(), 0.1)).unwrap();
        assert!(own.share == 1.0 && (own.scale - 0.1).abs() < 1e-3, "{own:?}");
        let rest = MotionPair { by_images: Pose::identity(), by_poses: Pose::identity(), depth: 1.0 };
        assert!(Mounting::of_camera(&[rest; 9]).is_none());
    }
}
