//! The twin with its effects as MJCF, without meshes: what MuJoCo 3.5 and later has a place for.

use std::fmt::Write as _;

use super::{
    expressed::{Format, Status, status, tilted},
    joint_model::Catalogue,
    report::{ExportNote, JointReport},
    twin_tree::{Motion, TwinJoint, TwinTree},
    update::{exported, note},
};
use crate::model::escape_xml;

/// Step of the file, seconds; a delayed effort is read between steps and a stop is met between them, so that both ask for finer ones.
const TIMESTEP_S: f64 = 5e-4;
const FINE_TIMESTEP_S: f64 = 1e-4;
/// Solver impedance of friction without a settle time.
const HARD_IMPEDANCE: f64 = 0.9995;

/// Solver impedance of friction that settles; its damping then is `2 / (impedance * time constant)`.
const SOFT_IMPEDANCE: f64 = 0.9;

/// What is written about one joint.
struct Attributes {
    damping: f64,
    drag: f64,
    friction: f64,
    gear: f64,
    bias: f64,
    /// Further attributes of the joint.
    more: String,
    /// Further attributes of its actuator.
    actuator: String,
    parent_from_joint: crate::geometry::Pose,
}

struct Writer<'a> {
    tree: &'a TwinTree,
    joints: &'a [JointReport],
    catalogue: &'a Catalogue,
    file: &'a str,
    actuators: String,
    notes: Vec<ExportNote>,
}

/// The twin with the effects as MJCF, and what became of each effect.
#[must_use]
pub fn mjcf(tree: &TwinTree, joints: &[JointReport], catalogue: &Catalogue, file: &str) -> (String, Vec<ExportNote>) {
    let mut writer = Writer { tree, joints, catalogue, file, actuators: String::new(), notes: Vec::new() };
    let body = writer.link(tree.root);
    let g = tree.gravity;
    let is_fine = writer.actuators.contains(" delay=") || body.contains(" solreflimit=");
    let timestep_s = if is_fine { FINE_TIMESTEP_S } else { TIMESTEP_S };
    let text = format!(
        "<mujoco model=\"{}\">\n<compiler angle=\"radian\" autolimits=\"false\"/>\n\
         <option timestep=\"{timestep_s}\" gravity=\"{} {} {}\" integrator=\"RK4\"/>\n\
         <worldbody>\n{body}</worldbody>\n<actuator>\n{}</actuator>\n</mujoco>\n",
        escape_xml(&tree.name),
        g.x,
        g.y,
        g.z,
        writer.actuators
    );
    (text, writer.notes)
}

impl Writer<'_> {
    /// A link's content and the bodies that hang on it.
    fn link(&mut self, index: usize) -> String {
        let mut text = String::new();
        let tree = self.tree;
        for joint in tree.joints.iter().filter(|j| j.parent == index) {
            let child = &tree.links[joint.child];
            let mut inside = String::new();
            let mut pose = joint.parent_from_joint;
            if joint.motion != Motion::Fixed {
                let a = self.attributes(joint);
                pose = a.parent_from_joint;
                let kind = if joint.motion == Motion::Turn { "hinge" } else { "slide" };
                let (name, axis) = (escape_xml(&joint.name), joint.axis);
                let damping = if a.drag == 0.0 { format!("{}", a.damping) } else { format!("{} {}", a.damping, a.drag) };
                let _ = writeln!(
                    inside,
                    "<joint name=\"{name}\" type=\"{kind}\" axis=\"{} {} {}\" damping=\"{damping}\" frictionloss=\"{}\"{}/>",
                    axis.x, axis.y, axis.z, a.friction, a.more
                );
                let _ = writeln!(
                    self.actuators,
                    "<general name=\"{name}\" joint=\"{name}\" gear=\"{}\" gaintype=\"fixed\" gainprm=\"1\" biastype=\"affine\" biasprm=\"{} 0 0\"{}/>",
                    a.gear,
                    a.bias / a.gear,
                    a.actuator
                );
            }
            if child.mass_kg > 0.0 {
                let (c, i) = (child.center_of_mass, &child.inertia);
                let full = [i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]].map(|x| x.to_string()).join(" ");
                let _ = writeln!(inside, "<inertial pos=\"{} {} {}\" mass=\"{}\" fullinertia=\"{full}\"/>", c.x, c.y, c.z, child.mass_kg);
            }
            let below = self.link(joint.child);
            let (p, q) = (pose.translation.vector, pose.rotation);
            let _ = write!(
                text,
                "<body name=\"{}\" pos=\"{} {} {}\" quat=\"{} {} {} {}\">\n{inside}{below}</body>\n",
                escape_xml(&child.name),
                p.x,
                p.y,
                p.z,
                q.w,
                q.i,
                q.j,
                q.k
            );
        }
        text
    }

    /// The joint with its effects.
    fn attributes(&mut self, joint: &TwinJoint) -> Attributes {
        let mut a = Attributes {
            damping: joint.damping,
            drag: 0.0,
            friction: joint.friction,
            gear: 1.0,
            bias: 0.0,
            more: String::new(),
            actuator: String::new(),
            parent_from_joint: joint.parent_from_joint,
        };
        let Some(report) = self.joints.iter().find(|j| j.joint == joint.name) else { return a };
        let model = &report.diagnosis.model;
        if model.has_friction(self.catalogue) {
            let (settle, impedance) = if model.settle_s > 0.0 { (model.settle_s, SOFT_IMPEDANCE) } else { (0.0, HARD_IMPEDANCE) };
            // MuJoCo keeps time constants of constraints above two steps.
            let constant_s = (2.0 * settle).max(2.0 * TIMESTEP_S);
            let _ = write!(a.more, " solreffriction=\"{constant_s} 1\" solimpfriction=\"{impedance} {impedance} 0.001\"");
        }
        for finding in exported(report) {
            let Some(term) = report.diagnosis.model.terms.iter().find(|t| t.effect == finding.index) else { continue };
            let (p, plant) = (&term.p, &report.diagnosis.model.plant);
            let mut status = status(Format::Mjcf, &finding.effect, p, plant);
            if status != Status::NotExpressible && !self.add(&mut a, joint, &finding.effect, p, plant.inertia) {
                status = Status::NotExpressible;
            }
            self.notes.push(note("mjcf", self.file, report, &finding.effect, status));
        }
        a
    }

    /// Adds one effect; false where this joint has no place for it.
    fn add(&self, a: &mut Attributes, joint: &TwinJoint, effect: &str, p: &[f64], inertia: f64) -> bool {
        let mut more = |text: std::fmt::Arguments| a.more.write_fmt(text).is_ok();
        match effect {
            "viscous_friction" => a.damping = (a.damping + p[0]).max(0.0),
            "quadratic_drag" => a.drag += p[0],
            "coulomb_friction" | "stribeck_friction" => a.friction += p[0],
            "asymmetric_friction" => {
                a.friction += 0.5 * (p[0] + p[1]);
                a.bias += 0.5 * (p[1] - p[0]);
            }
            "spring_return" => return more(format_args!(" stiffness=\"{}\" springref=\"{}\"", p[0], p[1] / p[0])),
            "hardening_spring" => return more(format_args!(" stiffness=\"{} 0 {}\" springref=\"{}\"", p[0], p[1], p[2])),
            "inertia" => return more(format_args!(" armature=\"{}\"", p[0])),
            "encoder_bias" => return more(format_args!(" ref=\"{}\"", p[0])),
            "constant_bias" => a.bias += p[0],
            "torque_gain" => a.gear *= p[0],
            "delay" => {
                // Read between its samples, a held effort changes half a step early.
                let delay_s = p[0] + 0.5 * FINE_TIMESTEP_S;
                let kept = (delay_s / FINE_TIMESTEP_S).ceil() as usize + 2;
                return write!(a.actuator, " delay=\"{delay_s}\" nsample=\"{kept}\" interp=\"linear\"").is_ok();
            }
            "end_stop" => {
                let upper = joint_end(self.catalogue, self.joints, joint);
                let range = if upper { format!("-1e3 {}", p[2]) } else { format!("{} 1e3", p[2]) };
                let solver = format!("-{} -{}", p[0] / inertia, p[1] / inertia);
                let impedance = p[3].clamp(1e-4, 0.9999);
                return more(format_args!(
                    " limited=\"true\" range=\"{range}\" solreflimit=\"{solver}\" solimplimit=\"{impedance} {impedance} 0.001\""
                ));
            }
            "axis_tilt" => {
                let index = self.tree.joints.iter().position(|j| j.name == joint.name);
                let Some(pose) = index.and_then(|i| tilted(self.tree, i, p[0], p[1])) else { return false };
                a.parent_from_joint = pose;
            }
            _ => return false,
        }
        true
    }
}

/// Whether the stop that was found at a joint is at its high end.
fn joint_end(catalogue: &Catalogue, joints: &[JointReport], joint: &TwinJoint) -> bool {
    let Some(report) = joints.iter().find(|j| j.joint == joint.name) else { return true };
    let found = report.diagnosis.model.terms.iter().find(|t| catalogue[t.effect].name() == "end_stop");
    found.is_none_or(|t| catalogue[t.effect].is_upper())
}
