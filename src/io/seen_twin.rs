//! A twin as cameras see it, from a URDF: meshes, limits, threads.

use std::{collections::BTreeMap, path::Path};

use super::{UrdfError, read_urdf, urdf::read_urdf_text, urdf_fault::UrdfFault};
use common::limits::{XmlError, parse_xml};
use export::require_sound;
use gap::camera::model::{tree::JointFacts, twin::SeenTwin};

/// Reads a twin with its visual meshes, and gives its text too.
///
/// # Errors
/// [`UrdfError`] as [`read_urdf`], where the text describes no bodies ([`require_sound`]), and where no link
/// has a mesh.
pub fn read_seen_twin(path: &Path) -> Result<(SeenTwin, String), UrdfError> {
    let format = |problem| UrdfError::Format { path: path.to_owned(), problem };
    let tree = read_urdf(path)?;
    let text = read_urdf_text(path)?;
    require_sound(&text).map_err(|e| format(e.into()))?;
    // From the XML again: a `Tree` knows neither threads nor limits.
    let facts = facts(&text).map_err(|e| format(e.into()))?;
    Ok((SeenTwin::of(&tree, &facts).map_err(|e| format(UrdfFault::Seen(e.to_string())))?, text))
}

/// Limits and pitches of the joints.
fn facts(text: &str) -> Result<BTreeMap<String, JointFacts>, XmlError> {
    let document = parse_xml(text)?;
    let number =
        |n: &roxmltree::Node, name: &str| n.attribute(name).and_then(|t| t.trim().parse::<f64>().ok());
    let of = |joint: roxmltree::Node| {
        let limit = joint.children().find(|n| n.has_tag_name("limit"));
        let range = limit
            .and_then(|l| Some((number(&l, "lower")?, number(&l, "upper")?)))
            // Equal limits are those of a joint without any.
            .filter(|(low, high)| high > low);
        // By the local name: the prefix of the namespace is the writer's choice.
        let thread = joint.children().find(|n| n.tag_name().name() == "thread");
        let pitch_m_per_rad = thread.and_then(|t| number(&t, "pitch_m_per_rad"));
        Some((joint.attribute("name")?.to_owned(), JointFacts { limit: range, pitch_m_per_rad }))
    };
    Ok(document.root_element().children().filter(|n| n.has_tag_name("joint")).filter_map(of).collect())
}
