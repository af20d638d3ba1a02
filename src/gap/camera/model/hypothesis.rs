//! A twin with its joint positions, its camera, and assumed errors of both.

use nalgebra::{Point3, Unit, Vector3};

use crate::camera::model::twin::{SeenJoint, SeenTwin};
use geometry::{AxisMotion, Pose};

/// The motion law of a joint under a hypothesis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionLaw {
    /// How it moves.
    pub kind: AxisMotion,
    /// Direction in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// A point of the axis in the joint frame, meters.
    pub point: Point3<f64>,
    /// Error of the joint frame, expressed in that frame.
    pub frame: Pose,
}

impl MotionLaw {
    /// The law of a joint as given by the twin.
    fn of_joint(joint: &SeenJoint) -> Self {
        Self { kind: joint.kind, axis: joint.axis, point: joint.point, frame: Pose::identity() }
    }

    /// Motion of the child at a position, joint frame; the identity at 0.
    pub fn motion_at(&self, position: f64) -> Pose {
        self.kind.motion_to(self.axis, self.point, position)
    }
}

/// Errors of the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraErrors {
    /// Pose of the true optical frame in the reported one.
    pub reported_from_true: Pose,
    /// Depth reading over true depth.
    pub scale: f64,
    /// Depth reading at depth 0, meters.
    pub bias_m: f64,
    /// Images belong to the pose at stamp + this delay, seconds.
    pub delay_s: f64,
}

impl Default for CameraErrors {
    fn default() -> Self {
        Self { reported_from_true: Pose::identity(), scale: 1.0, bias_m: 0.0, delay_s: 0.0 }
    }
}

/// A twin with its joint positions, its camera, and assumed errors of both.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// Motion law of every joint.
    pub laws: Vec<MotionLaw>,
    /// Position of every joint in every run, rad or m.
    pub positions: Vec<Vec<f64>>,
    /// Motion of a joint's child beyond its law in each run, in the joint frame.
    pub extra: Vec<Vec<Pose>>,
    /// Pose of the root in the world, for each run.
    pub world_from_root: Vec<Pose>,
    /// The camera.
    pub camera: CameraErrors,
}

impl Hypothesis {
    /// The twin as given, every joint at 0.
    pub fn of_twin(twin: &SeenTwin, runs: usize) -> Self {
        Self {
            laws: twin.joints.iter().map(MotionLaw::of_joint).collect(),
            positions: vec![vec![0.0; twin.joints.len()]; runs],
            extra: vec![vec![Pose::identity(); twin.joints.len()]; runs],
            world_from_root: vec![Pose::identity(); runs],
            camera: CameraErrors::default(),
        }
    }

    /// Position of a joint in a run; that of a mimic joint follows from its leader.
    pub fn joint_position(&self, twin: &SeenTwin, run: usize, joint: usize) -> f64 {
        match twin.joints[joint].mimic {
            Some((lead, factor, offset)) => factor * self.positions[run][lead] + offset,
            None => self.positions[run][joint],
        }
    }

    /// World poses in a run: of every part, and of every joint's frame before its own motion.
    pub fn part_and_joint_poses(&self, twin: &SeenTwin, run: usize) -> (Vec<Pose>, Vec<Pose>) {
        let mut parts = vec![self.world_from_root[run]; twin.parts.len()];
        let mut frames = Vec::with_capacity(twin.joints.len());
        for (j, joint) in twin.joints.iter().enumerate() {
            let law = &self.laws[j];
            // Joints are in tree order, so the parent's pose is known.
            let frame = parts[joint.parent] * joint.parent_from_joint * law.frame;
            parts[joint.child] =
                frame * self.extra[run][j] * law.motion_at(self.joint_position(twin, run, j));
            frames.push(frame);
        }
        (parts, frames)
    }
}
