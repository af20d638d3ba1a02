//! What can be changed about a hypothesis, and how the surface that is seen moves with it.

use nalgebra::{Point3, Unit, Vector3};

use super::{
    frames::FrameRun,
    twin::{Hinge, Hypothesis, SeenTwin, small_motion},
};
use crate::geometry::Pose;

/// A number of a hypothesis that may change. Angles rad, lengths m.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub enum Parameter {
    /// Placement of the root in a run: 0 to 2 shift, 3 to 5 turn about the object's center.
    Root(usize, usize),
    /// Position of a joint in a run.
    Position(usize, usize),
    /// Placement of a part's mesh, in its own frame, 0 to 2 shift, 3 to 5 turn about its center.
    Mesh(usize, usize),
    /// Camera's optical frame, 0 to 2 shift, 3 to 5 turn.
    Extrinsic(usize),
    /// Depth readings over depth, less one.
    DepthScale,
    /// Depth readings less depth.
    DepthBias,
    /// Delay of the images' stamps, seconds.
    Delay,
    /// Turn of a joint's axis at position 0 of the child unchanged: joint, one of two directions.
    AxisTurn(usize, usize),
    /// Shift of a joint's axis at position 0 of the child unchanged: joint, one of two directions.
    AxisShift(usize, usize),
    /// Shift (0 to 2, along two normals and the axis) and turn (3, 4, about two normals) of a joint's frame, child and all.
    Frame(usize, usize),
    /// Advance of a turning joint, metres a radian.
    Pitch(usize),
    /// Motion of a joint's child in a run beyond the law: run, joint, 0 to 2 shift, 3 to 5 turn about the child's center.
    Extra(usize, usize, usize),
    /// Factor on a joint's told positions, less one.
    EncoderScale(usize),
    /// Offset of a joint's told positions.
    EncoderBias(usize),
}

/// Two unit vectors normal to a third.
#[must_use]
pub fn normals_of(axis: &Unit<Vector3<f64>>) -> [Vector3<f64>; 2] {
    let a = axis.into_inner();
    let k = a.iamin();
    let e = Vector3::from_fn(|i, _| if i == k { 1.0 } else { 0.0 });
    let u = a.cross(&e).normalize();
    [u, a.cross(&u)]
}

/// The unit vector of a component and whether it is a turn.
fn component(k: usize) -> (Vector3<f64>, bool) {
    (Vector3::from_fn(|i, _| if i == k % 3 { 1.0 } else { 0.0 }), k >= 3)
}

/// Poses under a hypothesis that derivatives are taken at.
pub struct Stage<'a> {
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

/// A point of the surface as a frame sees it.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
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
    /// Depth, metres.
    pub depth_m: f64,
    /// Normal times ray with z = 1; negative.
    pub slant: f64,
}

impl<'a> Stage<'a> {
    /// Poses of all runs.
    #[must_use]
    pub fn new(twin: &'a SeenTwin, runs: &'a [FrameRun], hypothesis: &'a Hypothesis) -> Self {
        let (parts, frames) = (0..runs.len()).map(|r| hypothesis.poses(twin, r)).unzip();
        Self { twin, runs, hypothesis, parts, frames }
    }

    /// Derivative of the predicted reading at a surface point, across the surface, metres a unit of the parameter.
    #[must_use]
    pub fn derivative(&self, parameter: Parameter, seen: &Seen) -> f64 {
        match parameter {
            Parameter::DepthScale => seen.slant * seen.depth_m,
            Parameter::DepthBias => seen.slant,
            Parameter::Extrinsic(_) | Parameter::Delay => seen.normal.dot(&self.camera_velocity(parameter, seen)),
            _ => seen.normal.dot(&self.surface_velocity(parameter, seen)),
        }
    }

    /// How the surface moves in the world, seen from the camera, as the camera's errors change.
    fn camera_velocity(&self, parameter: Parameter, seen: &Seen) -> Vector3<f64> {
        let hypothesis = &self.hypothesis.camera;
        let in_true = seen.camera.inverse_transform_point(&seen.point);
        let (frame, point, t, w) = match parameter {
            Parameter::Delay => {
                let Some([t, w]) = self.runs[seen.run].velocities.get(seen.frame) else { return Vector3::zeros() };
                // The twist acts before the offset of the camera.
                let told = seen.camera * hypothesis.told_from_true.inverse();
                (told, hypothesis.told_from_true * in_true, *t, *w)
            }
            Parameter::Extrinsic(k) => {
                let (e, turns) = component(k);
                (seen.camera, in_true, if turns { Vector3::zeros() } else { e }, if turns { e } else { Vector3::zeros() })
            }
            _ => return Vector3::zeros(),
        };
        -(frame.rotation * (t + w.cross(&point.coords)))
    }

    /// How the surface point moves in the world with a parameter.
    fn surface_velocity(&self, parameter: Parameter, seen: &Seen) -> Vector3<f64> {
        let zero = Vector3::zeros();
        let twist = |pose: &Pose, center: Point3<f64>, k: usize| {
            let (e, turns) = component(k);
            let e = pose.rotation * e;
            if turns { e.cross(&(seen.point - pose * center)) } else { e }
        };
        match parameter {
            Parameter::Root(run, k) if run == seen.run => twist(&self.parts[run][0], self.twin.parts[0].center, k),
            Parameter::Mesh(part, k) if part == seen.part => twist(&self.parts[seen.run][part], self.twin.parts[part].center, k),
            Parameter::Position(run, joint) if run == seen.run => self.joint_velocity(joint, seen),
            Parameter::EncoderBias(joint) => self.joint_velocity(joint, seen),
            Parameter::EncoderScale(joint) => self.joint_velocity(joint, seen) * self.hypothesis.positions[seen.run][joint],
            Parameter::Extra(run, joint, k) if run == seen.run && self.twin.carries(joint, seen.part) => {
                let center = self.parts[run][self.twin.joints[joint].child] * self.twin.parts[self.twin.joints[joint].child].center;
                let frame = &self.frames[run][joint];
                twist(frame, frame.inverse_transform_point(&center), k)
            }
            Parameter::AxisTurn(joint, k) | Parameter::AxisShift(joint, k) if self.twin.carries(joint, seen.part) => {
                self.axis_velocity(joint, k, matches!(parameter, Parameter::AxisTurn(..)), seen)
            }
            Parameter::Frame(joint, k) if self.twin.carries(joint, seen.part) => {
                let (law, frame) = (&self.hypothesis.laws[joint], &self.frames[seen.run][joint]);
                let [u, v] = normals_of(&law.axis);
                let e = frame.rotation * [u, v, law.axis.into_inner(), u, v][k];
                if k < 3 { e } else { e.cross(&(seen.point - frame * law.point)) }
            }
            Parameter::Pitch(joint) if self.twin.carries(joint, seen.part) && self.hypothesis.laws[joint].hinge.turns() => {
                let axis = self.frames[seen.run][joint].rotation * self.hypothesis.laws[joint].axis.into_inner();
                axis * self.hypothesis.position(self.twin, seen.run, joint)
            }
            _ => zero,
        }
    }

    /// Velocity of a surface point with the position of a joint, and of those that follow it.
    fn joint_velocity(&self, joint: usize, seen: &Seen) -> Vector3<f64> {
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
            let (law, frame) = (&self.hypothesis.laws[j], self.frames[seen.run][j] * self.hypothesis.extra[seen.run][j]);
            let axis = frame.rotation * law.axis.into_inner();
            let around = axis.cross(&(seen.point - frame * law.point));
            sum += rate
                * match law.hinge {
                    Hinge::Revolute => around,
                    Hinge::Prismatic => axis,
                    Hinge::Screw { pitch_m_per_rad } => around + axis * pitch_m_per_rad,
                };
        }
        sum
    }

    /// Velocity with a turn or shift of the axis, the child at position 0 unchanged: with `M` the joint's motion and `D`
    /// the small motion of the line, the child moves by `D M D^-1 M^-1`.
    fn axis_velocity(&self, joint: usize, k: usize, turns: bool, seen: &Seen) -> Vector3<f64> {
        let law = &self.hypothesis.laws[joint];
        let frame = self.frames[seen.run][joint] * self.hypothesis.extra[seen.run][joint];
        let motion = law.motion(self.hypothesis.position(self.twin, seen.run, joint));
        let e = normals_of(&law.axis)[k];
        let x = frame.inverse_transform_point(&seen.point);
        let before = motion.inverse_transform_point(&x);
        let by = |p: &Point3<f64>| if turns { e.cross(&(p - self.hinge_point(joint))) } else { e };
        frame.rotation * (by(&x) - motion.rotation * by(&before))
    }

    /// The point of the axis next to the child's center, joint frame: where turning and shifting the axis mix least.
    fn hinge_point(&self, joint: usize) -> Point3<f64> {
        let law = &self.hypothesis.laws[joint];
        let center = self.twin.parts[self.twin.joints[joint].child].center;
        law.point + law.axis.into_inner() * law.axis.dot(&(center - law.point))
    }
}

/// Adds increments to a hypothesis.
pub fn advance(hypothesis: &mut Hypothesis, twin: &SeenTwin, steps: &[(Parameter, f64)]) {
    let start = hypothesis.clone();
    let stage_poses: Vec<_> = (0..start.positions.len()).map(|r| start.poses(twin, r)).collect();
    for &(parameter, x) in steps {
        let about = |pose: &Pose, center: Point3<f64>, k: usize| {
            let (e, turns) = component(k);
            let e = pose.rotation * e * x;
            let c = pose * center;
            if turns {
                let r = small_motion(&Vector3::zeros(), &e);
                Pose::from_parts((c.coords - r.rotation * c.coords).into(), r.rotation)
            } else {
                small_motion(&e, &Vector3::zeros())
            }
        };
        match parameter {
            Parameter::Root(run, k) => {
                let by = about(&stage_poses[run].0[0], twin.parts[0].center, k);
                hypothesis.world_from_root[run] = by * hypothesis.world_from_root[run];
            }
            Parameter::Position(run, joint) => hypothesis.positions[run][joint] += x,
            Parameter::EncoderBias(joint) => hypothesis.positions.iter_mut().for_each(|p| p[joint] += x),
            Parameter::EncoderScale(joint) => hypothesis.positions.iter_mut().for_each(|p| p[joint] *= 1.0 + x),
            Parameter::Extrinsic(k) => {
                let (e, turns) = component(k);
                let by = if turns { small_motion(&Vector3::zeros(), &(e * x)) } else { small_motion(&(e * x), &Vector3::zeros()) };
                hypothesis.camera.told_from_true *= by;
            }
            Parameter::DepthScale => hypothesis.camera.scale += x,
            Parameter::DepthBias => hypothesis.camera.bias_m += x,
            Parameter::Delay => hypothesis.camera.delay_s += x,
            Parameter::AxisTurn(joint, k) => {
                let law = start.laws[joint];
                let center = twin.parts[twin.joints[joint].child].center;
                let pivot = law.point + law.axis.into_inner() * law.axis.dot(&(center - law.point));
                let turn = small_motion(&Vector3::zeros(), &(normals_of(&law.axis)[k] * x)).rotation;
                let law = &mut hypothesis.laws[joint];
                law.axis = turn * law.axis;
                law.point = pivot + turn * (law.point - pivot);
            }
            Parameter::AxisShift(joint, k) => hypothesis.laws[joint].point += normals_of(&start.laws[joint].axis)[k] * x,
            Parameter::Frame(joint, k) => {
                let law = start.laws[joint];
                let [u, v] = normals_of(&law.axis);
                let e = [u, v, law.axis.into_inner(), u, v][k] * x;
                let by = if k < 3 {
                    small_motion(&e, &Vector3::zeros())
                } else {
                    let r = small_motion(&Vector3::zeros(), &e).rotation;
                    Pose::from_parts((law.point.coords - r * law.point.coords).into(), r)
                };
                hypothesis.laws[joint].frame *= by;
            }
            Parameter::Pitch(joint) => {
                let law = &mut hypothesis.laws[joint];
                let before = if let Hinge::Screw { pitch_m_per_rad } = law.hinge { pitch_m_per_rad } else { 0.0 };
                if law.hinge.turns() {
                    law.hinge = Hinge::Screw { pitch_m_per_rad: before + x };
                }
            }
            Parameter::Extra(run, joint, k) => {
                let child = twin.joints[joint].child;
                let frame = &stage_poses[run].1[joint];
                let center = frame.inverse_transform_point(&(stage_poses[run].0[child] * twin.parts[child].center));
                let by = about(&Pose::identity(), center, k);
                hypothesis.extra[run][joint] = by * hypothesis.extra[run][joint];
            }
            // Meshes stay: the placement only takes up what a reconstruction got wrong.
            Parameter::Mesh(..) => {}
        }
    }
}
