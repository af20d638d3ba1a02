//! Poses of the links of a description at given joint positions, in time linear in the number of links.

use nalgebra::{Translation3, UnitQuaternion, Vector3};

use super::{
    description::{Description, JointText},
    places::first_places,
};
use geometry::Pose;

/// The tree of a description, by indices of links and joints.
pub(super) struct Placement<'a> {
    description: &'a Description,
    /// The joint that each joint mimics.
    pub leader: Vec<Option<usize>>,
    /// The joint above each link.
    carrier: Vec<Option<usize>>,
    /// The parent link of that joint.
    parent: Vec<Option<usize>>,
    /// Links, parents before children; those in a loop are left out.
    order: Vec<usize>,
    children: Vec<Option<usize>>,
}

impl<'a> Placement<'a> {
    pub(super) fn new(description: &'a Description) -> Self {
        let links = first_places(description.links.iter().map(|l| l.name.as_str()));
        let joints = first_places(description.joints.iter().map(|j| j.name.as_str()));
        let carriers = first_places(description.joints.iter().map(|j| j.child.as_str()));
        let mut leader = Vec::with_capacity(description.joints.len());
        for joint in &description.joints {
            // A joint that mimics itself has no leader here; the rules of the tree report it.
            let other = joint.mimic.as_ref().map(|mimic| &mimic.joint).filter(|name| **name != joint.name);
            leader.push(other.and_then(|name| joints.get(name.as_str()).copied()));
        }
        let carrier: Vec<_> =
            description.links.iter().map(|l| carriers.get(l.name.as_str()).copied()).collect();
        let mut parent = vec![None; carrier.len()];
        for (parent, joint) in parent.iter_mut().zip(&carrier) {
            *parent = joint.and_then(|j: usize| links.get(description.joints[j].parent.as_str()).copied());
        }
        let mut below = vec![Vec::new(); parent.len()];
        parent.iter().enumerate().for_each(|(link, parent)| parent.iter().for_each(|p| below[*p].push(link)));
        let mut order: Vec<usize> = (0..parent.len()).filter(|l| parent[*l].is_none()).collect();
        let mut at = 0;
        // Breadth first from the roots: links in a loop are never reached, and the search ends on any input.
        while at < order.len() {
            order.extend(&below[order[at]]);
            at += 1;
        }
        Self {
            description,
            leader,
            carrier,
            parent,
            order,
            children: description.joints.iter().map(|j| links.get(j.child.as_str()).copied()).collect(),
        }
    }

    /// The child link of a joint.
    pub(super) fn child_link(&self, joint: usize) -> Option<usize> {
        self.children[joint]
    }

    /// Poses of all links in the root's frame; followers take their leader's position.
    pub(super) fn poses_of_links(&self, positions: &[f64]) -> Vec<Pose> {
        let mut poses = vec![Pose::identity(); self.parent.len()];
        for &link in &self.order {
            let Some(j) = self.carrier[link] else { continue };
            let joint = &self.description.joints[j];
            let position = match (self.leader[j], &joint.mimic) {
                (Some(l), Some(mimic)) => mimic.multiplier * positions[l] + mimic.offset,
                _ => positions[j],
            };
            let parent = self.parent[link].map_or_else(Pose::identity, |p| poses[p]);
            poses[link] = parent * joint.parent_from_joint * joint_motion(joint, position);
        }
        poses
    }

    /// Whether each link is one of these or below one.
    pub(super) fn hanging_on(&self, links: &[usize]) -> Vec<bool> {
        let mut hangs = vec![false; self.parent.len()];
        links.iter().for_each(|l| hangs[*l] = true);
        for &link in &self.order {
            hangs[link] |= self.parent[link].is_some_and(|p| hangs[p]);
        }
        hangs
    }

    /// For every link, the nearest link above it for which `test` is true.
    pub(super) fn nearest_above(&self, test: impl Fn(usize) -> bool) -> Vec<Option<usize>> {
        let mut nearest = vec![None; self.parent.len()];
        for &link in &self.order {
            nearest[link] = self.parent[link].and_then(|p| if test(p) { Some(p) } else { nearest[p] });
        }
        nearest
    }
}

/// Motion of a joint to a position.
fn joint_motion(joint: &JointText, position: f64) -> Pose {
    let axis = joint.axis.unwrap_or_else(Vector3::x).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    match joint.kind.as_str() {
        "prismatic" => Pose::from_parts(Translation3::from(axis * position), UnitQuaternion::identity()),
        "fixed" => Pose::identity(),
        _ => Pose::rotation(axis * position),
    }
}
