//! The twin with its found effects as MJCF, without meshes; for MuJoCo 3.5 and later.

use std::fmt::Write as _;

use crate::diagnosed::{
    numbers::{UNTURNED, held, joint_numbers, missing, notes},
    tilt::tilted,
};
use crate::mjcf::{body_tag, inertial, joint_start};
use gap::{
    judge::report::{ExportNote, JointReport},
    model::{
        actuator::Actuator,
        effects::end_stop::MAX_IMPEDANCE,
        format::{Format, JointNumbers, Spring},
        joint_model::{CREEP, Catalogue},
    },
    twin_tree::{Motion, TwinJoint, TwinTree},
};
use geometry::Pose;
use model::escape_xml;

/// Time step of the file, seconds.
/// measured: eval/gap/timestep.md: the largest to move no twin without a stop by a hundredth of the noise.
const TIMESTEP_S: f64 = 5e-4;
/// The finer time step needed for a stop (met between steps) and for a delay, seconds.
/// measured: eval/gap/timestep.md: the largest under which no residual grows by 3 %, which the replay allows.
const FINE_TIMESTEP_S: f64 = 1e-4;
/// Solver impedance of friction without a settle time. chosen: next to the largest value of MuJoCo, 0.9999.
const HARD_IMPEDANCE: f64 = 0.9995;

/// Solver impedance of friction with a settle time; its damping is then `2 / (impedance * time constant)`.
/// derived: that of the rollout.
const SOFT_IMPEDANCE: f64 = 1.0 - CREEP;

/// MJCF text for one joint.
struct Attributes {
    numbers: JointNumbers,
    /// Further attributes of the joint.
    more: String,
    parent_from_joint: Pose,
    actuator: Actuator,
}

struct Writer<'a> {
    tree: &'a TwinTree,
    joints: &'a [JointReport],
    catalogue: &'a Catalogue,
    file: &'a str,
    actuators: String,
    notes: Vec<ExportNote>,
}

/// The twin with the effects as MJCF, and the status of each effect.
pub fn mjcf(
    tree: &TwinTree,
    joints: &[JointReport],
    catalogue: &Catalogue,
    file: &str,
) -> (String, Vec<ExportNote>) {
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
    /// The content of a link and its child bodies.
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
                let start = joint_start(&joint.name, joint.motion == Motion::Turn, &joint.axis);
                let n = &a.numbers;
                let damping = if n.drag == 0.0 {
                    format!("{}", n.damping)
                } else {
                    format!("{} {}", n.damping, n.drag)
                };
                let _ = writeln!(
                    inside,
                    "{start} damping=\"{damping}\" frictionloss=\"{}\"{}/>",
                    n.friction, a.more
                );
                let _ = writeln!(self.actuators, "{}", actuator(&escape_xml(&joint.name), n, &a.actuator));
            }
            // MuJoCo refuses an inertial without mass.
            if child.mass_kg > 0.0 {
                let inertial = inertial(child.mass_kg, &child.center_of_mass, &child.inertia);
                let _ = writeln!(inside, "{inertial}");
            }
            let below = self.link(joint.child);
            let _ = write!(text, "{}\n{inside}{below}</body>\n", body_tag(&child.name, &pose));
        }
        text
    }

    /// The joint with its effects.
    fn attributes(&mut self, joint: &TwinJoint) -> Attributes {
        let mut a = Attributes {
            numbers: JointNumbers::without_effects(joint.damping, joint.friction),
            more: String::new(),
            parent_from_joint: joint.parent_from_joint,
            actuator: Actuator::default(),
        };
        let Some(report) = self.joints.iter().find(|j| j.joint == joint.name) else { return a };
        let twin = report.diagnosis.model.without_effects();
        a.actuator = twin.plant.actuator;
        a.actuator.delay_s += twin.lag_s;
        let mut model = held(Format::Mjcf, report).map_or(&twin, |h| &h.model);
        let mut notes = notes(Format::Mjcf, self.file, report, self.catalogue);
        if let Some(numbers) = joint_numbers(Format::Mjcf, joint, report, self.catalogue) {
            let turned = match numbers.tilt {
                None => Some(a.parent_from_joint),
                Some([sine, cosine]) => {
                    let index = self.tree.joints.iter().position(|j| j.name == joint.name);
                    index.and_then(|i| tilted(self.tree, i, sine, cosine))
                }
            };
            if let Some(pose) = turned {
                (a.numbers, a.parent_from_joint) = (numbers, pose);
            } else {
                // Without the turn, the other effects were not tested.
                model = &twin;
                notes = missing(Format::Mjcf, report, self.catalogue, UNTURNED);
            }
        }
        self.notes.extend(notes);
        if model.has_friction(self.catalogue) {
            a.more = solver_of_friction(model.settle_s);
        }
        a.more.push_str(&joint_attributes(&a.numbers, model.plant.inertia));
        a
    }
}

/// Solver attributes of a friction with a settle time.
fn solver_of_friction(settle_s: f64) -> String {
    let (settle, impedance) = if settle_s > 0.0 { (settle_s, SOFT_IMPEDANCE) } else { (0.0, HARD_IMPEDANCE) };
    // MuJoCo keeps time constants of constraints above two time steps.
    let constant_s = (2.0 * settle).max(2.0 * TIMESTEP_S);
    format!(" solreffriction=\"{constant_s} 1\" solimpfriction=\"{impedance} {impedance} 0.001\"")
}

/// Spring, armature, offset and stops of a joint.
fn joint_attributes(n: &JointNumbers, inertia: f64) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    if let Some(Spring { stiffness, cubic, rest }) = n.spring {
        let polynomial = if cubic == 0.0 { String::new() } else { format!(" 0 {cubic}") };
        // MuJoCo's positions have the offset of `ref` in them.
        let rest = rest + n.position_offset;
        let _ = write!(text, " stiffness=\"{stiffness}{polynomial}\" springref=\"{rest}\"");
    }
    if n.armature != 0.0 {
        let _ = write!(text, " armature=\"{}\"", n.armature);
    }
    if n.position_offset != 0.0 {
        let _ = write!(text, " ref=\"{}\"", n.position_offset);
    }
    // One solver serves both ends.
    if let Some(stop) = n.stops.first() {
        // MuJoCo limits a joint at both ends or at none: an end without a stop is moved out of reach.
        let low = end_text(n, false).unwrap_or("-1e3".into());
        let high = end_text(n, true).unwrap_or("1e3".into());
        // Negative numbers mean stiffness and damping directly, per unit of inertia.
        let solver = format!("-{} -{}", stop.stiffness / inertia, stop.damping / inertia);
        // MuJoCo's own bounds on an impedance.
        let impedance = stop.impedance.clamp(1e-4, MAX_IMPEDANCE);
        let _ = write!(
            text,
            " limited=\"true\" range=\"{low} {high}\" solreflimit=\"{solver}\" \
             solimplimit=\"{impedance} {impedance} 0.001\""
        );
    }
    text
}

/// Position of the stop at an end of the range, as MuJoCo counts positions; `None` without one.
fn end_text(n: &JointNumbers, upper: bool) -> Option<String> {
    let stop = n.stops.iter().find(|s| s.is_upper == upper)?;
    Some((stop.position + n.position_offset).to_string())
}

/// Drive of a joint: the recorded effort, or a servo with given positions.
fn actuator(name: &str, n: &JointNumbers, actuator: &Actuator) -> String {
    let late = delay(n.delay_s + actuator.delay_s);
    let Some(servo) = actuator.servo else {
        // The gear also multiplies the bias, which is therefore divided by it here.
        let gear = n.gear * actuator.unit * actuator.gain;
        return format!(
            "<general name=\"{name}\" joint=\"{name}\" gear=\"{gear}\" gaintype=\"fixed\" gainprm=\"1\" \
             biastype=\"affine\" biasprm=\"{} 0 0\"{late}/>",
            n.bias / gear
        );
    };
    // A gear would also scale the position that the servo measures.
    let stiffness = n.gear * actuator.gain * servo.stiffness;
    let damping = n.gear * actuator.damping;
    let limit = n.gear * servo.limit;
    let limited = if limit.is_finite() {
        format!(" forcelimited=\"true\" forcerange=\"-{limit} {limit}\"")
    } else {
        String::new()
    };
    format!(
        "<general name=\"{name}\" joint=\"{name}\" gaintype=\"fixed\" gainprm=\"{stiffness}\" \
         biastype=\"affine\" biasprm=\"{} -{stiffness} -{damping}\"{limited}{late}/>",
        n.bias
    )
}

/// Attributes of an actuator with a delayed effort.
fn delay(delay_s: f64) -> String {
    if delay_s == 0.0 {
        return String::new();
    }
    // Read between its samples, a held effort would change half a step early.
    let delay_s = delay_s + 0.5 * FINE_TIMESTEP_S;
    // The buffer must hold samples on both sides of the delay.
    let kept = (delay_s / FINE_TIMESTEP_S).ceil() as usize + 2;
    format!(" delay=\"{delay_s}\" nsample=\"{kept}\" interp=\"linear\"")
}

#[cfg(test)]
mod tests {
    use super::*;
    use gap::model::format::Stop;

    #[test]
    fn springs_and_stops_stand_where_the_sensor_sees_them() {
        let stop = Stop { is_upper: true, position: 0.75, stiffness: 8.0, damping: 2.0, impedance: 0.5 };
        let numbers = JointNumbers {
            spring: Some(Spring { stiffness: 2.0, cubic: 0.0, rest: 0.25 }),
            position_offset: 0.125,
            stops: vec![stop],
            ..JointNumbers::without_effects(0.0, 0.0)
        };
        let text = joint_attributes(&numbers, 1.0);
        for part in ["springref=\"0.375\"", "ref=\"0.125\"", "range=\"-1e3 0.875\""] {
            assert!(text.contains(part), "{text}");
        }
    }
}
