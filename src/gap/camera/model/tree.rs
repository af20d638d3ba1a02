//! Builds the twin seen by cameras from the tree of a description file.

use std::collections::BTreeMap;

use nalgebra::Point3;

use crate::camera::model::{
    own_error::OwnErrors,
    twin::{SeenJoint, SeenPart, SeenTwin},
};
use geometry::{AxisMotion, Pose};
use model::{JointType, Tree};
use surface::{TriangleMesh, merged_mesh};

/// Facts about a joint missing in a tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointFacts {
    /// Lowest and highest position.
    pub limit: Option<(f64, f64)>,
    /// Pitch of a screw, meters per radian.
    pub pitch_m_per_rad: Option<f64>,
}

/// Why cameras cannot see a tree.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SeenTwinError {
    /// No mesh at all.
    #[error("no link of the twin has a visual mesh (.ply or .obj): frames can only be compared with meshes")]
    NoMesh,
    /// A mimic joint with an unknown leader.
    #[error("joint '{joint}' mimics '{leader}', which is not a moving joint of the twin")]
    Mimic {
        /// The joint.
        joint: String,
        /// Its leader.
        leader: String,
    },
}

impl SeenPart {
    /// The part made of links tied by fixed joints, with the pose of each link in the frame of the first.
    fn of_links(tree: &Tree, links: &[(usize, Pose)], joint: Option<usize>) -> Self {
        let meshes: Vec<TriangleMesh> =
            links.iter().map(|(l, pose)| tree.links[*l].visual.transformed(pose)).collect();
        let mesh = merged_mesh(&meshes.iter().collect::<Vec<_>>());
        let (low, high) = mesh.bounds().unwrap_or_default();
        let low: Point3<f64> = low.cast();
        let high: Point3<f64> = high.cast();
        Self {
            name: tree.links[links[0].0].name.clone(),
            mesh,
            joint,
            center: nalgebra::center(&low, &high),
            radius_m: 0.5 * (high - low).norm(),
        }
    }
}

impl SeenTwin {
    /// Builds the seen twin. Links tied by fixed joints become one part; parts are ordered from the root.
    ///
    /// # Errors
    /// [`SeenTwinError`].
    pub fn of_tree(tree: &Tree, facts: &BTreeMap<String, JointFacts>) -> Result<Self, SeenTwinError> {
        let n = tree.links.len();
        let mut part_of: Vec<Option<(usize, Pose)>> = vec![None; n];
        part_of[tree.root] = Some((0, Pose::identity()));
        let mut members: Vec<Vec<(usize, Pose)>> = vec![vec![(tree.root, Pose::identity())]];
        let mut carriers: Vec<Option<usize>> = vec![None];
        let mut joints: Vec<SeenJoint> = Vec::new();
        let mut mimics: Vec<Option<&model::Mimic>> = Vec::new();
        let mut open = vec![tree.root];
        while let Some(link) = open.pop() {
            let Some((part, part_from_link)) = part_of[link] else { continue };
            for joint in tree.joints.iter().filter(|j| j.parent == link) {
                let part_from_joint = part_from_link * joint.parent_from_joint;
                let place = if joint.kind == JointType::Fixed {
                    members[part].push((joint.child, part_from_joint));
                    (part, part_from_joint)
                } else {
                    members.push(vec![(joint.child, Pose::identity())]);
                    carriers.push(Some(joints.len()));
                    let own = facts.get(&joint.name).copied().unwrap_or_default();
                    let kind = match (joint.kind, own.pitch_m_per_rad) {
                        (JointType::Prismatic, _) => AxisMotion::Prismatic,
                        (_, Some(pitch_m_per_rad)) => AxisMotion::Screw { pitch_m_per_rad },
                        _ => AxisMotion::Revolute,
                    };
                    joints.push(SeenJoint {
                        name: joint.name.clone(),
                        parent: part,
                        child: members.len() - 1,
                        parent_from_joint: part_from_joint,
                        kind,
                        axis: joint.axis,
                        point: Point3::origin(),
                        limit: own.limit.filter(|_| joint.kind != JointType::Continuous),
                        mimic: None,
                    });
                    mimics.push(joint.mimic.as_ref());
                    (members.len() - 1, Pose::identity())
                };
                part_of[joint.child] = Some(place);
                open.push(joint.child);
            }
        }
        // After all joints: a leader may come later than its follower.
        for (j, mimic) in mimics.iter().enumerate() {
            let Some(m) = mimic else { continue };
            let leader = joints.iter().position(|k| k.name == m.joint);
            let leader = leader.ok_or_else(|| SeenTwinError::Mimic {
                joint: joints[j].name.clone(),
                leader: m.joint.clone(),
            })?;
            joints[j].mimic = Some((leader, m.multiplier, m.offset));
        }
        let parts: Vec<SeenPart> = members
            .iter()
            .zip(carriers)
            .map(|(links, joint)| SeenPart::of_links(tree, links, joint))
            .collect();
        if parts.iter().all(|p| p.mesh.is_empty()) {
            return Err(SeenTwinError::NoMesh);
        }
        Ok(Self { parts, joints, own: OwnErrors::default() })
    }
}
