//! The named effects in the twin: URDF where it has a place, a namespaced element elsewhere; MJCF as near as it goes.

use super::{
    joint_model::Catalogue,
    report::{ExportNote, JointReport},
    twin_tree::{Motion, TwinTree},
};

/// Namespace of the elements that other readers skip.
const NAMESPACE: &str = "xmlns:gap=\"https://artitwin.invalid/gap\"";

/// Value of a reported parameter of an effect.
fn value(joint: &JointReport, catalogue: &Catalogue, effect: &str, parameter: &str) -> Option<f64> {
    let term = joint.diagnosis.model.terms.iter().find(|t| catalogue[t.effect].name() == effect)?;
    catalogue[term.effect].reported(&term.p).iter().find(|r| r.name == parameter).map(|r| r.value)
}

/// Effects that leave the recording with the twin.
fn exported(joint: &JointReport) -> impl Iterator<Item = &super::verdict::Finding> {
    joint.diagnosis.findings.iter().filter(|f| f.effect != "disturbance")
}

/// The URDF with the effects, and what became of each. Damping and friction are changed in place; all other effects
/// are elements of the joint.
#[must_use]
pub fn urdf(text: &str, tree: &TwinTree, joints: &[JointReport], catalogue: &Catalogue, file: &str) -> (String, Vec<ExportNote>) {
    let mut text = text.to_owned();
    let mut notes = Vec::new();
    for joint in joints {
        let Some(spec) = tree.joints.iter().find(|j| j.name == joint.joint) else { continue };
        let mut dynamics = (spec.damping, spec.friction);
        let mut elements = String::new();
        for finding in exported(joint) {
            let native = match finding.effect.as_str() {
                "viscous_friction" => {
                    dynamics.0 += value(joint, catalogue, "viscous_friction", "damping").unwrap_or(0.0);
                    dynamics.0 >= 0.0
                }
                "coulomb_friction" => {
                    dynamics.1 += value(joint, catalogue, "coulomb_friction", "friction").unwrap_or(0.0);
                    true
                }
                _ => false,
            };
            if !native {
                elements.push_str(&format!("<gap:effect name=\"{}\">", finding.effect));
                for p in &finding.parameters {
                    elements.push_str(&format!("<gap:parameter name=\"{}\" value=\"{}\" unit=\"{}\"/>", p.name, p.value, p.unit));
                }
                elements.push_str("</gap:effect>");
            }
            let status = if native { "native" } else { "not expressible" };
            notes.push(note("urdf", file, joint, &finding.effect, status));
        }
        text = with_joint(&text, &joint.joint, (dynamics.0.max(0.0), dynamics.1), (spec.damping, spec.friction), &elements);
    }
    if text.contains("<gap:") && !text.contains(NAMESPACE) {
        text = text.replacen("<robot ", &format!("<robot {NAMESPACE} "), 1);
    }
    (text, notes)
}

fn note(format: &str, file: &str, joint: &JointReport, effect: &str, status: &str) -> ExportNote {
    ExportNote { format: format.into(), file: file.into(), joint: joint.joint.clone(), effect: effect.into(), status: status.into() }
}

/// Replaces the dynamics of a joint element and adds elements to it.
fn with_joint(text: &str, name: &str, dynamics: (f64, f64), old: (f64, f64), elements: &str) -> String {
    let mut from = 0;
    while let Some(start) = text[from..].find("<joint").map(|i| from + i) {
        let Some(open_end) = text[start..].find('>').map(|i| start + i) else { break };
        let Some(end) = text[start..].find("</joint>").map(|i| start + i) else { break };
        let tag = &text[start..open_end];
        let named = [format!("name=\"{name}\""), format!("name='{name}'")].iter().any(|n| tag.contains(n.as_str()));
        if !named || tag.ends_with('/') {
            from = open_end;
            continue;
        }
        let mut body = text[open_end + 1..end].to_owned();
        if dynamics != old {
            if let Some(at) = body.find("<dynamics")
                && let Some(close) = body[at..].find('>')
            {
                let whole = body[at..].find("</dynamics>").filter(|_| !body[at..at + close].ends_with('/')).map_or(close + 1, |i| i + 11);
                body.replace_range(at..at + whole, "");
            }
            body.push_str(&format!("<dynamics damping=\"{}\" friction=\"{}\"/>", dynamics.0, dynamics.1));
        }
        body.push_str(elements);
        return format!("{}{}{}", &text[..=open_end], body, &text[end..]);
    }
    text.to_owned()
}

/// The twin with the effects as MJCF, without meshes, and what became of each effect.
#[must_use]
pub fn mjcf(tree: &TwinTree, joints: &[JointReport], catalogue: &Catalogue, file: &str) -> (String, Vec<ExportNote>) {
    let mut notes = Vec::new();
    let mut actuators = String::new();
    let g = tree.gravity;
    let body = link(tree, tree.root, joints, catalogue, &mut actuators, &mut notes, file);
    let text = format!(
        "<mujoco model=\"{}\">\n<compiler angle=\"radian\" autolimits=\"false\"/>\n<option timestep=\"0.0005\" gravity=\"{} {} {}\" integrator=\"implicitfast\"/>\n\
         <worldbody>\n{body}</worldbody>\n<actuator>\n{actuators}</actuator>\n</mujoco>\n",
        tree.name, g.x, g.y, g.z
    );
    (text, notes)
}

/// A link's content and the bodies that hang on it.
fn link(
    tree: &TwinTree,
    index: usize,
    joints: &[JointReport],
    catalogue: &Catalogue,
    actuators: &mut String,
    notes: &mut Vec<ExportNote>,
    file: &str,
) -> String {
    let mut text = String::new();
    for joint in tree.joints.iter().filter(|j| j.parent == index) {
        let pose = joint.parent_from_joint;
        let (p, q) = (pose.translation.vector, pose.rotation);
        let child = &tree.links[joint.child];
        text.push_str(&format!(
            "<body name=\"{}\" pos=\"{} {} {}\" quat=\"{} {} {} {}\">\n",
            child.name, p.x, p.y, p.z, q.w, q.i, q.j, q.k
        ));
        if joint.motion != Motion::Fixed {
            let report = joints.iter().find(|j| j.joint == joint.name);
            let (attributes, gear, bias) = attributes(joint, report, catalogue, notes, file);
            let kind = if joint.motion == Motion::Turn { "hinge" } else { "slide" };
            let a = joint.axis;
            text.push_str(&format!("<joint name=\"{}\" type=\"{kind}\" axis=\"{} {} {}\" {attributes}/>\n", joint.name, a.x, a.y, a.z));
            actuators.push_str(&format!(
                "<general name=\"{0}\" joint=\"{0}\" gear=\"{gear}\" gaintype=\"fixed\" gainprm=\"1\" biastype=\"affine\" biasprm=\"{bias} 0 0\"/>\n",
                joint.name
            ));
        }
        if child.mass_kg > 0.0 {
            let (c, i) = (child.center_of_mass, &child.inertia);
            text.push_str(&format!(
                "<inertial pos=\"{} {} {}\" mass=\"{}\" fullinertia=\"{} {} {} {} {} {}\"/>\n",
                c.x,
                c.y,
                c.z,
                child.mass_kg,
                i[(0, 0)],
                i[(1, 1)],
                i[(2, 2)],
                i[(0, 1)],
                i[(0, 2)],
                i[(1, 2)]
            ));
        }
        text.push_str(&link(tree, joint.child, joints, catalogue, actuators, notes, file));
        text.push_str("</body>\n");
    }
    text
}

/// Attributes of a joint, the gear of its motor and the constant effort of it.
fn attributes(
    joint: &super::twin_tree::TwinJoint,
    report: Option<&JointReport>,
    catalogue: &Catalogue,
    notes: &mut Vec<ExportNote>,
    file: &str,
) -> (String, f64, f64) {
    let (mut damping, mut friction, mut gear, mut bias) = (joint.damping, joint.friction, 1.0, 0.0);
    let mut more = String::new();
    let Some(report) = report else { return (format!("damping=\"{damping}\" frictionloss=\"{friction}\""), gear, bias) };
    for finding in exported(report) {
        let of = |parameter: &str| value(report, catalogue, &finding.effect, parameter).unwrap_or(0.0);
        let status = match finding.effect.as_str() {
            "viscous_friction" => {
                damping = (damping + of("damping")).max(0.0);
                "native"
            }
            "coulomb_friction" => {
                friction += of("friction");
                "native"
            }
            "asymmetric_friction" => {
                friction += 0.5 * (of("friction_positive") + of("friction_negative"));
                bias -= 0.5 * (of("friction_positive") - of("friction_negative"));
                "approximated"
            }
            "stribeck_friction" => {
                friction += of("friction");
                "approximated"
            }
            "spring_return" => {
                more.push_str(&format!(" stiffness=\"{}\" springref=\"{}\"", of("stiffness"), of("rest_position")));
                "native"
            }
            "inertia" => {
                more.push_str(&format!(" armature=\"{}\"", of("added_inertia").max(0.0)));
                if of("added_inertia") >= 0.0 { "native" } else { "not expressible" }
            }
            "constant_bias" => {
                bias += of("effort");
                "native"
            }
            "torque_gain" => {
                gear *= of("gain");
                "native"
            }
            _ => "not expressible",
        };
        notes.push(note("mjcf", file, report, &finding.effect, status));
    }
    (format!("damping=\"{damping}\" frictionloss=\"{friction}\"{more}"), gear, bias / gear)
}
