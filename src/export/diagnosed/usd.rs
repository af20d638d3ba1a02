//! Writes the named effects into the USD text beside the twin, as attributes of its joints.
//!
//! UsdPhysics itself has limits and a drive, whose stiffness and target act as a spring. Friction and damping
//! of a joint are attributes of PhysX (`physxJointAxis`, effort) and of Newton (`newton`); angles are in
//! degrees.

use crate::diagnosed::{edits::edited, tilt::Tilt};
use gap::model::format::{JointNumbers, Spring};
use geometry::Pose;
use model::is_plain_name;

/// Start of a prim; `None` for a name that is invalid in USD, which could match in the middle of something
/// else.
fn definition(text: &str, kind: &str, name: &str) -> Option<usize> {
    if is_plain_name(name) { text.find(&format!("def {kind} \"{name}\"")) } else { None }
}

/// The text with a joint's attributes; `None` if it has no such joint.
pub(super) fn with_joint(text: &str, name: &str, turns: bool, held: &JointNumbers) -> Option<String> {
    let kind = if turns { "PhysicsRevoluteJoint" } else { "PhysicsPrismaticJoint" };
    let start = definition(text, kind, name)?;
    // By the layout of `usda.rs`: a prim in a scope opens and closes at eight spaces.
    let open = start + text[start..].find("\n        {\n")? + 11;
    let end = open + text[open..].find("\n        }")? + 1;
    let (drive, per_rad) = if turns { ("angular", 1f64.to_radians()) } else { ("linear", 1.0) };
    // Only PhysX has a separate static friction.
    let mut values = vec![
        (format!("physxJointAxis:{drive}:staticFrictionEffort"), held.friction + held.breakaway_excess),
        (format!("physxJointAxis:{drive}:dynamicFrictionEffort"), held.friction),
        (format!("physxJointAxis:{drive}:viscousFrictionCoefficient"), held.damping * per_rad),
        ("newton:friction".to_owned(), held.friction),
        ("newton:damping".to_owned(), held.damping * per_rad),
    ];
    if let Some(Spring { stiffness, rest, .. }) = held.spring {
        values.push((format!("drive:{drive}:physics:stiffness"), stiffness * per_rad));
        values.push((format!("drive:{drive}:physics:targetPosition"), rest / per_rad));
    }
    if held.armature > 0.0 {
        values.push(("newton:armature".to_owned(), held.armature));
    }
    for stop in &held.stops {
        values.push((
            format!("physics:{}Limit", if stop.is_upper { "upper" } else { "lower" }),
            stop.position / per_rad,
        ));
    }
    let mut body = text[open..end].to_owned();
    for (attribute, value) in values {
        body = with_attribute(&body, &attribute, value);
    }
    Some(format!("{}{body}{}", &text[..open], &text[end..]))
}

/// The text with the links of a joint turned, and the frame of the joint in its parent; `None` if one of them
/// is missing.
pub(super) fn with_tilt(text: &str, joint: &str, tilt: &Tilt) -> Option<String> {
    let parent = link_pose(text, &tilt.parent)?.pose;
    let mut edits = Vec::new();
    for name in &tilt.links {
        let link = link_pose(text, name)?;
        let turned = tilt.moved(&parent, &link.pose);
        let at = turned.translation.vector;
        edits.push((link.translate, format!("({}, {}, {})", at.x, at.y, at.z)));
        edits.push((link.orient, quaternion_text(&turned.rotation)));
    }
    let start = ["PhysicsRevoluteJoint", "PhysicsPrismaticJoint"]
        .iter()
        .find_map(|kind| definition(text, kind, joint))?;
    let own = value_of(text, start, "quatf physics:localRot0 = ")?;
    let given = quaternion_of(&text[own.clone()])?;
    edits.push((own, quaternion_text(&(tilt.turned_from_given.rotation * given))));
    Some(edited(text, edits))
}

/// Pose of a link in the model, and its position in the text.
struct LinkPose {
    pose: Pose,
    translate: std::ops::Range<usize>,
    orient: std::ops::Range<usize>,
}

fn link_pose(text: &str, name: &str) -> Option<LinkPose> {
    let start = definition(text, "Xform", name)?;
    let translate = value_of(text, start, "double3 xformOp:translate = ")?;
    let orient = value_of(text, start, "quatf xformOp:orient = ")?;
    let &[x, y, z] = numbers(&text[translate.clone()])?.as_slice() else { return None };
    Some(LinkPose {
        pose: Pose::from_parts([x, y, z].into(), quaternion_of(&text[orient.clone()])?),
        translate,
        orient,
    })
}

/// Range of the tuple after an attribute, between `start` and the next prim.
fn value_of(text: &str, start: usize, attribute: &str) -> Option<std::ops::Range<usize>> {
    // The next prim may have an attribute of the same name.
    let end = text[start + 4..].find("def ").map_or(text.len(), |i| start + 4 + i);
    let from = start + text[start..end].find(attribute)? + attribute.len();
    Some(from..from + text[from..end].find(')')? + 1)
}

fn numbers(tuple: &str) -> Option<Vec<f64>> {
    tuple.strip_prefix('(')?.strip_suffix(')')?.split(',').map(|x| x.trim().parse().ok()).collect()
}

fn quaternion_of(tuple: &str) -> Option<nalgebra::UnitQuaternion<f64>> {
    // USD writes the real part first.
    let &[w, x, y, z] = numbers(tuple)?.as_slice() else { return None };
    nalgebra::UnitQuaternion::try_new(nalgebra::Quaternion::new(w, x, y, z), 1e-9)
}

fn quaternion_text(q: &nalgebra::UnitQuaternion<f64>) -> String {
    format!("({}, {}, {}, {})", q.w, q.i, q.j, q.k)
}

/// Name of the `float` attribute on a line.
fn float_name(line: &str) -> Option<&str> {
    line.trim_start().strip_prefix("float ")?.split(" =").next()
}

/// Lines of attributes with one of them set, or added at the end.
fn with_attribute(body: &str, attribute: &str, value: f64) -> String {
    let line = format!("            float {attribute} = {value}\n");
    match body.split_inclusive('\n').find(|l| float_name(l) == Some(attribute)) {
        Some(old) => body.replacen(old, &line, 1),
        None => format!("{body}{line}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Base, usda};
    use gap::model::format::Stop;
    use model::example::cabinet;

    #[test]
    fn attributes_of_one_joint_are_set_in_degrees() {
        let model = cabinet();
        let text = usda(&model, &[], Base::Fixed);
        let joint = &model.joints[0];
        assert!(joint.kind.turns());
        let held = JointNumbers {
            breakaway_excess: 0.15,
            spring: Some(Spring { stiffness: 2.0, cubic: 0.0, rest: 0.3 }),
            armature: 0.01,
            stops: vec![Stop { is_upper: true, position: 0.9, stiffness: 1.0, damping: 1.0, impedance: 0.0 }],
            ..JointNumbers::without_effects(0.5, 0.25)
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
        assert!(
            with_attribute("            int a = 1\n", "newton:friction", 0.5)
                .ends_with("            float newton:friction = 0.5\n")
        );
    }

    #[test]
    fn links_of_a_tilted_joint_turn_with_it() {
        let model = cabinet();
        let text = usda(&model, &[], Base::Fixed);
        let joint = &model.joints[0];
        let names = |k: usize| model.links[k].name.clone();
        let turned = joint.parent_from_joint * Pose::rotation(nalgebra::Vector3::new(0.05, -0.1, 0.02));
        let turned_from_given = turned * joint.parent_from_joint.inverse();
        let tilt = Tilt { parent: names(joint.parent), links: vec![names(joint.child)], turned_from_given };
        let changed = with_tilt(&text, &joint.name, &tilt).unwrap();
        let mut other = model.clone();
        other.joints[0].parent_from_joint = turned;
        // As if the model had been written with the joint turned, to the digits of the file.
        let wanted = usda(&other, &[], Base::Fixed);
        for name in [names(joint.parent), names(joint.child), names(model.joints[1].child)] {
            let a = link_pose(&changed, &name).unwrap().pose;
            let b = link_pose(&wanted, &name).unwrap().pose;
            assert!((a.to_homogeneous() - b.to_homogeneous()).norm() < 1e-6, "{name}");
        }
        let frame = |text: &str| {
            let start = text.find(&format!("Joint \"{}\"", joint.name)).unwrap();
            quaternion_of(&text[value_of(text, start, "quatf physics:localRot0 = ").unwrap()]).unwrap()
        };
        assert!(
            frame(&changed).angle_to(&frame(&wanted)) < 1e-6
                && frame(&changed).angle_to(&frame(&text)) > 0.05
        );
        assert_eq!(with_tilt(&text, "lid", &tilt), None);
    }
}
