//! Motion of the seen surface as the parameters of a hypothesis change. See docs/method.md (15.7).

use nalgebra::{Point3, Vector3};

use crate::camera::{
    model::{
        hypothesis::Hypothesis,
        parameter::{HypothesisParameter, unit_component},
        twin::SeenTwin,
    },
    record::frames::FrameRun,
};
use geometry::{AxisMotion, Pose, normals_of};

/// The twin posed under a hypothesis, for derivatives there.
pub struct PosedTwin<'a> {
    /// Twin.
    pub twin: &'a SeenTwin,
    /// Recordings.
    pub runs: &'a [FrameRun],
    /// Hypothesis.
    pub hypothesis: &'a Hypothesis,
    /// World poses of the parts of each run.
    pub parts: Vec<Vec<Pose>>,
    /// World poses of the joint frames of each run.
    pub frames: Vec<Vec<Pose>>,
}

/// Velocity of a surface point for a unit rate of a frame's component `k`, world frame; turns are about
/// `center` in the given frame.
fn twist_velocity(frame: &Pose, center: Point3<f64>, k: usize, seen: &SurfacePoint) -> Vector3<f64> {
    let (e, turns) = unit_component(k);
    let e = frame.rotation * e;
    if turns { e.cross(&(seen.point - frame * center)) } else { e }
}

/// A point of the surface seen in a frame.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Run.
    pub run: usize,
    /// Frame in the run.
    pub frame: usize,
    /// Part.
    pub part: usize,
    /// World point.
    pub point: Point3<f64>,
    /// Unit normal in the world, towards the camera.
    pub normal: Vector3<f64>,
    /// World pose of the true camera.
    pub camera: Pose,
    /// Depth, meters.
    pub depth_m: f64,
    /// Dot product of the normal with the ray scaled to z = 1; negative.
    pub slant: f64,
}

impl<'a> PosedTwin<'a> {
    /// Poses of all runs.
    pub fn new(twin: &'a SeenTwin, runs: &'a [FrameRun], hypothesis: &'a Hypothesis) -> Self {
        let (parts, frames) = (0..runs.len()).map(|r| hypothesis.part_and_joint_poses(twin, r)).unzip();
        Self { twin, runs, hypothesis, parts, frames }
    }

    /// Derivative of the predicted reading at a surface point, across the surface, in meters per unit of the
    /// parameter.
    pub fn reading_derivative(&self, parameter: HypothesisParameter, seen: &SurfacePoint) -> f64 {
        // (15.7)
        match parameter {
            HypothesisParameter::DepthScale => seen.slant * seen.depth_m,
            HypothesisParameter::DepthBias => seen.slant,
            HypothesisParameter::Extrinsic(_) | HypothesisParameter::Delay => {
                seen.normal.dot(&self.camera_velocity(parameter, seen))
            }
            _ => seen.normal.dot(&self.surface_velocity(parameter, seen)),
        }
    }

    /// Apparent velocity of the surface in the world, seen from the camera, per unit rate of a camera
    /// parameter.
    fn camera_velocity(&self, parameter: HypothesisParameter, seen: &SurfacePoint) -> Vector3<f64> {
        let hypothesis = &self.hypothesis.camera;
        let in_true = seen.camera.inverse_transform_point(&seen.point);
        let (frame, point, t, w) = match parameter {
            HypothesisParameter::Delay => {
                let Some([t, w]) = self.runs[seen.run].velocities.get(seen.frame) else {
                    return Vector3::zeros();
                };
                // The motion during the delay applies before the camera's offset.
                let reported = seen.camera * hypothesis.reported_from_true.inverse();
                (reported, hypothesis.reported_from_true * in_true, *t, *w)
            }
            HypothesisParameter::Extrinsic(k) => {
                let (e, turns) = unit_component(k);
                (
                    seen.camera,
                    in_true,
                    if turns { Vector3::zeros() } else { e },
                    if turns { e } else { Vector3::zeros() },
                )
            }
            _ => return Vector3::zeros(),
        };
        // A camera moving one way sees the surface move the opposite way.
        -(frame.rotation * (t + w.cross(&point.coords)))
    }

    /// Velocity of the surface point in the world, per unit rate of a parameter.
    fn surface_velocity(&self, parameter: HypothesisParameter, seen: &SurfacePoint) -> Vector3<f64> {
        match parameter {
            HypothesisParameter::Root(run, k) if run == seen.run => {
                twist_velocity(&self.parts[run][0], self.twin.parts[0].center, k, seen)
            }
            HypothesisParameter::Mesh(part, k) if part == seen.part => {
                twist_velocity(&self.parts[seen.run][part], self.twin.parts[part].center, k, seen)
            }
            HypothesisParameter::Position(run, joint) if run == seen.run => self.joint_velocity(joint, seen),
            HypothesisParameter::EncoderBias(joint) => self.joint_velocity(joint, seen),
            HypothesisParameter::EncoderScale(joint) => {
                self.joint_velocity(joint, seen) * self.hypothesis.positions[seen.run][joint]
            }
            HypothesisParameter::Extra(run, joint, k)
                if run == seen.run && self.twin.carries(joint, seen.part) =>
            {
                let center = self.parts[run][self.twin.joints[joint].child]
                    * self.twin.parts[self.twin.joints[joint].child].center;
                let frame = &self.frames[run][joint];
                twist_velocity(frame, frame.inverse_transform_point(&center), k, seen)
            }
            HypothesisParameter::AxisTurn(joint, k) | HypothesisParameter::AxisShift(joint, k)
                if self.twin.carries(joint, seen.part) =>
            {
                self.axis_velocity(joint, k, matches!(parameter, HypothesisParameter::AxisTurn(..)), seen)
            }
            HypothesisParameter::Frame(joint, k) if self.twin.carries(joint, seen.part) => {
                let law = &self.hypothesis.laws[joint];
                let frame = &self.frames[seen.run][joint];
                let [u, v] = normals_of(&law.axis);
                let e = frame.rotation * [u, v, law.axis.into_inner(), u, v][k];
                if k < 3 { e } else { e.cross(&(seen.point - frame * law.point)) }
            }
            HypothesisParameter::Pitch(joint)
                if self.twin.carries(joint, seen.part) && self.hypothesis.laws[joint].kind.is_turning() =>
            {
                let axis =
                    self.frames[seen.run][joint].rotation * self.hypothesis.laws[joint].axis.into_inner();
                axis * self.hypothesis.joint_position(self.twin, seen.run, joint)
            }
            _ => Vector3::zeros(),
        }
    }

    /// Velocity of a surface point per unit rate of a joint position, mimic joints included.
    fn joint_velocity(&self, joint: usize, seen: &SurfacePoint) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        for (j, spec) in self.twin.joints.iter().enumerate() {
            let rate = match spec.mimic {
                Some((lead, factor, _)) if lead == joint => factor,
                None if j == joint => 1.0,
                _ => continue,
            };
            if !self.twin.carries(j, seen.part) {
                continue;
            }
            let law = &self.hypothesis.laws[j];
            let frame = self.frames[seen.run][j] * self.hypothesis.extra[seen.run][j];
            let axis = frame.rotation * law.axis.into_inner();
            let around = axis.cross(&(seen.point - frame * law.point));
            sum += rate
                * match law.kind {
                    AxisMotion::Revolute => around,
                    AxisMotion::Prismatic => axis,
                    AxisMotion::Screw { pitch_m_per_rad } => around + axis * pitch_m_per_rad,
                };
        }
        sum
    }

    /// Velocity for a turn or shift of the axis, the child at position 0 unchanged: with the joint's motion
    /// `M` and the axis' small motion `D` the child moves by `D M D^-1 M^-1`.
    fn axis_velocity(&self, joint: usize, k: usize, turns: bool, seen: &SurfacePoint) -> Vector3<f64> {
        let law = &self.hypothesis.laws[joint];
        let frame = self.frames[seen.run][joint] * self.hypothesis.extra[seen.run][joint];
        let motion = law.motion_at(self.hypothesis.joint_position(self.twin, seen.run, joint));
        let e = normals_of(&law.axis)[k];
        let x = frame.inverse_transform_point(&seen.point);
        let before = motion.inverse_transform_point(&x);
        let by = |p: &Point3<f64>| if turns { e.cross(&(p - self.axis_point(joint))) } else { e };
        // docs/method.md (15.8), to first order.
        frame.rotation * (by(&x) - motion.rotation * by(&before))
    }

    /// The axis point nearest the child's center, joint frame: turning and shifting the axis are least
    /// coupled there.
    fn axis_point(&self, joint: usize) -> Point3<f64> {
        let law = &self.hypothesis.laws[joint];
        let center = self.twin.parts[self.twin.joints[joint].child].center;
        law.point + law.axis.into_inner() * law.axis.dot(&(center - law.point))
    }
}
