//! Rules of joints and limits.

use super::{
    description::{Description, JointText},
    finding::{Findings, Level},
    rule::Rule,
};

pub(super) fn check_joints(description: &Description, found: &mut Findings) {
    for joint in &description.joints {
        match joint.kind.as_str() {
            "fixed" => {}
            "revolute" | "prismatic" | "continuous" => check_moving_joint(joint, found),
            other => {
                let level =
                    if ["floating", "planar"].contains(&other) { Level::Warning } else { Level::Error };
                let message = format!(
                    "is of type '{other}'; fixed, revolute, continuous and prismatic load everywhere"
                );
                found.add_finding(level, Rule::Joint, &joint.name, message);
            }
        }
        if joint.lacks_safety_velocity {
            found.add_warning(
                Rule::Joint,
                &joint.name,
                "has a <safety_controller> without k_velocity, which urdfdom refuses",
            );
        }
        if joint.mimic.is_some() {
            found.add_warning(
                Rule::Joint,
                &joint.name,
                "mimics another joint: SDF and PyBullet drop that, MuJoCo before 4 too",
            );
        }
    }
}

fn check_moving_joint(joint: &JointText, found: &mut Findings) {
    let name = &joint.name;
    match joint.axis {
        None => found.add_warning(Rule::Joint, name, "has no <axis>; x is taken"),
        // The rules of numbers report an axis without length.
        Some(axis) if axis.norm() > 0.0 && (axis.norm() - 1.0).abs() > 1e-4 => {
            found.add_error(Rule::Joint, name, format!("the axis has length {}", axis.norm()))
        }
        _ => {}
    }
    let Some(limit) = &joint.limit else {
        // urdfdom requires limits for joints that have ends.
        if joint.kind == "continuous" {
            found.add_warning(Rule::Limit, name, "has no <limit> with effort and velocity; PyBullet takes 0");
        } else {
            let message = "has no <limit>; effort and velocity are needed, urdfdom refuses the model without";
            found.add_error(Rule::Limit, name, message);
        }
        return;
    };
    for (what, value) in [("effort", limit.effort), ("velocity", limit.velocity)] {
        match value {
            None => {
                found.add_error(Rule::Limit, name, format!("has no {what}; urdfdom refuses the whole model"))
            }
            Some(0.0) => found.add_error(Rule::Limit, name, format!("the {what} is 0; it must be positive")),
            _ => {}
        }
    }
    // Importers ignore the bounds of a continuous joint.
    if joint.kind == "continuous" {
        return;
    }
    let [lower, upper] = limit.range();
    if lower == upper {
        found.add_error(
            Rule::Limit,
            name,
            format!("both limits are {lower}: nothing moves; use a fixed joint"),
        );
    } else if lower > 0.0 || upper < 0.0 {
        found.add_warning(
            Rule::Limit,
            name,
            format!("position 0 is outside [{lower}, {upper}]; importers start there"),
        );
    }
}

/// Reports limits that contain no position.
pub(super) fn check_joint_limits(description: &Description, found: &mut Findings) {
    for joint in description.joints.iter().filter(|j| ["revolute", "prismatic"].contains(&j.kind.as_str())) {
        let Some(limit) = &joint.limit else { continue };
        let [lower, upper] = limit.range();
        if lower > upper {
            found.add_error(Rule::Limit, &joint.name, format!("lower {lower} is above upper {upper}"));
        }
    }
}
