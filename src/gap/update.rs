//! The named effects in the twin's URDF: natively where it has a place, in a namespaced element elsewhere.

use super::{
    expressed::{Format, Status, status},
    report::{ExportNote, JointReport},
    twin_tree::TwinTree,
};

/// Namespace of the elements that other readers skip.
const NAMESPACE: &str = "xmlns:gap=\"https://artitwin.invalid/gap\"";

/// Effects that leave the recording with the twin.
pub(super) fn exported(joint: &JointReport) -> impl Iterator<Item = &super::verdict::Finding> {
    joint.diagnosis.findings.iter().filter(|f| f.effect != "disturbance")
}

/// The URDF with the effects, and what became of each. Damping and friction are changed in place; all other effects
/// are elements of the joint.
#[must_use]
pub fn urdf(text: &str, tree: &TwinTree, joints: &[JointReport], file: &str) -> (String, Vec<ExportNote>) {
    let mut text = text.to_owned();
    let mut notes = Vec::new();
    for joint in joints {
        let Some(spec) = tree.joints.iter().find(|j| j.name == joint.joint) else { continue };
        let mut dynamics = (spec.damping, spec.friction);
        let mut elements = String::new();
        for finding in exported(joint) {
            let Some(term) = joint.diagnosis.model.terms.iter().find(|t| t.effect == finding.index) else { continue };
            let status = status(Format::Urdf, &finding.effect, &term.p, &joint.diagnosis.model.plant);
            let native = status == Status::Native;
            match finding.effect.as_str() {
                "viscous_friction" if native => dynamics.0 += term.p[0],
                "coulomb_friction" => dynamics.1 += term.p[0],
                _ => {}
            }
            if !native {
                elements.push_str(&element(finding, ""));
            }
            notes.push(note("urdf", file, joint, &finding.effect, status));
        }
        text = with_joint(&text, &joint.joint, (dynamics.0.max(0.0), dynamics.1), (spec.damping, spec.friction), &elements);
    }
    (with_namespace(text), notes)
}

/// An effect as an element that other readers skip, with further `attributes`.
pub(super) fn element(finding: &super::verdict::Finding, attributes: &str) -> String {
    let parameter =
        |p: &super::verdict::ParameterEstimate| format!("<gap:parameter name=\"{}\" value=\"{}\" unit=\"{}\"/>", p.name, p.value, p.unit);
    let parameters: String = finding.parameters.iter().map(parameter).collect();
    format!("<gap:effect name=\"{}\"{attributes}>{parameters}</gap:effect>", finding.effect)
}

/// Declares the namespace of such elements where a robot has any.
pub(super) fn with_namespace(text: String) -> String {
    let missing = text.contains("<gap:") && !text.contains(NAMESPACE);
    if missing { text.replacen("<robot ", &format!("<robot {NAMESPACE} "), 1) } else { text }
}

/// What became of an effect in a file; the RMSE is that of the joint's whole model in the format.
pub(super) fn note(format: &str, file: &str, joint: &JointReport, effect: &str, status: Status) -> ExportNote {
    let rmse = joint.in_format.iter().find(|(f, _)| *f == format).map(|(_, rmse)| *rmse);
    ExportNote {
        format: format.into(),
        file: file.into(),
        joint: joint.joint.clone(),
        effect: effect.into(),
        status: status.name().into(),
        rmse,
    }
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
