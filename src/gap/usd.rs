//! The named effects in the USD text that stands beside the twin: attributes of its joints.
//!
//! UsdPhysics itself has limits and a drive, whose stiffness and target are a spring. Friction and damping of a joint are
//! attributes of PhysX (`physxJointAxis`, effort) and of Newton (`newton`); angles are degrees.

use super::{
    expressed::Format,
    held::{Held, notes},
    joint_model::Catalogue,
    report::{ExportNote, JointReport},
    twin_tree::{Motion, TwinTree},
};

/// The USD text with the effects, and what became of each. A joint that the text does not have is told in the notes.
#[must_use]
pub fn usd(text: &str, tree: &TwinTree, joints: &[JointReport], catalogue: &Catalogue, file: &str) -> (String, Vec<ExportNote>) {
    let mut text = text.to_owned();
    let mut told = Vec::new();
    for joint in joints {
        let Some(spec) = tree.joints.iter().find(|j| j.name == joint.joint) else { continue };
        let Some(held) = Held::of(Format::Usd, spec, joint, catalogue) else { continue };
        match with_joint(&text, &joint.joint, spec.motion == Motion::Turn, &held) {
            Some(changed) => {
                text = changed;
                told.extend(notes(Format::Usd, file, joint, None));
            }
            None => told.extend(notes(Format::Usd, file, joint, Some("it has no such joint"))),
        }
    }
    (text, told)
}

/// The text with a joint's attributes; `None` where it has no such joint.
fn with_joint(text: &str, name: &str, turns: bool, held: &Held) -> Option<String> {
    let kind = if turns { "PhysicsRevoluteJoint" } else { "PhysicsPrismaticJoint" };
    let start = text.find(&format!("def {kind} \"{name}\""))?;
    let open = start + text[start..].find("\n        {\n")? + 11;
    let end = open + text[open..].find("\n        }")? + 1;
    let (drive, per_rad) = if turns { ("angular", 1f64.to_radians()) } else { ("linear", 1.0) };
    let mut values = vec![
        (format!("physxJointAxis:{drive}:staticFrictionEffort"), held.breakaway),
        (format!("physxJointAxis:{drive}:dynamicFrictionEffort"), held.friction),
        (format!("physxJointAxis:{drive}:viscousFrictionCoefficient"), held.damping * per_rad),
        ("newton:friction".to_owned(), held.friction),
        ("newton:damping".to_owned(), held.damping * per_rad),
    ];
    if let Some((stiffness, rest)) = held.spring {
        values.push((format!("drive:{drive}:physics:stiffness"), stiffness * per_rad));
        values.push((format!("drive:{drive}:physics:targetPosition"), rest / per_rad));
    }
    if held.armature > 0.0 {
        values.push(("newton:armature".to_owned(), held.armature));
    }
    for stop in &held.stops {
        values.push((format!("physics:{}Limit", if stop.is_upper { "upper" } else { "lower" }), stop.position / per_rad));
    }
    let mut body = text[open..end].to_owned();
    for (attribute, value) in values {
        body = with_attribute(&body, &attribute, value);
    }
    Some(format!("{}{body}{}", &text[..open], &text[end..]))
}

/// Lines of attributes with one of them set, or added at the end.
fn with_attribute(body: &str, attribute: &str, value: f64) -> String {
    let line = format!("            float {attribute} = {value}\n");
    let is_it = |l: &&str| l.trim_start().strip_prefix("float ").is_some_and(|l| l.split(" =").next() == Some(attribute));
    match body.split_inclusive('\n').find(is_it) {
        Some(old) => body.replacen(old, &line, 1),
        None => format!("{body}{line}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{export::usda, gap::held::HeldStop, model::example::cabinet};

    #[test]
    fn attributes_of_one_joint_are_set_in_degrees() {
        let model = cabinet();
        let text = usda(&model, &[]);
        let joint = &model.joints[0];
        assert!(joint.kind.turns());
        let held = Held {
            damping: 0.5,
            friction: 0.25,
            breakaway: 0.4,
            spring: Some((2.0, 0.3)),
            armature: 0.01,
            stops: vec![HeldStop { is_upper: true, position: 0.9, stiffness: 1.0, damping: 1.0 }],
        };
        let changed = with_joint(&text, &joint.name, true, &held).unwrap();
        let per_rad = 1f64.to_radians();
        for (attribute, value) in [
            ("physxJointAxis:angular:staticFrictionEffort", 0.4),
            ("physxJointAxis:angular:dynamicFrictionEffort", 0.25),
            ("newton:damping", 0.5 * per_rad),
            ("drive:angular:physics:stiffness", 2.0 * per_rad),
            ("drive:angular:physics:targetPosition", 0.3 / per_rad),
            ("newton:armature", 0.01),
            ("physics:upperLimit", 0.9 / per_rad),
        ] {
            assert!(changed.contains(&format!("            float {attribute} = {value}\n")), "{attribute}");
        }
        assert_eq!(changed.lines().count(), text.lines().count());
        // The other joint is as it was.
        let tail = |t: &str| t[t.find(&format!("Joint \"{}\"", model.joints[1].name)).unwrap()..].to_owned();
        assert_eq!(tail(&changed), tail(&text));
        assert_eq!(with_joint(&text, "lid", true, &held), None);
        assert!(with_attribute("            int a = 1\n", "newton:friction", 0.5).ends_with("            float newton:friction = 0.5\n"));
    }
}
