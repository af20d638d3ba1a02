//! Rules for the tree: links and joints have unique names and form one tree, and followers have a leading
//! joint.

use std::collections::BTreeSet;

use super::{description::Description, finding::Findings, places::unique_places, rule::Rule};

pub(super) fn check_tree(description: &Description, found: &mut Findings) {
    let links = &description.links;
    let joints = &description.joints;
    let index = unique_places("links", links.iter().map(|l| l.name.as_str()), found);
    let mut carrier: Vec<Option<usize>> = vec![None; links.len()];
    for joint in joints {
        let [parent, child] = [&joint.parent, &joint.child].map(|link| {
            let place = index.get(link.as_str()).copied();
            if place.is_none() {
                found.add_error(
                    Rule::Tree,
                    &joint.name,
                    format!("names the link '{link}', which is not there"),
                );
            }
            place
        });
        if let (Some(parent), Some(child)) = (parent, child)
            && carrier[child].replace(parent).is_some()
        {
            found.add_error(Rule::Tree, &joint.child, "is the child of two joints");
        }
    }
    let children: BTreeSet<&str> = joints.iter().map(|j| j.child.as_str()).collect();
    let first = links.iter().enumerate().filter(|(place, link)| index.get(link.name.as_str()) == Some(place));
    let roots: Vec<&str> =
        first.map(|(_, link)| link.name.as_str()).filter(|name| !children.contains(name)).collect();
    if roots.len() != 1 && !links.is_empty() {
        let named = if roots.is_empty() { String::new() } else { format!(" ({})", shortened_list(&roots)) };
        found.add_error(Rule::Tree, "robot", format!("has {} root links{named}; one is needed", roots.len()));
    }
    for ring in graph_rings(&carrier) {
        // From parent to child, with the same first link.
        let from_parent = ring.iter().take(1).chain(ring.iter().skip(1).rev());
        let names: Vec<&str> = from_parent.map(|&l| links[l].name.as_str()).collect();
        found.add_error(
            Rule::Tree,
            names[0],
            format!("is in a loop of joints ({}); no link may carry itself", shortened_list(&names)),
        );
    }
    check_mimics(description, found);
}

/// Checks joints that mimic others.
fn check_mimics(description: &Description, found: &mut Findings) {
    let joints = &description.joints;
    let index = unique_places("joints", joints.iter().map(|j| j.name.as_str()), found);
    let mut leader = vec![None; joints.len()];
    for (j, joint) in joints.iter().enumerate() {
        let Some(mimic) = &joint.mimic else { continue };
        leader[j] = index.get(mimic.joint.as_str()).copied();
        if leader[j].is_none() {
            found.add_error(
                Rule::Joint,
                &joint.name,
                format!("mimics the joint '{}', which is not there", mimic.joint),
            );
        }
    }
    for ring in graph_rings(&leader) {
        let names: Vec<&str> = ring.iter().map(|&j| joints[j].name.as_str()).collect();
        found.add_error(
            Rule::Joint,
            names[0],
            format!("mimics itself ({}); one joint must lead", shortened_list(&names)),
        );
    }
}

/// The cycles of a graph in which a node has at most one successor, perhaps itself; each begins at its lowest
/// node.
fn graph_rings(next: &[Option<usize>]) -> Vec<Vec<usize>> {
    let mut walk_of: Vec<Option<usize>> = vec![None; next.len()];
    let mut rings = Vec::new();
    for start in 0..next.len() {
        let mut at = start;
        // A node met again by this walk closes a cycle; a node of an earlier walk was followed to its end
        // then. Every node is visited once.
        while walk_of[at].is_none() {
            walk_of[at] = Some(start);
            let Some(further) = next[at] else { break };
            at = further;
            if walk_of[at] == Some(start) {
                let around = std::iter::successors(Some(at), |&n| next[n].filter(|&n| n != at));
                let mut ring: Vec<usize> = around.collect();
                let lowest = (0..ring.len()).min_by_key(|&k| ring[k]).unwrap_or(0);
                ring.rotate_left(lowest);
                rings.push(ring);
            }
        }
    }
    rings
}

/// Names joined to a list; of many only the first ones.
fn shortened_list(names: &[&str]) -> String {
    /// Number of names that still reads well: a choice.
    const SHOWN: usize = 8;
    let more = if names.len() > SHOWN { ", ..." } else { "" };
    names[..names.len().min(SHOWN)].join(", ") + more
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_are_found_once_and_what_leads_into_one_is_none() {
        // 0 -> 1 -> 2 -> 1; 3 -> 3; 4 -> 0; 5 -> nothing; 6 -> 5.
        let next = [Some(1), Some(2), Some(1), Some(3), Some(0), None, Some(5)];
        assert_eq!(graph_rings(&next), [vec![1, 2], vec![3]]);
        assert!(graph_rings(&[]).is_empty());
        // Long rings and chains need no stack and no more time than their length.
        let count = 300_000;
        let long: Vec<Option<usize>> = (0..count).map(|i| Some((i + 1) % count)).collect();
        assert_eq!(graph_rings(&long)[0].len(), count);
    }
}
