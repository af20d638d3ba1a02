//! Reads a twin as cameras see it from a URDF: meshes, limits, threads.

use std::{collections::BTreeMap, path::Path};

use super::{
    UrdfError,
    urdf::{read_description, tree_of},
    urdf_fault::UrdfFault,
};
use export::JointText;
use gap::camera::model::{tree::JointFacts, twin::SeenTwin};

/// Reads a twin with its visual meshes, and gives its text too.
///
/// # Errors
/// [`UrdfError`] as [`read_urdf`](super::read_urdf), where the text describes no bodies
/// ([`export::Description::require_sound`]), and where no link has a mesh.
pub fn read_seen_twin(path: &Path) -> Result<(SeenTwin, String), UrdfError> {
    let of_path = |e| UrdfError::of(path, e);
    let (description, text) = read_description(path)?;
    let description = description.require_numbers().map_err(of_path)?;
    let tree = tree_of(&description, path)?;
    let description = description.require_sound().map_err(of_path)?;
    // A `Tree` knows neither threads nor limits.
    let facts: BTreeMap<String, JointFacts> =
        description.joints.iter().map(|j| (j.name.clone(), facts(j))).collect();
    let twin = SeenTwin::of_tree(&tree, &facts);
    Ok((twin.map_err(|e| UrdfError::of(path, UrdfFault::Seen(e.to_string())))?, text))
}

/// Limits and pitch of a joint.
fn facts(joint: &JointText) -> JointFacts {
    let range = joint.limit.as_ref().and_then(|l| Some((l.lower?, l.upper?)));
    // Equal limits mean a joint without limits.
    JointFacts { limit: range.filter(|(low, high)| high > low), pitch_m_per_rad: joint.pitch_m_per_rad }
}
