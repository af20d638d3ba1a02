//! The named effects in the SDF that stands beside the twin: damping, friction, spring and stops of its joints.

use std::{fmt::Write as _, ops::Range};

use super::{
    expressed::Format,
    held::{Held, notes},
    joint_model::Catalogue,
    report::{ExportNote, JointReport},
    twin_tree::TwinTree,
};

/// The SDF with the effects, and what became of each. A joint that the SDF does not have is told in the notes.
///
/// # Errors
/// A sentence where the text is no XML.
pub fn sdf(
    text: &str,
    tree: &TwinTree,
    joints: &[JointReport],
    catalogue: &Catalogue,
    file: &str,
) -> Result<(String, Vec<ExportNote>), String> {
    let mut text = text.to_owned();
    let mut told = Vec::new();
    for joint in joints {
        let Some(spec) = tree.joints.iter().find(|j| j.name == joint.joint) else { continue };
        let Some(held) = Held::of(Format::Sdf, spec, joint, catalogue) else { continue };
        match with_joint(&text, &joint.joint, &held)? {
            Some(changed) => {
                text = changed;
                told.extend(notes(Format::Sdf, file, joint, None));
            }
            None => told.extend(notes(Format::Sdf, file, joint, Some("it has no such joint with an axis"))),
        }
    }
    Ok((text, told))
}

/// The text with the numbers of a joint; `None` where it has no such joint with an axis.
fn with_joint(text: &str, name: &str, held: &Held) -> Result<Option<String>, String> {
    let document = roxmltree::Document::parse(text).map_err(|e| e.to_string())?;
    let element = document.descendants().find(|n| n.has_tag_name("joint") && n.attribute("name") == Some(name));
    let Some(axis) = element.and_then(|e| e.children().find(|n| n.has_tag_name("axis"))) else { return Ok(None) };
    let mut edits: Vec<(Range<usize>, String)> = limit(text, axis, held).into_iter().collect();
    edits.push(dynamics(text, axis, held));
    edits.sort_by_key(|(range, _)| range.start);
    let mut changed = text.to_owned();
    for (range, new) in edits.into_iter().rev() {
        changed.replace_range(range, &new);
    }
    Ok(Some(changed))
}

/// The `dynamics` of an axis anew.
fn dynamics(text: &str, axis: roxmltree::Node, held: &Held) -> (Range<usize>, String) {
    let mut new = format!("<dynamics><damping>{}</damping><friction>{}</friction>", held.damping, held.friction);
    let old = axis.children().find(|n| n.has_tag_name("dynamics"));
    let kept = |tag: &str| old.and_then(|d| d.children().find(|n| n.has_tag_name(tag))).and_then(|n| n.text().map(str::to_owned));
    let spring = held.spring.map(|(k, q)| (q.to_string(), k.to_string()));
    let (reference, stiffness) = spring.unwrap_or_else(|| {
        let or_zero = |tag: &str| kept(tag).unwrap_or_else(|| "0".to_owned());
        (or_zero("spring_reference"), or_zero("spring_stiffness"))
    });
    // Writing to a string cannot fail.
    write!(new, "<spring_reference>{reference}</spring_reference><spring_stiffness>{stiffness}</spring_stiffness></dynamics>").ok();
    (old.map_or_else(|| before_end(text, axis), |o| o.range()), new)
}

/// The `limit` of an axis with stops, where there are any.
fn limit(text: &str, axis: roxmltree::Node, held: &Held) -> Option<(Range<usize>, String)> {
    if held.stops.is_empty() {
        return None;
    }
    let old = axis.children().find(|n| n.has_tag_name("limit"));
    let changed = |tag: &str| held.stops.iter().any(|s| tag == if s.is_upper { "upper" } else { "lower" });
    let kept = old.iter().flat_map(|l| l.children()).filter(|n| n.is_element());
    let kept = kept.filter(|n| !changed(n.tag_name().name()) && !matches!(n.tag_name().name(), "stiffness" | "dissipation"));
    let mut new = String::from("<limit>");
    kept.for_each(|n| new.push_str(&text[n.range()]));
    for stop in &held.stops {
        let tag = if stop.is_upper { "upper" } else { "lower" };
        write!(new, "<{tag}>{}</{tag}>", stop.position).ok();
    }
    // One stiffness serves both ends.
    let stiffest = held.stops.iter().max_by(|a, b| a.stiffness.total_cmp(&b.stiffness))?;
    write!(new, "<stiffness>{}</stiffness><dissipation>{}</dissipation></limit>", stiffest.stiffness, stiffest.damping).ok();
    Some((old.map_or_else(|| before_end(text, axis), |o| o.range()), new))
}

/// The empty range before the closing tag of an element.
fn before_end(text: &str, node: roxmltree::Node) -> Range<usize> {
    let range = node.range();
    let at = text[range.clone()].rfind("</").map_or(range.end, |i| range.start + i);
    at..at
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gap::held::HeldStop;

    const TEXT: &str = "<sdf version=\"1.9\"><model name=\"m\"><joint name=\"other\" type=\"revolute\"><axis><xyz>0 0 1</xyz></axis></joint>\
        <joint name=\"door\" type=\"revolute\"><axis><xyz>0 0 1</xyz><limit><lower>-1</lower><upper>2</upper><effort>9</effort></limit>\
        <dynamics><damping>0.3</damping><friction>0</friction><spring_reference>0.1</spring_reference><spring_stiffness>4</spring_stiffness>\
        </dynamics></axis></joint></model></sdf>";

    /// Text of a tag below a joint.
    fn told(text: &str, joint: &str, tag: &str) -> Option<f64> {
        let document = roxmltree::Document::parse(text).unwrap();
        let joint = document.descendants().find(|n| n.attribute("name") == Some(joint)).unwrap();
        let mut found = joint.descendants().filter(|n| n.has_tag_name(tag));
        let value = found.next().map(|n| n.text().unwrap().parse().unwrap());
        assert!(found.next().is_none(), "{tag} twice");
        value
    }

    #[test]
    fn what_changed_is_replaced_and_the_rest_stays() {
        let mut held = Held { damping: 0.5, friction: 0.25, ..Held::default() };
        let text = with_joint(TEXT, "door", &held).unwrap().unwrap();
        let of = |tag| told(&text, "door", tag).unwrap();
        assert_eq!([of("damping"), of("friction"), of("spring_stiffness"), of("spring_reference")], [0.5, 0.25, 4.0, 0.1]);
        assert_eq!([of("lower"), of("upper"), of("effort")], [-1.0, 2.0, 9.0]);
        assert_eq!(told(&text, "other", "damping"), None);
        held.spring = Some((7.0, 0.4));
        held.stops = vec![HeldStop { is_upper: true, position: 1.5, stiffness: 900.0, damping: 3.0 }];
        let text = with_joint(TEXT, "door", &held).unwrap().unwrap();
        let of = |tag| told(&text, "door", tag).unwrap();
        assert_eq!([of("spring_stiffness"), of("spring_reference"), of("lower"), of("upper")], [7.0, 0.4, -1.0, 1.5]);
        assert_eq!([of("stiffness"), of("dissipation"), of("effort")], [900.0, 3.0, 9.0]);
    }

    #[test]
    fn an_axis_without_them_gets_them_and_a_joint_that_is_not_there_is_told() {
        let held = Held { friction: 0.25, ..Held::default() };
        let text = with_joint(TEXT, "other", &held).unwrap().unwrap();
        assert_eq!(told(&text, "other", "friction"), Some(0.25));
        assert_eq!(with_joint(TEXT, "lid", &held), Ok(None));
        assert!(with_joint("<sdf", "lid", &held).is_err());
    }
}
