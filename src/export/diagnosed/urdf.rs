//! Writes the named effects into the twin's URDF: natively if URDF has a place for them, else in a namespaced
//! element.

use roxmltree::{Document, Node};

use crate::diagnosed::{
    edits::{Edit, before_end, edited},
    numbers::{held, joint_numbers, notes},
};
use common::limits::{XmlError, parse_xml};
use gap::{
    judge::{
        finding::{Finding, ParameterEstimate},
        format_model::Fate,
        report::{ExportNote, JointReport},
    },
    model::{format::Format, joint_model::Catalogue},
    twin_tree::TwinTree,
};

/// Namespace of the elements, which other readers skip.
const NAMESPACE: &str = "xmlns:gap=\"https://artitwin.invalid/gap\"";

/// The URDF with the effects, and what became of each. Damping and friction are changed in place; all other
/// effects become elements of the joint.
///
/// # Errors
/// [`XmlError`].
pub fn urdf(
    text: &str,
    tree: &TwinTree,
    joints: &[JointReport],
    catalogue: &Catalogue,
    file: &str,
) -> Result<(String, Vec<ExportNote>), XmlError> {
    let document = parse_xml(text)?;
    let mut edits = Vec::new();
    let mut remarks = Vec::new();
    // A twin that was diagnosed before may have such elements.
    let mut foreign = text.contains("<gap:");
    for joint in joints {
        let Some(spec) = tree.joints.iter().find(|j| j.name == joint.joint) else { continue };
        let old = (spec.damping, spec.friction);
        let numbers = joint_numbers(Format::Urdf, spec, joint, catalogue);
        let dynamics = numbers.map_or(old, |n| (n.damping, n.friction));
        let mut elements = String::new();
        for effect in held(Format::Urdf, joint).into_iter().flat_map(|h| &h.effects) {
            let found = joint.diagnosis.findings.iter().find(|f| Some(f.index) == effect.effect);
            if let Some(finding) = found.filter(|_| effect.fate != Fate::Native) {
                // A reader of these elements must know which effects the joint's own numbers already include.
                elements.push_str(&element(finding, &format!(" status=\"{}\"", effect.fate.name())));
            }
        }
        remarks.extend(notes(Format::Urdf, file, joint, catalogue));
        foreign |= !elements.is_empty();
        // If no effect changed a number, the element stays as it was written.
        let changed = (dynamics != old).then_some(dynamics);
        edits.extend(
            joint_of(&document, &joint.joint)
                .into_iter()
                .flat_map(|n| joint_edits(text, n, changed, &elements)),
        );
    }
    edits.extend(namespace_edit(text, &document).filter(|_| foreign));
    Ok((edited(text, edits), remarks))
}

/// An effect as an element that other readers skip, with further `attributes`.
pub fn element(finding: &Finding, attributes: &str) -> String {
    let parameters: String = finding.parameters.iter().map(parameter_element).collect();
    format!("<gap:effect name=\"{}\"{attributes}>{parameters}</gap:effect>", finding.effect)
}

fn parameter_element(p: &ParameterEstimate) -> String {
    format!("<gap:parameter name=\"{}\" value=\"{}\" unit=\"{}\"/>", p.name, p.value, p.unit)
}

/// Declares the namespace of these elements at the root, if it is missing.
pub fn namespace_edit(text: &str, document: &Document) -> Option<Edit> {
    let root = document.root_element();
    let at = root.range().start
        + 1
        + text[root.range().start + 1..].find(|c: char| c.is_whitespace() || "/>".contains(c))?;
    (!text.contains(NAMESPACE)).then(|| (at..at, format!(" {NAMESPACE}")))
}

/// The joint with this name among the children of `<robot>`, if it has content to change.
fn joint_of<'a>(document: &'a Document<'a>, name: &str) -> Option<Node<'a, 'a>> {
    // Only children of `<robot>`: a `<transmission>` also has elements with the names of joints.
    let is_it = |n: &Node| n.has_tag_name("joint") && n.attribute("name") == Some(name) && n.has_children();
    document.root_element().children().find(is_it)
}

/// Replaces the dynamics of a joint and adds elements to it.
fn joint_edits(text: &str, joint: Node, dynamics: Option<(f64, f64)>, elements: &str) -> Vec<Edit> {
    let mut edits = Vec::new();
    let mut added = String::new();
    if let Some((damping, friction)) = dynamics {
        edits.extend(
            joint.children().find(|n| n.has_tag_name("dynamics")).map(|old| (old.range(), String::new())),
        );
        added = format!("<dynamics damping=\"{damping}\" friction=\"{friction}\"/>");
    }
    added.push_str(elements);
    if !added.is_empty() {
        edits.push((before_end(text, joint), added));
    }
    edits
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::escape_xml;

    #[test]
    fn the_joint_of_a_name_is_changed_and_no_text_that_looks_like_it() {
        let name = "j\"/><joint name=\"injected\" type=\"slide";
        let text = format!(
            "<!-- <robot > <joint name=\"door\"></joint> --><robot\n name='r'><joint name=\"{}\"><dynamics \
             damping=\"1\"/></joint>\
             <transmission><joint name=\"door\"><x/></joint></transmission><joint  \
             name='door'><axis/><dynamics damping='2'></dynamics><y/>\
             </joint><joint name=\"bare\"/></robot><!-- </robot> -->",
            escape_xml(name)
        );
        let document = Document::parse(&text).unwrap();
        let mut edits = vec![];
        for (k, name) in [name, "door"].into_iter().enumerate() {
            let joint = joint_of(&document, name).unwrap();
            edits.extend(joint_edits(
                &text,
                joint,
                Some((k as f64, 0.5)),
                &format!("<gap:effect name=\"e{k}\"/>"),
            ));
        }
        edits.extend(namespace_edit(&text, &document));
        assert!(joint_of(&document, "bare").is_none() && joint_of(&document, "injected").is_none());
        let changed = edited(&text, edits);
        let document = Document::parse(&changed).unwrap();
        for (k, name) in [name, "door"].into_iter().enumerate() {
            let joint = joint_of(&document, name).unwrap();
            let all: Vec<_> = joint
                .children()
                .filter(|n| n.has_tag_name("dynamics"))
                .map(|n| n.attribute("damping"))
                .collect();
            assert_eq!(all, [Some(k.to_string().as_str())]);
            assert!(
                joint
                    .children()
                    .any(|n| n.has_tag_name("effect") && n.attribute("name") == Some(&format!("e{k}")))
            );
        }
        assert_eq!(document.descendants().filter(|n| n.has_tag_name("effect")).count(), 2);
        assert!(
            changed.contains(
                "<axis/><y/><dynamics damping=\"1\" friction=\"0.5\"/><gap:effect name=\"e1\"/></joint>"
            ),
            "{changed}"
        );
    }
}
