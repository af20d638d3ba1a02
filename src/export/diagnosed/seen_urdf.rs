//! Effects found by a camera in the twin's URDF: type, origin and axis of joints are changed in place;
//! effects of the camera become elements that other readers skip.

use nalgebra::{Translation3, UnitQuaternion, Vector3};
use roxmltree::Node;

use crate::diagnosed::{
    edits::{Edit, before_end, edited},
    urdf::{element, namespace_edit},
};
use common::limits::{XmlError, parse_xml};
use gap::camera::{
    judge::diagnosis::FrameDiagnosis,
    model::{hypothesis::MotionLaw, twin::SeenJoint},
};
use gap::judge::report::{ExportNote, ExportStatus};
use geometry::{AxisMotion, Pose};
use model::escape_xml;

/// Pitches below this count as zero, meters per radian.
///
/// chosen: below the written digits of a URDF
const LEAST_PITCH: f64 = 1e-9;

/// The URDF with the effects, and what became of each.
///
/// # Errors
/// [`XmlError`].
pub fn urdf(
    text: &str,
    diagnosis: &FrameDiagnosis,
    original: &[SeenJoint],
    file: &str,
) -> Result<(String, Vec<ExportNote>), XmlError> {
    let mut updated = text.to_owned();
    for (j, joint) in original.iter().enumerate() {
        let law = diagnosis.after.laws[j];
        let before =
            MotionLaw { kind: joint.kind, axis: joint.axis, point: joint.point, frame: Pose::identity() };
        if law == before {
            continue;
        }
        // Edits of one joint may touch the subtree of another, so the text is parsed again for each.
        let mut edits: Vec<Edit> = Vec::new();
        let document = parse_xml(&updated)?;
        joint_edits(&document.root_element(), &updated, joint, &law, &mut edits);
        drop(document);
        updated = edited(&updated, edits);
    }
    let mut notes = Vec::new();
    let mut elements = String::new();
    for f in &diagnosis.findings {
        let subject = f.subject.name(&diagnosis.twin);
        if f.in_urdf != "native" {
            elements.push_str(&format!(
                "  {}\n",
                element(&f.finding, &format!(" of=\"{}\"", escape_xml(subject)))
            ));
        }
        notes.push(ExportNote {
            format: "urdf".into(),
            file: file.into(),
            joint: subject.to_owned(),
            effect: f.finding.effect.clone(),
            status: ExportStatus::InFile(f.in_urdf),
            by: Vec::new(),
            rmse: (f.in_urdf == "native").then_some(diagnosis.gap.after),
            before: (f.in_urdf == "native").then_some(diagnosis.gap.before),
        });
    }
    let document = parse_xml(&updated)?;
    let foreign = updated.contains("<gap:") || !elements.is_empty();
    let mut edits: Vec<Edit> = namespace_edit(&updated, &document).filter(|_| foreign).into_iter().collect();
    edits.push((before_end(&updated, document.root_element()), elements));
    Ok((edited(&updated, edits), notes))
}

/// Sets a joint's type, origin and axis. Its frame moves onto the axis, and the child's subtree is moved
/// back.
fn joint_edits(root: &Node, text: &str, joint: &SeenJoint, law: &MotionLaw, edits: &mut Vec<Edit>) {
    let Some(node) =
        root.children().find(|n| n.has_tag_name("joint") && n.attribute("name") == Some(&joint.name))
    else {
        return;
    };
    let shift = if law.kind.is_turning() { law.point.coords } else { Vector3::zeros() };
    // A URDF joint's axis passes through the origin of its frame.
    let moved = law.frame * Translation3::from(shift);
    replace_origin(&node, text, &|old| old * moved, edits);
    let axis = law.axis.into_inner();
    set_child(&node, text, "axis", &format!("<axis xyz=\"{} {} {}\"/>", axis.x, axis.y, axis.z), edits);
    if law.kind.name() != joint.kind.name()
        && let Some(kind) = node.attribute_node("type")
    {
        let name = if law.kind.is_turning() { "revolute" } else { "prismatic" };
        if law.kind.is_turning() != joint.kind.is_turning() {
            edits.push((kind.range(), format!("type=\"{name}\"")));
            // The old limits have another unit: radians are not meters.
            let [low, high] = if law.kind.is_turning() {
                [-std::f64::consts::PI, std::f64::consts::PI]
            } else {
                [-1.0, 1.0]
            };
            set_child(
                &node,
                text,
                "limit",
                &format!("<limit lower=\"{low}\" upper=\"{high}\" effort=\"100\" velocity=\"1\"/>"),
                edits,
            );
        }
    }
    if let AxisMotion::Screw { pitch_m_per_rad } = law.kind
        && pitch_m_per_rad.abs() > LEAST_PITCH
    {
        // Declared on the element itself, as the root need not know this namespace.
        let space = "xmlns:artitwin=\"urn:artitwin:urdf\"";
        let thread =
            format!("<artitwin:thread {space} type=\"screw\" pitch_m_per_rad=\"{pitch_m_per_rad}\"/>");
        let old = node.children().find(|n| n.tag_name().name() == "thread");
        edits.push(
            old.map_or_else(|| (before_end(text, node), thread.clone()), |n| (n.range(), thread.clone())),
        );
    }
    // The frame moved, so the child's subtree is moved back to stay in place.
    if shift.norm() == 0.0 {
        return;
    }
    let back = |old: Pose| Pose::from_parts((-shift).into(), UnitQuaternion::identity()) * old;
    let child = node.children().find(|n| n.has_tag_name("child")).and_then(|n| n.attribute("link"));
    for other in root.children() {
        let hangs = |n: &Node| n.children().any(|c| c.has_tag_name("parent") && c.attribute("link") == child);
        if other.has_tag_name("joint") && hangs(&other) {
            replace_origin(&other, text, &back, edits);
        }
        if other.has_tag_name("link") && other.attribute("name") == child {
            for part in other
                .children()
                .filter(|n| ["visual", "collision", "inertial"].iter().any(|t| n.has_tag_name(*t)))
            {
                replace_origin(&part, text, &back, edits);
            }
        }
    }
}

fn three_numbers(text: &str) -> Option<[f64; 3]> {
    let values: Vec<f64> = text.split_whitespace().filter_map(|x| x.parse().ok()).collect();
    values.try_into().ok()
}

/// Replaces the origin of an element, or adds one.
fn replace_origin(node: &Node, text: &str, new: &dyn Fn(Pose) -> Pose, edits: &mut Vec<Edit>) {
    let old = node.children().find(|n| n.has_tag_name("origin"));
    let [[x, y, z], [r, p, w]] = ["xyz", "rpy"]
        .map(|name| old.and_then(|o| o.attribute(name)).and_then(three_numbers).unwrap_or_default());
    let pose = new(Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(r, p, w)));
    let (roll, pitch, yaw) = pose.rotation.euler_angles();
    let t = pose.translation.vector;
    set_child(
        node,
        text,
        "origin",
        &format!("<origin xyz=\"{} {} {}\" rpy=\"{roll} {pitch} {yaw}\"/>", t.x, t.y, t.z),
        edits,
    );
}

/// Replaces a child element, or inserts it as the first.
fn set_child(node: &Node, text: &str, name: &str, element: &str, edits: &mut Vec<Edit>) {
    match node.children().find(|n| n.has_tag_name(name)) {
        Some(old) => edits.push((old.range(), element.to_owned())),
        None => {
            let first = node.first_child().map_or(node.range().end, |n| n.range().start);
            if first < node.range().end && text.is_char_boundary(first) {
                // Empty ranges at one place keep the order of the list.
                edits.push((first..first, element.to_owned()));
            }
        }
    }
}
