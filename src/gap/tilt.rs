//! A turned joint in files that place every link in the frame of the model (SDF, USD): all links that it carries turn with it.

use super::{
    expressed::tilted,
    joint_model::Catalogue,
    report::{ExportNote, JointReport},
    twin_tree::TwinTree,
};
use crate::geometry::Pose;

/// A joint that is turned about its origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Tilt {
    /// Link that stays.
    pub parent: String,
    /// Links that turn.
    pub links: Vec<String>,
    /// Where what the joint carries stands, from where it stood; frame of the parent.
    pub turned_from_given: Pose,
}

/// The turn of a joint whose axis was found tilted; `None` where it was not, or where no turn loads the joint so.
#[must_use]
pub fn tilt(tree: &TwinTree, joint: &JointReport, catalogue: &Catalogue) -> Option<Tilt> {
    let term = joint.diagnosis.model.terms.iter().find(|t| catalogue[t.effect].name() == EFFECT)?;
    let index = tree.joints.iter().position(|j| j.name == joint.joint)?;
    let spec = &tree.joints[index];
    let turned = tilted(tree, index, term.p[0], term.p[1])?;
    let links = (0..tree.links.len()).filter(|l| tree.carries(index, *l)).map(|l| tree.links[l].name.clone()).collect();
    Some(Tilt { parent: tree.links[spec.parent].name.clone(), links, turned_from_given: turned * spec.parent_from_joint.inverse() })
}

impl Tilt {
    /// The pose of a carried link in the frame of the model, from its pose and its joint's parent's there.
    #[must_use]
    pub fn moved(&self, model_from_parent: &Pose, model_from_link: &Pose) -> Pose {
        model_from_parent * self.turned_from_given * model_from_parent.inverse() * model_from_link
    }
}

/// Says of a file that its links could not be turned.
pub fn untold(notes: &mut [ExportNote]) {
    for note in notes.iter_mut().filter(|n| n.effect == EFFECT) {
        (note.status, note.rmse) = ("not written: the file does not place the links of this joint as expected".into(), None);
    }
}

/// The effect.
const EFFECT: &str = "axis_tilt";
