//! A tree of links and joints as a file describes it, posed at given joint positions.

use std::collections::BTreeMap;

use nalgebra::{Unit, UnitQuaternion, Vector3};

use geometry::Pose;
use surface::TriangleMesh;

/// Type of a joint of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointType {
    /// Does not move.
    Fixed,
    /// Turns between limits.
    Revolute,
    /// Turns without limits.
    Continuous,
    /// Slides.
    Prismatic,
}

/// Coupling of a joint to another one: `position = multiplier * position(joint) + offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct Mimic {
    /// Name of the leading joint.
    pub joint: String,
    /// Factor.
    pub multiplier: f64,
    /// Radians or meters.
    pub offset: f64,
}

/// A link.
#[derive(Clone, Debug)]
pub struct TreeLink {
    /// Name.
    pub name: String,
    /// All visual meshes as one, link frame; empty if there is none.
    pub visual: TriangleMesh,
}

/// A joint.
#[derive(Clone, Debug)]
pub struct TreeJoint {
    /// Name.
    pub name: String,
    /// Its type.
    pub kind: JointType,
    /// Index of the parent link.
    pub parent: usize,
    /// Index of the child link.
    pub child: usize,
    /// Joint frame in the parent link's frame at position 0.
    pub parent_from_joint: Pose,
    /// Axis in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// Its coupling to another joint, if any.
    pub mimic: Option<Mimic>,
}

/// Links in one tree of joints.
#[derive(Clone, Debug)]
pub struct Tree {
    /// Links, in the order of the file.
    pub links: Vec<TreeLink>,
    /// Joints, in the order of the file.
    pub joints: Vec<TreeJoint>,
    /// Index of the root link.
    pub root: usize,
    /// Joint with a link as its child.
    joint_of: Vec<Option<usize>>,
    /// Number of joints between the root and a link.
    depth: Vec<usize>,
}

/// Why links and joints do not form a tree.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum TreeError {
    /// There are no links, or every link is a child.
    #[error("there is no root link")]
    NoRoot,
    /// More than one link has no parent.
    #[error("there are several root links: {0}")]
    Roots(String),
    /// A link has two parents.
    #[error("link '{0}' is the child of two joints")]
    TwoParents(String),
    /// A link is part of a loop.
    #[error("link '{0}' is in a loop of joints")]
    Loop(String),
}

impl Tree {
    /// Builds the tree of links from their joints.
    ///
    /// # Errors
    /// [`TreeError`] if they do not form one tree.
    pub fn new(links: Vec<TreeLink>, joints: Vec<TreeJoint>) -> Result<Self, TreeError> {
        let mut joint_of = vec![None; links.len()];
        for (j, joint) in joints.iter().enumerate() {
            if joint_of[joint.child].replace(j).is_some() {
                return Err(TreeError::TwoParents(links[joint.child].name.clone()));
            }
        }
        let roots: Vec<usize> = (0..links.len()).filter(|&i| joint_of[i].is_none()).collect();
        let root = match roots.as_slice() {
            [] => return Err(TreeError::NoRoot),
            [root] => *root,
            several => {
                return Err(TreeError::Roots(
                    several.iter().map(|&i| links[i].name.as_str()).collect::<Vec<_>>().join(", "),
                ));
            }
        };
        let mut depth = vec![0; links.len()];
        for i in 0..links.len() {
            let mut link = i;
            while let Some(j) = joint_of[link] {
                link = joints[j].parent;
                depth[i] += 1;
                // No chain is longer than the number of links: this one is a loop.
                if depth[i] > links.len() {
                    return Err(TreeError::Loop(links[i].name.clone()));
                }
            }
        }
        Ok(Self { links, joints, root, joint_of, depth })
    }

    /// The joint with a link as its child; `None` for the root.
    pub fn joint_of(&self, link: usize) -> Option<&TreeJoint> {
        self.joint_of[link].map(|j| &self.joints[j])
    }

    /// Pose of a link in the root's frame; a joint missing in `positions` (radians, meters, by name) is at 0.
    pub fn world_from_link(&self, link: usize, positions: &BTreeMap<String, f64>) -> Pose {
        let Some(joint) = self.joint_of(link) else { return Pose::identity() };
        let of = |name: &str| positions.get(name).copied().unwrap_or(0.0);
        let position =
            joint.mimic.as_ref().map_or_else(|| of(&joint.name), |m| m.multiplier * of(&m.joint) + m.offset);
        let step = match joint.kind {
            JointType::Fixed => Pose::identity(),
            JointType::Revolute | JointType::Continuous => Pose::rotation(joint.axis.into_inner() * position),
            JointType::Prismatic => {
                Pose::from_parts((joint.axis.into_inner() * position).into(), UnitQuaternion::identity())
            }
        };
        self.world_from_joint(joint, positions) * step
    }

    /// Pose of a joint's frame in the root's frame, before its own motion.
    pub fn world_from_joint(&self, joint: &TreeJoint, positions: &BTreeMap<String, f64>) -> Pose {
        self.world_from_link(joint.parent, positions) * joint.parent_from_joint
    }

    /// Groups of links tied by fixed joints, each a rigid part with the link nearest the root first. The
    /// group of the root comes first; other groups without any mesh are left out.
    pub fn rigid_parts(&self) -> Vec<Vec<usize>> {
        let mut order: Vec<usize> = (0..self.links.len()).collect();
        // Parents before children; the order of the file among equals.
        order.sort_by_key(|&i| self.depth[i]);
        let mut parts = Vec::<Vec<usize>>::new();
        let mut part_of = vec![0; self.links.len()];
        for link in order {
            match self.joint_of(link) {
                Some(joint) if joint.kind == JointType::Fixed => {
                    part_of[link] = part_of[joint.parent];
                    parts[part_of[link]].push(link);
                }
                _ => {
                    part_of[link] = parts.len();
                    parts.push(vec![link]);
                }
            }
        }
        let mut kept = Vec::new();
        for (i, part) in parts.into_iter().enumerate() {
            if i == 0 || part.iter().any(|&l| !self.links[l].visual.is_empty()) {
                kept.push(part);
            }
        }
        kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(links: &[&str], joints: &[(usize, usize, JointType)]) -> Result<Tree, TreeError> {
        let links = links.iter().map(|n| TreeLink {
            name: (*n).into(),
            visual: super::super::example::box_mesh([0.0; 3], [1.0; 3], [0; 3]),
        });
        let joints = joints.iter().enumerate().map(|(i, &(parent, child, kind))| TreeJoint {
            name: format!("j{i}"),
            kind,
            parent,
            child,
            parent_from_joint: Pose::translation(1.0, 0.0, 0.0),
            axis: Vector3::z_axis(),
            mimic: None,
        });
        Tree::new(links.collect(), joints.collect())
    }

    #[test]
    fn links_that_are_no_tree_are_refused() {
        use JointType::Fixed as F;
        assert_eq!(tree(&["a", "b"], &[]).unwrap_err(), TreeError::Roots("a, b".into()));
        assert_eq!(tree(&["a"], &[(0, 0, F)]).unwrap_err(), TreeError::NoRoot);
        assert_eq!(
            tree(&["a", "b"], &[(0, 1, F), (0, 1, F)]).unwrap_err(),
            TreeError::TwoParents("b".into())
        );
        assert_eq!(tree(&["a", "b", "c"], &[(1, 2, F), (2, 1, F)]).unwrap_err(), TreeError::Loop("b".into()));
    }

    #[test]
    fn poses_chain_and_mimics_follow() {
        let mut t =
            tree(&["a", "b", "c"], &[(0, 1, JointType::Revolute), (1, 2, JointType::Prismatic)]).unwrap();
        t.joints[1].mimic = Some(Mimic { joint: "j0".into(), multiplier: 2.0, offset: 0.5 });
        let q = BTreeMap::from([("j0".to_owned(), std::f64::consts::FRAC_PI_2)]);
        let p = t.world_from_link(2, &q).translation.vector;
        assert!((p - Vector3::new(1.0, 1.0, std::f64::consts::PI + 0.5)).norm() < 1e-12);
    }

    #[test]
    fn fixed_links_are_one_part_and_bare_links_none() {
        let kinds = [
            (0, 3, JointType::Fixed),
            (3, 1, JointType::Continuous),
            (1, 2, JointType::Fixed),
            (0, 4, JointType::Revolute),
        ];
        let mut t = tree(&["a", "b", "c", "d", "e"], &kinds).unwrap();
        assert_eq!(t.rigid_parts(), [vec![0, 3], vec![4], vec![1, 2]]);
        t.links[4].visual = TriangleMesh::default();
        assert_eq!(t.rigid_parts(), [vec![0, 3], vec![1, 2]]);
    }
}
