//! The named effects in the SDF beside the twin: damping, friction, spring and stops of its
//! joints, and the links of a joint with a tilted axis.

use std::fmt::Write as _;

use crate::diagnosed::{
    edits::{Edit, before_end, edited},
    tilt::Tilt,
};
use common::limits::{XmlError, parse_xml};
use gap::model::format::JointNumbers;
use geometry::Pose;

/// The text with the links of a joint turned; `None` if one of them is missing, or is placed relative to a
/// frame other than the model's.
pub(super) fn with_tilt(text: &str, tilt: &Tilt) -> Result<Option<String>, XmlError> {
    let document = parse_xml(text)?;
    let Some(parent) = link_node(&document, &tilt.parent).and_then(pose_of) else { return Ok(None) };
    let mut edits = Vec::new();
    for name in &tilt.links {
        let Some((node, pose)) = link_node(&document, name).and_then(|n| Some((n, pose_of(n)?))) else {
            return Ok(None);
        };
        let turned = tilt.moved(&parent, &pose);
        let at = turned.translation.vector;
        let (roll, pitch, yaw) = turned.rotation.euler_angles();
        let new = format!("<pose>{} {} {} {roll} {pitch} {yaw}</pose>", at.x, at.y, at.z);
        let old = node.children().find(|n| n.has_tag_name("pose"));
        edits.push((old.map_or_else(|| before_end(text, node), |n| n.range()), new));
    }
    Ok(Some(edited(text, edits)))
}

/// Pose of a link in the frame of the model; `None` if it is given in another frame.
fn pose_of(link: roxmltree::Node) -> Option<Pose> {
    let Some(pose) = link.children().find(|n| n.has_tag_name("pose")) else { return Some(Pose::identity()) };
    // `relative_to`, `degrees` and `rotation_format` give the numbers another meaning.
    if pose.attributes().len() > 0 {
        return None;
    }
    let numbers: Vec<f64> = pose.text()?.split_whitespace().map(|x| x.parse().ok()).collect::<Option<_>>()?;
    let &[x, y, z, roll, pitch, yaw] = numbers.as_slice() else { return None };
    Some(Pose::from_parts([x, y, z].into(), nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}

/// The text with the numbers of a joint; `None` if it has no such joint with an axis.
pub(super) fn with_joint(text: &str, name: &str, held: &JointNumbers) -> Result<Option<String>, XmlError> {
    let document = parse_xml(text)?;
    let element =
        document.descendants().find(|n| n.has_tag_name("joint") && n.attribute("name") == Some(name));
    let Some(axis) = element.and_then(|e| e.children().find(|n| n.has_tag_name("axis"))) else {
        return Ok(None);
    };
    let mut edits: Vec<Edit> = limit(text, axis, held).into_iter().collect();
    edits.push(dynamics(text, axis, held));
    Ok(Some(edited(text, edits)))
}

fn link_node<'a, 'input>(
    document: &'a roxmltree::Document<'input>,
    name: &str,
) -> Option<roxmltree::Node<'a, 'input>> {
    document.descendants().find(|n| n.has_tag_name("link") && n.attribute("name") == Some(name))
}

/// A new `dynamics` element for an axis.
fn dynamics(text: &str, axis: roxmltree::Node, held: &JointNumbers) -> Edit {
    let mut new =
        format!("<dynamics><damping>{}</damping><friction>{}</friction>", held.damping, held.friction);
    let old = axis.children().find(|n| n.has_tag_name("dynamics"));
    let spring = held.spring.map(|s| [s.rest.to_string(), s.stiffness.to_string()]);
    let [reference, stiffness] = spring.unwrap_or_else(|| {
        ["spring_reference", "spring_stiffness"].map(|tag| {
            let kept = old.and_then(|d| d.children().find(|n| n.has_tag_name(tag))).and_then(|n| n.text());
            kept.unwrap_or("0").to_owned()
        })
    });
    // Writing to a string cannot fail.
    write!(new, "<spring_reference>{reference}</spring_reference>").ok();
    write!(new, "<spring_stiffness>{stiffness}</spring_stiffness></dynamics>").ok();
    (old.map_or_else(|| before_end(text, axis), |o| o.range()), new)
}

/// A new `limit` element for an axis with stops, if there are any.
fn limit(text: &str, axis: roxmltree::Node, held: &JointNumbers) -> Option<Edit> {
    if held.stops.is_empty() {
        return None;
    }
    let old = axis.children().find(|n| n.has_tag_name("limit"));
    let changed = |tag: &str| held.stops.iter().any(|s| tag == if s.is_upper { "upper" } else { "lower" });
    // The rest is kept: the other end, effort, velocity.
    let kept = old.iter().flat_map(|l| l.children()).filter(|n| n.is_element());
    let kept = kept.filter(|n| {
        !changed(n.tag_name().name()) && !matches!(n.tag_name().name(), "stiffness" | "dissipation")
    });
    let mut new = String::from("<limit>");
    kept.for_each(|n| new.push_str(&text[n.range()]));
    for stop in &held.stops {
        let tag = if stop.is_upper { "upper" } else { "lower" };
        write!(new, "<{tag}>{}</{tag}>", stop.position).ok();
    }
    // One stiffness serves both ends.
    let stiffest = held.stops.iter().max_by(|a, b| a.stiffness.total_cmp(&b.stiffness))?;
    write!(
        new,
        "<stiffness>{}</stiffness><dissipation>{}</dissipation></limit>",
        stiffest.stiffness, stiffest.damping
    )
    .ok();
    Some((old.map_or_else(|| before_end(text, axis), |o| o.range()), new))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gap::model::format::{Spring, Stop};

    const TEXT: &str = "<sdf version=\"1.9\"><model name=\"m\"><joint name=\"other\" \
     type=\"revolute\"><axis><xyz>0 0 1</xyz></axis></joint>\
        <joint name=\"door\" type=\"revolute\"><axis><xyz>0 0 \
        1</xyz><limit><lower>-1</lower><upper>2</upper><effort>9</effort></limit>\
        <dynamics><damping>0.3</damping><friction>0</friction><spring_reference>0.1</spring_reference>\
        <spring_stiffness>4</spring_stiffness>\
        </dynamics></axis></joint></model></sdf>";

    /// Text of a tag below a joint.
    fn value_of(text: &str, joint: &str, tag: &str) -> Option<f64> {
        let document = roxmltree::Document::parse(text).unwrap();
        let joint = document.descendants().find(|n| n.attribute("name") == Some(joint)).unwrap();
        let mut found = joint.descendants().filter(|n| n.has_tag_name(tag));
        let value = found.next().map(|n| n.text().unwrap().parse().unwrap());
        assert!(found.next().is_none(), "{tag} twice");
        value
    }

    #[test]
    fn what_changed_is_replaced_and_the_rest_stays() {
        let mut held = JointNumbers::without_effects(0.5, 0.25);
        let text = with_joint(TEXT, "door", &held).unwrap().unwrap();
        let of = |tag| value_of(&text, "door", tag).unwrap();
        assert_eq!(
            [of("damping"), of("friction"), of("spring_stiffness"), of("spring_reference")],
            [0.5, 0.25, 4.0, 0.1]
        );
        assert_eq!([of("lower"), of("upper"), of("effort")], [-1.0, 2.0, 9.0]);
        assert_eq!(value_of(&text, "other", "damping"), None);
        held.spring = Some(Spring { stiffness: 7.0, cubic: 0.0, rest: 0.4 });
        held.stops =
            vec![Stop { is_upper: true, position: 1.5, stiffness: 900.0, damping: 3.0, impedance: 0.0 }];
        let text = with_joint(TEXT, "door", &held).unwrap().unwrap();
        let of = |tag| value_of(&text, "door", tag).unwrap();
        assert_eq!(
            [of("spring_stiffness"), of("spring_reference"), of("lower"), of("upper")],
            [7.0, 0.4, -1.0, 1.5]
        );
        assert_eq!([of("stiffness"), of("dissipation"), of("effort")], [900.0, 3.0, 9.0]);
    }

    #[test]
    fn an_axis_without_them_gets_them_and_a_joint_that_is_not_there_is_told() {
        let held = JointNumbers::without_effects(0.0, 0.25);
        let text = with_joint(TEXT, "other", &held).unwrap().unwrap();
        assert_eq!(value_of(&text, "other", "friction"), Some(0.25));
        assert_eq!(with_joint(TEXT, "lid", &held), Ok(None));
        assert!(with_joint("<sdf", "lid", &held).is_err());
    }

    #[test]
    fn links_of_a_tilted_joint_turn_about_it_and_others_stay() {
        let text = "<sdf><model><link name=\"base\"><pose>1 0 0 0 0 1.5707963267948966</pose></link>\
            <link name=\"door\"><pose>1 2 0 0 0 1.5707963267948966</pose><inertial><pose>0.4 0 0 0 0 \
            0</pose></inertial></link>\
            <link name=\"knob\"><pose>1 2.5 0 0 0 0</pose></link></model></sdf>";
        // The joint stands 2 m along x of the base, which is y of the model, and is turned by 0.1 about that
        // axis.
        let joint = Pose::translation(2.0, 0.0, 0.0);
        let turned = joint * Pose::rotation(nalgebra::Vector3::new(0.1, 0.0, 0.0));
        let links = vec!["door".to_owned(), "knob".to_owned()];
        let tilt = Tilt { parent: "base".into(), links, turned_from_given: turned * joint.inverse() };
        let changed = with_tilt(text, &tilt).unwrap().unwrap();
        let document = roxmltree::Document::parse(&changed).unwrap();
        let link = |name: &str| {
            pose_of(document.descendants().find(|n| n.attribute("name") == Some(name)).unwrap()).unwrap()
        };
        let of = |x, y, rpy: [f64; 3]| {
            Pose::from_parts(
                [x, y, 0.0].into(),
                nalgebra::UnitQuaternion::from_euler_angles(rpy[0], rpy[1], rpy[2]),
            )
        };
        let about_y = Pose::rotation(nalgebra::Vector3::new(0.0, 0.1, 0.0));
        let quarter = std::f64::consts::FRAC_PI_2;
        for (name, wanted) in [
            ("base", of(1.0, 0.0, [0.0, 0.0, quarter])),
            ("door", Pose::translation(1.0, 2.0, 0.0) * about_y * of(0.0, 0.0, [0.0, 0.0, quarter])),
            ("knob", Pose::translation(1.0, 2.5, 0.0) * about_y),
        ] {
            assert!(
                (link(name).to_homogeneous() - wanted.to_homogeneous()).norm() < 1e-12,
                "{name}: {}",
                link(name)
            );
        }
        assert!(changed.contains("<inertial><pose>0.4 0 0 0 0 0</pose></inertial>"));
        let other = text.replace("<pose>1 2.5", "<pose relative_to=\"door\">1 2.5");
        assert_eq!(with_tilt(&other, &tilt), Ok(None));
    }
}
