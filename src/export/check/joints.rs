//! Rules of joints, limits and the tree.

use std::collections::BTreeSet;

use super::{
    Findings,
    description::{Description, JointText},
};

pub(super) fn check(description: &Description, found: &mut Findings) {
    tree(description, found);
    for joint in &description.joints {
        match joint.kind.as_str() {
            "fixed" => {}
            "revolute" | "prismatic" | "continuous" => moving(joint, found),
            other => found.error(
                "joint",
                &joint.name,
                format!("is of type '{other}'; fixed, revolute, continuous and prismatic load everywhere"),
            ),
        }
        if joint.mimic.is_some() {
            found.warn("joint", &joint.name, "mimics another joint: SDF and PyBullet drop that, MuJoCo before 4 too");
        }
    }
}

fn tree(description: &Description, found: &mut Findings) {
    let mut children = BTreeSet::new();
    for joint in &description.joints {
        for link in [&joint.parent, &joint.child] {
            if description.link(link).is_none() {
                found.error("tree", &joint.name, format!("names the link '{link}', which is not there"));
            }
        }
        if !children.insert(joint.child.as_str()) {
            found.error("tree", &joint.child, "is the child of two joints");
        }
    }
    let roots: Vec<&str> = description.links.iter().map(|l| l.name.as_str()).filter(|l| !children.contains(l)).collect();
    if roots.len() != 1 && !description.links.is_empty() {
        found.error("tree", "robot", format!("has {} root links ({}); one is needed", roots.len(), roots.join(", ")));
    }
}

fn moving(joint: &JointText, found: &mut Findings) {
    let name = &joint.name;
    match joint.axis {
        None => found.warn("joint", name, "has no <axis>; x is taken"),
        Some(axis) if !axis.iter().all(|x| x.is_finite()) => found.error("joint", name, "the axis is no finite direction"),
        Some(axis) if (axis.norm() - 1.0).abs() > 1e-4 => found.error("joint", name, format!("the axis has length {}", axis.norm())),
        _ => {}
    }
    let Some(limit) = &joint.limit else {
        found.error("limit", name, "has no <limit>; effort and velocity are needed, urdfdom refuses the model without");
        return;
    };
    for (what, value) in [("effort", limit.effort), ("velocity", limit.velocity)] {
        match value {
            None => found.error("limit", name, format!("has no {what}; urdfdom refuses the whole model")),
            Some(v) if !(v.is_finite() && v > 0.0) => found.error("limit", name, format!("the {what} is {v}; it must be positive")),
            _ => {}
        }
    }
    if joint.kind == "continuous" {
        return;
    }
    let (lower, upper) = (limit.lower.unwrap_or(0.0), limit.upper.unwrap_or(0.0));
    if !(lower.is_finite() && upper.is_finite()) {
        found.error("limit", name, format!("the limits are {lower} and {upper}; they must be finite"));
    } else if lower > upper {
        found.error("limit", name, format!("lower {lower} is above upper {upper}"));
    } else if lower == upper {
        found.error("limit", name, format!("both limits are {lower}: nothing moves; use a fixed joint"));
    } else if !(lower..=upper).contains(&0.0) {
        found.warn("limit", name, format!("position 0 is outside [{lower}, {upper}]; importers start there"));
    }
}
