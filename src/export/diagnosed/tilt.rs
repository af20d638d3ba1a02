//! Files that place every link in the frame of the model (SDF, USD): the numbers of a joint are set in their
//! text, and all links that a turned joint carries turn with it.

use crate::diagnosed::{
    numbers::{UNTURNED, joint_numbers, missing, notes},
    sdf, usd,
};
use common::limits::XmlError;
use gap::{
    judge::report::{ExportNote, JointReport},
    model::{
        format::{Format, JointNumbers},
        joint_model::Catalogue,
        plant::Plant,
    },
    twin_tree::{Motion, TwinTree},
};
use geometry::Pose;

/// A joint turned about its origin.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tilt {
    /// Name of the link that stays.
    pub parent: String,
    /// Names of the turned links.
    pub links: Vec<String>,
    /// Maps the old pose of a carried link to the new one, in the frame of the parent.
    pub turned_from_given: Pose,
}

/// The text of an SDF or USD file with the effects, and what became of each. Notes name joints missing in the
/// text.
///
/// # Errors
/// [`XmlError`] of an SDF.
pub fn placed_text(
    format: Format,
    text: &str,
    tree: &TwinTree,
    joints: &[JointReport],
    catalogue: &Catalogue,
    file: &str,
) -> Result<(String, Vec<ExportNote>), XmlError> {
    let mut text = text.to_owned();
    let mut all = Vec::new();
    for joint in joints {
        let name = &joint.joint;
        let Some(spec) = tree.joints.iter().find(|j| j.name == *name) else { continue };
        let Some(held) = joint_numbers(format, spec, joint, catalogue) else {
            all.extend(notes(format, file, joint, catalogue));
            continue;
        };
        let is_usd = format == Format::Usd;
        // A change shifts what stands after it, so every joint is looked up in the current text.
        let changed = if is_usd {
            usd::with_joint(&text, name, spec.motion == Motion::Turn, &held)
        } else {
            sdf::with_joint(&text, name, &held)?
        };
        let Some(changed) = changed else {
            all.extend(missing(format, joint, catalogue, "it has no such joint with an axis"));
            continue;
        };
        let turned = match (held.tilt, tilt(tree, name, &held)) {
            (None, _) => Some(changed),
            (Some(_), None) => None,
            (Some(_), Some(tilt)) if is_usd => usd::with_tilt(&changed, name, &tilt),
            (Some(_), Some(tilt)) => sdf::with_tilt(&changed, &tilt)?,
        };
        if let Some(turned) = turned {
            text = turned;
            all.extend(notes(format, file, joint, catalogue));
        } else {
            // Without the turn, the other effects were not tested.
            all.extend(missing(format, joint, catalogue, UNTURNED));
        }
    }
    Ok((text, all))
}

/// The turn of a joint that takes a given load off it; `None` without a load or a solution.
pub(super) fn tilt(tree: &TwinTree, joint: &str, numbers: &JointNumbers) -> Option<Tilt> {
    let [sine, cosine] = numbers.tilt?;
    let index = tree.joints.iter().position(|j| j.name == joint)?;
    let spec = &tree.joints[index];
    let turned = tilted(tree, index, sine, cosine)?;
    let links = (0..tree.links.len())
        .filter(|l| tree.carries(index, *l))
        .map(|l| tree.links[l].name.clone())
        .collect();
    Some(Tilt {
        parent: tree.links[spec.parent].name.clone(),
        links,
        turned_from_given: turned * spec.parent_from_joint.inverse(),
    })
}

impl Tilt {
    /// The new pose of a carried link in the frame of the model, given its old pose and that of its joint's
    /// parent.
    pub(super) fn moved(&self, model_from_parent: &Pose, model_from_link: &Pose) -> Pose {
        model_from_parent * self.turned_from_given * model_from_parent.inverse() * model_from_link
    }
}

/// `given`, turned about its own origin by a rotation vector.
fn turned(given: &Pose, turn: &nalgebra::Vector3<f64>) -> Pose {
    Pose::from_parts(given.translation, nalgebra::UnitQuaternion::from_scaled_axis(*turn) * given.rotation)
}

/// Wanted sine and cosine of the load minus those of the joint at a pose. The pose stays set in `tree`.
fn load_miss(tree: &mut TwinTree, joint: usize, pose: Pose, wanted: (f64, f64)) -> nalgebra::Vector2<f64> {
    tree.joints[joint].parent_from_joint = pose;
    let load = Plant::of_joint(tree, joint).map(|p| p.load).unwrap_or_default();
    nalgebra::Vector2::new(wanted.0 - load.sine, wanted.1 - load.cosine)
}

/// Pose of a joint, turned as little as possible, at which gravity loads it by `sine sin(q) + cosine cos(q)`
/// less than in the twin; `None` if there is no such turn.
pub(super) fn tilted(tree: &TwinTree, joint: usize, sine: f64, cosine: f64) -> Option<Pose> {
    let plant = Plant::of_joint(tree, joint).ok()?;
    let wanted = (plant.load.sine - sine, plant.load.cosine - cosine);
    // The miss is relative to the load, so light and heavy parts are treated alike.
    let scale = wanted.0.hypot(wanted.1).max(plant.load.amplitude());
    let mut tree = tree.clone();
    let given = tree.joints[joint].parent_from_joint;
    let mut turn = nalgebra::Vector3::zeros();
    for _ in 0..30 {
        let now = load_miss(&mut tree, joint, turned(&given, &turn), wanted);
        if now.norm() < 1e-7 * scale {
            return Some(turned(&given, &turn));
        }
        let step = 1e-6;
        // Finite differences, as the load depends on the whole tree below the joint.
        let columns = [0, 1, 2].map(|axis| {
            let mut other = turn;
            other[axis] += step;
            (now - load_miss(&mut tree, joint, turned(&given, &other), wanted)) / step
        });
        let j = nalgebra::Matrix2x3::from_columns(&columns);
        // Two loads and three components of the turn: the pseudoinverse gives the smallest turn. The step is
        // bounded, as the load is a sine of the turn and a long step overshoots.
        let least = j.transpose() * (j * j.transpose()).try_inverse()? * now;
        turn += least * (0.3 / least.norm().max(0.3));
    }
    None
}
