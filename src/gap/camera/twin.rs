//! A twin as cameras see it: rigid parts with meshes, joints, and what may be wrong with either or with the camera.

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};

use super::own_error::OwnErrors;
use crate::{
    geometry::{Pose, Screw},
    surface::TriangleMesh,
};

/// How a joint moves its child.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hinge {
    /// Turns; radians.
    Revolute,
    /// Slides; metres.
    Prismatic,
    /// Turns and advances; radians.
    Screw {
        /// Metres a radian.
        pitch_m_per_rad: f64,
    },
}

impl Hinge {
    /// Name in reports.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Revolute => "revolute",
            Self::Prismatic => "prismatic",
            Self::Screw { .. } => "screw",
        }
    }

    /// Whether its position is an angle.
    #[must_use]
    pub fn turns(&self) -> bool {
        !matches!(self, Self::Prismatic)
    }
}

/// A rigid part: links tied by fixed joints.
#[derive(Clone, Debug)]
pub struct SeenPart {
    /// Name of its first link.
    pub name: String,
    /// Visual meshes in the frame of the first link.
    pub mesh: TriangleMesh,
    /// Joint that carries it; `None` for the root.
    pub joint: Option<usize>,
    /// Center of its box, part frame.
    pub center: Point3<f64>,
    /// Half the diagonal of its box, metres.
    pub radius_m: f64,
}

/// A joint of the twin; its child part's frame is the joint frame.
#[derive(Clone, Debug)]
pub struct SeenJoint {
    /// Name.
    pub name: String,
    /// Part that carries it.
    pub parent: usize,
    /// Part that it moves.
    pub child: usize,
    /// Joint frame in the parent part's frame at position 0.
    pub parent_from_joint: Pose,
    /// How it moves.
    pub hinge: Hinge,
    /// Direction in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// A point of the axis in the joint frame, metres; the origin in every description file.
    pub point: Point3<f64>,
    /// Lowest and highest position, where the twin has limits.
    pub limit: Option<(f64, f64)>,
    /// Joint that it follows: index, factor, offset.
    pub mimic: Option<(usize, f64, f64)>,
}

/// A twin as cameras see it. Parts stand behind the parts that carry them.
#[derive(Clone, Debug)]
pub struct SeenTwin {
    /// Parts; the first is the root.
    pub parts: Vec<SeenPart>,
    /// Joints, each before those that its child carries.
    pub joints: Vec<SeenJoint>,
    /// How well it is known itself.
    pub own: OwnErrors,
}

impl SeenTwin {
    /// Whether a part moves with a joint.
    #[must_use]
    pub fn carries(&self, joint: usize, part: usize) -> bool {
        let mut at = part;
        while let Some(j) = self.parts[at].joint {
            if j == joint {
                return true;
            }
            at = self.joints[j].parent;
        }
        false
    }

    /// Half the diagonal of the whole with every joint at 0, metres.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        self.parts.iter().map(|p| p.radius_m).fold(0.05, f64::max)
    }
}

/// The motion law of a joint, as a hypothesis has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    /// How it moves.
    pub hinge: Hinge,
    /// Direction in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// A point of the axis in the joint frame, metres.
    pub point: Point3<f64>,
    /// By how much the joint frame is off, in itself.
    pub frame: Pose,
}

impl Law {
    /// Motion of the child for a position; identity at 0.
    #[must_use]
    pub fn motion(&self, position: f64) -> Pose {
        let line = Screw { direction: self.axis, point: self.point, angle_rad: 0.0, advance_m: 0.0 };
        match self.hinge {
            Hinge::Revolute => line.motion_by(position, 0.0),
            Hinge::Prismatic => line.motion_by(0.0, position),
            Hinge::Screw { pitch_m_per_rad } => line.motion_by(position, position * pitch_m_per_rad),
        }
    }
}

/// What may be wrong with the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraErrors {
    /// True optical frame in the told one.
    pub told_from_true: Pose,
    /// Reading over true depth.
    pub scale: f64,
    /// Reading at depth 0, metres.
    pub bias_m: f64,
    /// Images are this much younger than their stamps say: poses are to be read at stamp + this, seconds.
    pub delay_s: f64,
}

impl Default for CameraErrors {
    fn default() -> Self {
        Self { told_from_true: Pose::identity(), scale: 1.0, bias_m: 0.0, delay_s: 0.0 }
    }
}

/// A twin, its joint positions and its camera, with what is believed to be wrong.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// Motion law of every joint.
    pub laws: Vec<Law>,
    /// Position of every joint in every run, rad or m.
    pub positions: Vec<Vec<f64>>,
    /// Further motion of a joint's child in a run that the law does not have, in the joint frame.
    pub extra: Vec<Vec<Pose>>,
    /// Root frame in the world of each run.
    pub world_from_root: Vec<Pose>,
    /// The camera.
    pub camera: CameraErrors,
}

impl Hypothesis {
    /// The twin as it is, every joint at 0.
    #[must_use]
    pub fn of(twin: &SeenTwin, runs: usize) -> Self {
        let law = |j: &SeenJoint| Law { hinge: j.hinge, axis: j.axis, point: j.point, frame: Pose::identity() };
        Self {
            laws: twin.joints.iter().map(law).collect(),
            positions: vec![vec![0.0; twin.joints.len()]; runs],
            extra: vec![vec![Pose::identity(); twin.joints.len()]; runs],
            world_from_root: vec![Pose::identity(); runs],
            camera: CameraErrors::default(),
        }
    }

    /// Position of a joint in a run; that of a joint that follows comes from the one that leads.
    #[must_use]
    pub fn position(&self, twin: &SeenTwin, run: usize, joint: usize) -> f64 {
        match twin.joints[joint].mimic {
            Some((lead, factor, offset)) => factor * self.positions[run][lead] + offset,
            None => self.positions[run][joint],
        }
    }

    /// Pose of every part in the world of a run, and of every joint's frame before its own motion.
    #[must_use]
    pub fn poses(&self, twin: &SeenTwin, run: usize) -> (Vec<Pose>, Vec<Pose>) {
        let mut parts = vec![self.world_from_root[run]; twin.parts.len()];
        let mut frames = Vec::with_capacity(twin.joints.len());
        for (j, joint) in twin.joints.iter().enumerate() {
            let law = &self.laws[j];
            let frame = parts[joint.parent] * joint.parent_from_joint * law.frame;
            parts[joint.child] = frame * self.extra[run][j] * law.motion(self.position(twin, run, j));
            frames.push(frame);
        }
        (parts, frames)
    }
}

/// A motion at a constant twist: velocities of the origin and of rotation in the moving frame, for a time.
#[must_use]
pub fn twist_motion([t, w]: &[Vector3<f64>; 2], seconds: f64) -> Pose {
    let (rate, turn) = (w.norm(), w * seconds);
    if rate * seconds.abs() < 1e-9 {
        return small_motion(&(t * seconds), &turn);
    }
    let angle = rate * seconds;
    let n = w / rate;
    let across = n.cross(t);
    let path = t * (angle.sin() / rate) + across * ((1.0 - angle.cos()) / rate) + n * (n.dot(t) * (angle - angle.sin()) / rate);
    small_motion(&path, &turn)
}

/// A small rigid motion: translation and rotation vector.
#[must_use]
pub fn small_motion(t: &Vector3<f64>, w: &Vector3<f64>) -> Pose {
    Pose::from_parts((*t).into(), UnitQuaternion::from_scaled_axis(*w))
}
