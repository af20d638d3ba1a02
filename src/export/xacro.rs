//! The twin as xacro macros, for robots and work cells: links and joints with a prefix, and a block for
//! `ros2_control`.

use std::fmt::Write as _;

use super::{
    config::UrdfScrew,
    urdf::{Form, advance_limit, grasp_name, origin, push_elements, short},
};
use model::{ArticulatedModel, Joint, Limit, Link, escape_xml as escape, identifier};

/// Xacro's namespace.
const SPACE: &str = "xmlns:xacro=\"http://www.ros.org/wiki/xacro\"";
/// The default hardware plugin.
const MOCK: &str = "mock_components/GenericSystem";

/// Name of the file of [`macros_text`].
pub(crate) fn macro_file(model: &ArticulatedModel) -> String {
    format!("{}_macro.xacro", identifier(&model.name))
}

/// Text of two macros: the twin, with a prefix for all names and optionally attached to a link; and its
/// joints for `ros2_control`.
pub(crate) fn macros_text(model: &ArticulatedModel, screws: UrdfScrew) -> String {
    let name = identifier(&model.name);
    let paths = format!("package://{name}/");
    // Writing to a string cannot fail, here and below.
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<robot {SPACE} xmlns:artitwin=\"urn:artitwin:urdf\">\n\
         <xacro:macro name=\"{name}\" params=\"prefix:='' parent:='' xyz:='0 0 0' rpy:='0 0 0'\">\n"
    );
    push_elements(&mut text, model, Form { paths: &paths, names: "${prefix}", screws, gazebo: true });
    model.links.iter().for_each(|link| push_grasps(&mut text, link));
    let root = model.links.first().map_or(String::new(), |l| escape(&l.name));
    write!(
        text,
        "  <xacro:unless value=\"${{parent == ''}}\">\n    <joint name=\"${{prefix}}{name}_mount\" \
         type=\"fixed\">\n      <origin xyz=\"${{xyz}}\" rpy=\"${{rpy}}\"/>\n      <parent \
         link=\"${{parent}}\"/>\n      <child link=\"${{prefix}}{root}\"/>\n    </joint>\n  \
         </xacro:unless>\n</xacro:macro>\n"
    )
    .ok();
    push_control(&mut text, model, screws, &name);
    text.push_str("</robot>\n");
    text
}

/// Adds the grasps of a link as frames on it: links without mass, for `robot_state_publisher`. A simulator
/// would give each a mass of its own, so no other URDF has them.
fn push_grasps(text: &mut String, link: &Link) {
    for (k, grasp) in link.grasps.iter().enumerate() {
        let name = escape(&grasp_name(link, k));
        let on = escape(&link.name);
        let (xyz, rpy) = origin(&grasp.link_from_grasp);
        writeln!(
            text,
            "  <link name=\"${{prefix}}{name}\"/>\n  <joint name=\"${{prefix}}{name}_fixed\" \
             type=\"fixed\">\n    <origin xyz=\"{xyz}\" rpy=\"{rpy}\"/>\n    \
             <parent link=\"${{prefix}}{on}\"/>\n    <child link=\"${{prefix}}{name}\"/>\n  </joint>"
        )
        .ok();
    }
}

/// Text of the twin by itself, made by the macros.
pub(crate) fn twin_text(model: &ArticulatedModel) -> String {
    let name = identifier(&model.name);
    let file = macro_file(model);
    format!(
        "<?xml version=\"1.0\"?>\n<robot name=\"{name}\" {SPACE}>\n  <xacro:arg name=\"prefix\" \
         default=\"\"/>\n  <xacro:arg name=\"parent\" default=\"\"/>\n  <xacro:arg name=\"ros2_control\" \
         default=\"false\"/>\n  <xacro:arg name=\"hardware\" default=\"{MOCK}\"/>\n  \
         <xacro:property name=\"parent\" value=\"$(arg parent)\"/>\n  \
         <xacro:include filename=\"{file}\"/>\n  \
         <xacro:unless value=\"${{parent == ''}}\">\n    <link name=\"${{parent}}\"/>\n  \
         </xacro:unless>\n  <xacro:{name} prefix=\"$(arg prefix)\" parent=\"${{parent}}\"/>\n  \
         <xacro:if value=\"$(arg ros2_control)\">\n    <xacro:{name}_ros2_control prefix=\"$(arg prefix)\" \
         hardware=\"$(arg hardware)\"/>\n  </xacro:if>\n</robot>\n"
    )
}

/// Name and limits of the joint that `ros2_control` commands.
pub(super) fn commanded_joint(joint: &Joint, screws: UrdfScrew) -> (String, Limit) {
    // In a pair the slide leads and the turn follows it.
    match joint.kind.thread_m_per_rad().filter(|_| screws == UrdfScrew::Pair) {
        Some(pitch) => (joint.advance_name(), advance_limit(joint, pitch)),
        None => (joint.name.clone(), joint.limit),
    }
}

fn push_control(text: &mut String, model: &ArticulatedModel, screws: UrdfScrew, name: &str) {
    write!(
        text,
        "<xacro:macro name=\"{name}_ros2_control\" params=\"prefix:='' hardware:='{MOCK}'\">\n  \
         <ros2_control name=\"${{prefix}}{name}\" type=\"system\">\n    <hardware>\n      \
         <plugin>${{hardware}}</plugin>\n    </hardware>\n"
    )
    .ok();
    for (j, joint) in model.joints.iter().enumerate() {
        let (leader, limit) = commanded_joint(joint, screws);
        let start = model.states.first().and_then(|s| s.get(j)).copied().unwrap_or_default();
        let leads = leader == joint.name;
        let of_leader = if leads { start } else { start * joint.kind.thread_m_per_rad().unwrap_or(0.0) };
        write!(
            text,
            "    <joint name=\"${{prefix}}{}\">\n      <command_interface name=\"position\">\n        \
             <param name=\"min\">{}</param>\n        <param name=\"max\">{}</param>\n      \
             </command_interface>\n",
            escape(&leader),
            short(limit.lower),
            short(limit.upper)
        )
        .ok();
        push_states(text, of_leader);
        if !leads {
            writeln!(text, "    <joint name=\"${{prefix}}{}\">", escape(&joint.name)).ok();
            push_states(text, start);
        }
    }
    text.push_str("  </ros2_control>\n</xacro:macro>\n");
}

/// Adds the state interfaces of a joint and its end tag.
fn push_states(text: &mut String, start: f64) {
    writeln!(
        text,
        "      <state_interface name=\"position\">\n        <param name=\"initial_value\">{}</param>\n      \
         </state_interface>\n      <state_interface name=\"velocity\"/>\n    </joint>",
        short(start)
    )
    .ok();
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::{JointKind, example::cabinet};

    #[test]
    fn every_name_has_the_prefix_and_every_joint_is_controlled_once() {
        let mut model = cabinet();
        model.joints[1].kind = JointKind::Screw { pitch_m_per_rad: 0.5 };
        let text = macros_text(&model, UrdfScrew::Pair);
        let document = roxmltree::Document::parse(&text).unwrap();
        let tags = ["link", "joint", "visual", "collision", "mimic", "parent", "child", "gazebo"];
        for node in document.descendants().filter(|n| tags.contains(&n.tag_name().name())) {
            let name = ["name", "link", "joint", "reference"].into_iter().find_map(|a| node.attribute(a));
            let plain = name.filter(|n| !n.starts_with("${prefix}") && *n != "${parent}");
            assert_eq!(plain, None, "{node:?}");
        }
        let control = document.descendants().find(|n| n.has_tag_name("ros2_control")).unwrap();
        let of = |tag: &str| -> Vec<&str> {
            let has = |n: &roxmltree::Node| n.children().any(|c| c.has_tag_name(tag));
            let all = control.children().filter(|n| n.has_tag_name("joint") && has(n));
            all.filter_map(|n| n.attribute("name")).collect()
        };
        assert_eq!(of("command_interface"), ["${prefix}door_hinge", "${prefix}drawer_slide_advance"]);
        assert_eq!(
            of("state_interface"),
            ["${prefix}door_hinge", "${prefix}drawer_slide_advance", "${prefix}drawer_slide"]
        );
        assert!(roxmltree::Document::parse(&twin_text(&model)).is_ok());
        assert!(twin_text(&model).contains("<xacro:include filename=\"cabinet_macro.xacro\"/>"));
    }
}
