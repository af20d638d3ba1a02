//! SRDF text for MoveIt: the joints as a group, the observed states, and link pairs exempt from collision
//! checks.

use std::fmt::Write as _;

use nalgebra::{Point3, Vector3};

use super::{
    config::{Base, ExportConfig},
    urdf::short,
    xacro::commanded_joint,
};
use geometry::{bounding_box, box_corners};
use model::{ArticulatedModel, Joint, escape_xml as escape};

/// Number of positions examined of each joint, in a chain of one, two or three joints; longer chains are not
/// examined.
const STEPS: [usize; 3] = [25, 12, 6];

/// SRDF text of a model. A pair is exempt if a joint connects its links, or if the boxes of their reach
/// within the limits are apart.
pub(crate) fn srdf_text(model: &ArticulatedModel, config: &ExportConfig) -> String {
    let root = model.links.first().map_or(String::new(), |l| escape(&l.name));
    let name = escape(&model.name);
    let kind = if config.base == Base::Floating { "floating" } else { "fixed" };
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<robot name=\"{name}\">\n  <virtual_joint name=\"{0}{name}_in_world\" \
         type=\"{kind}\" parent_frame=\"world\" child_link=\"{root}\"/>\n  <group name=\"{0}{name}\">\n",
        config.prefix
    );
    let leaders: Vec<String> =
        model.joints.iter().map(|j| escape(&commanded_joint(j, config.urdf_screw).0)).collect();
    // Writing to a string cannot fail, here and below.
    for joint in &leaders {
        writeln!(text, "    <joint name=\"{joint}\"/>").ok();
    }
    text.push_str("  </group>\n");
    for (k, state) in model.states.iter().enumerate() {
        writeln!(text, "  <group_state name=\"state{k}\" group=\"{}{name}\">", config.prefix).ok();
        for ((joint, leader), q) in model.joints.iter().zip(&leaders).zip(state) {
            let is_turn = *leader == escape(&joint.name);
            let factor = if is_turn { 1.0 } else { joint.kind.thread_m_per_rad().unwrap_or(1.0) };
            writeln!(text, "    <joint name=\"{leader}\" value=\"{}\"/>", short(factor * q)).ok();
        }
        text.push_str("  </group_state>\n");
    }
    for UncheckedPair { links, reason } in unchecked_pairs(model) {
        let [a, b] = links.map(|l| escape(&model.links[l].name));
        writeln!(text, "  <disable_collisions link1=\"{a}\" link2=\"{b}\" reason=\"{reason}\"/>").ok();
    }
    text.push_str("</robot>\n");
    text
}

/// Two links exempt from collision checks, and the reason in MoveIt's words.
struct UncheckedPair {
    links: [usize; 2],
    reason: &'static str,
}

/// All pairs of links exempt from collision checks.
fn unchecked_pairs(model: &ArticulatedModel) -> Vec<UncheckedPair> {
    let reach: Vec<_> = (0..model.links.len()).map(|link| reach_box(model, link)).collect();
    let mut pairs = Vec::new();
    for a in 0..model.links.len() {
        for b in a + 1..model.links.len() {
            if model.joints.iter().any(|j| (j.parent, j.child) == (a, b) || (j.parent, j.child) == (b, a)) {
                pairs.push(UncheckedPair { links: [a, b], reason: "Adjacent" });
            } else if let (Some((la, ua)), Some((lb, ub))) = (reach[a], reach[b])
                && (0..3).any(|k| ua[k] < lb[k] || ub[k] < la[k])
            {
                pairs.push(UncheckedPair { links: [a, b], reason: "Never" });
            }
        }
    }
    pairs
}

/// Lower and upper corner of a box around all places that a link's solids reach within the limits of the
/// joints above it, meters in the world; `None` for a link without solids or below too many joints.
fn reach_box(model: &ArticulatedModel, link: usize) -> Option<(Point3<f64>, Point3<f64>)> {
    let chain: Vec<usize> = (0..model.joints.len())
        .filter(|&j| model.joints[j].child == link || model.is_below(link, model.joints[j].child))
        .collect();
    let steps = match chain.len() {
        0 => 1,
        n => *STEPS.get(n - 1)?,
    };
    let (lower, upper) =
        bounding_box(model.links[link].collision.iter().flat_map(|s| s.vertices.iter().copied()))?;
    let corners = box_corners(&lower, &upper);
    let mut positions = vec![0.0; model.joints.len()];
    let mut reached = Vec::new();
    for n in 0..steps.pow(chain.len() as u32) {
        let mut rest = n;
        for &j in &chain {
            let l = &model.joints[j].limit;
            positions[j] = l.lower + (l.upper - l.lower) * (rest % steps) as f64 / (steps - 1) as f64;
            rest /= steps;
        }
        let pose = model.world_from_link(link, &positions);
        reached.extend(corners.iter().map(|c| pose * c));
    }
    let (lower, upper) = bounding_box(reached)?;
    // Between two positions, a point is never farther from both than half its path from one to the other.
    let lever_m = (upper - lower).norm();
    let margin = Vector3::repeat(chain.iter().map(|&j| half_step_m(&model.joints[j], steps, lever_m)).sum());
    Some((lower - margin, upper + margin))
}

/// Half of the longest path of a point between two of `steps` positions of a joint, meters.
fn half_step_m(joint: &Joint, steps: usize, lever_m: f64) -> f64 {
    let step = (joint.limit.upper - joint.limit.lower) / (steps - 1) as f64;
    let per_step =
        if joint.kind.turns() { lever_m + joint.kind.pitch_m_per_rad().unwrap_or(0.0).abs() } else { 1.0 };
    0.5 * step * per_step
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::{JointKind, example::cabinet};

    fn disabled(model: &ArticulatedModel) -> Vec<(usize, usize, &'static str)> {
        unchecked_pairs(model).into_iter().map(|p| (p.links[0], p.links[1], p.reason)).collect()
    }

    #[test]
    fn pairs_that_cannot_meet_need_no_check() {
        let mut model = cabinet();
        // The door's sweep and the drawer's way come near each other.
        assert_eq!(disabled(&model), [(0, 1, "Adjacent"), (0, 2, "Adjacent")]);
        // Not so where the drawer goes out at the other side, half a meter away.
        model.joints[1].parent_from_joint = geometry::Pose::translation(-1.2, 0.0, 0.0);
        assert_eq!(disabled(&model), [(0, 1, "Adjacent"), (0, 2, "Adjacent"), (1, 2, "Never")]);
        // What was not looked at is not said.
        model.links[2].collision.clear();
        assert_eq!(disabled(&model).len(), 2);
    }

    #[test]
    fn groups_and_states_name_the_joints_that_lead() {
        let mut model = cabinet();
        model.joints[1].kind = JointKind::Screw { pitch_m_per_rad: 0.5 };
        let text = srdf_text(&model, &ExportConfig::default());
        let document = roxmltree::Document::parse(&text).unwrap();
        let joints: Vec<_> = document.descendants().filter(|n| n.has_tag_name("joint")).collect();
        assert!(
            joints
                .iter()
                .all(|n| ["door_hinge", "drawer_slide_advance"].contains(&n.attribute("name").unwrap()))
        );
        assert_eq!(joints.len(), 6);
        let values: Vec<_> = joints.iter().filter_map(|n| n.attribute("value")).collect();
        assert_eq!(values, ["0", "0.09", "1.25", "0"]);
    }
}
