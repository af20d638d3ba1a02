//! SDF 1.9 text, for Gazebo.

use std::fmt::Write as _;

use super::urdf::{origin, short, solid_name, solid_path, triple, visual_path};
use crate::{
    geometry::Pose,
    model::{ArticulatedModel, Joint, Link, escape_xml as escape},
};

/// SDF text of a model; mesh paths are relative to its folder. Link 0 is fixed to the world.
#[must_use]
pub fn sdf(model: &ArticulatedModel) -> String {
    let root = model.links.first().map_or(String::new(), |l| escape(&l.name));
    // An SDF model floats unless a joint holds it to `world`. Links do not collide with each other: solids
    // that touch at rest would throw a part out.
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<sdf version=\"1.9\">\n  <model name=\"{}\" \
         canonical_link=\"{root}\">\n    <self_collide>false</self_collide>\n    \
         <joint name=\"world_fixed\" \
         type=\"fixed\">\n      <parent>world</parent>\n      <child>{root}</child>\n    </joint>\n",
        escape(&model.name)
    );
    // SDF places links in the frame of the model, not of their parents: here with all joints at 0.
    let closed = vec![0.0; model.joints.len()];
    for (i, link) in model.links.iter().enumerate() {
        push_link(&mut text, link, &model.world_from_link(i, &closed));
    }
    for joint in &model.joints {
        push_joint(&mut text, joint, model);
    }
    text.push_str("  </model>\n</sdf>\n");
    text
}

/// `model.config`, by which Gazebo finds the model.
#[must_use]
pub fn model_config(model: &ArticulatedModel) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<model>\n  <name>{0}</name>\n  <version>1.0</version>\n  <sdf \
         version=\"1.9\">model.sdf</sdf>\n  \
         <description>Twin of a recorded object: {0}</description>\n</model>\n",
        escape(&model.name)
    )
}

fn push_link(text: &mut String, link: &Link, model_from_link: &Pose) {
    let (name, mass, i) = (escape(&link.name), &link.inertial, &link.inertial.inertia);
    // Writing to a string cannot fail, here and below.
    writeln!(text, "    <link name=\"{name}\">\n      <pose>{}</pose>", pose(model_from_link)).ok();
    // The tensor is along the link's axes: the inertial frame is shifted and not turned.
    let com = triple(mass.center_of_mass.coords.as_ref());
    writeln!(
        text,
        "      <inertial>\n        <pose>{com} 0 0 0</pose>\n        <mass>{}</mass>\n        <inertia>",
        short(mass.mass_kg)
    )
    .ok();
    for (tag, k) in
        [("ixx", (0, 0)), ("ixy", (0, 1)), ("ixz", (0, 2)), ("iyy", (1, 1)), ("iyz", (1, 2)), ("izz", (2, 2))]
    {
        writeln!(text, "          <{tag}>{}</{tag}>", short(i[k])).ok();
    }
    text.push_str("        </inertia>\n      </inertial>\n");
    if !link.visual.is_empty() {
        push_geometry(text, "visual", &format!("{}_visual", link.name), &visual_path(link));
    }
    for k in 0..link.collision.len() {
        push_geometry(text, "collision", &solid_name(link, k), &solid_path(link, k));
    }
    text.push_str("    </link>\n");
}

fn push_geometry(text: &mut String, tag: &str, name: &str, path: &str) {
    let (name, path) = (escape(name), escape(path));
    writeln!(text, "      <{tag} name=\"{name}\">\n        <geometry>\n          <mesh>").ok();
    writeln!(text, "            <uri>{path}</uri>\n          </mesh>").ok();
    writeln!(text, "        </geometry>\n      </{tag}>").ok();
}

fn push_joint(text: &mut String, joint: &Joint, model: &ArticulatedModel) {
    let kind = if joint.kind.pitch_m_per_rad().is_some() { "screw" } else { joint.kind.name() };
    let [parent, child] = [joint.parent, joint.child].map(|l| escape(&model.links[l].name));
    let (l, d) = (&joint.limit, &joint.dynamics);
    writeln!(
        text,
        "    <joint name=\"{}\" type=\"{kind}\">\n      <parent>{parent}</parent>",
        escape(&joint.name)
    )
    .ok();
    if let Some(pitch) = joint.kind.pitch_m_per_rad() {
        // Meters a revolution; positive for a right-handed thread.
        writeln!(
            text,
            "      <screw_thread_pitch>{}</screw_thread_pitch>",
            short(std::f64::consts::TAU * pitch)
        )
        .ok();
    }
    writeln!(
        text,
        "      <child>{child}</child>\n      <axis>\n        <xyz>{}</xyz>\n        <limit>",
        triple(joint.axis.as_ref().as_ref())
    )
    .ok();
    for (tag, value) in
        [("lower", l.lower), ("upper", l.upper), ("effort", l.effort), ("velocity", l.velocity)]
    {
        writeln!(text, "          <{tag}>{}</{tag}>", short(value)).ok();
    }
    text.push_str("        </limit>\n        <dynamics>\n");
    // SDF has a place for a spring, which URDF lacks.
    let dynamics = [
        ("damping", d.damping),
        ("friction", d.friction),
        ("spring_reference", d.spring_reference),
        ("spring_stiffness", d.stiffness),
    ];
    for (tag, value) in dynamics {
        writeln!(text, "          <{tag}>{}</{tag}>", short(value)).ok();
    }
    text.push_str("        </dynamics>\n      </axis>\n    </joint>\n");
}

fn pose(target_from_source: &Pose) -> String {
    let (xyz, rpy) = origin(target_from_source);
    format!("{xyz} {rpy}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::example::cabinet;

    #[test]
    fn links_stand_where_position_0_puts_them() {
        let model = cabinet();
        let text = sdf(&model);
        let document = roxmltree::Document::parse(&text).unwrap();
        let all = |tag: &str| document.descendants().filter(|n| n.has_tag_name(tag)).count();
        assert_eq!([all("link"), all("joint"), all("visual"), all("collision"), all("ixx")], [3, 3, 3, 3, 3]);
        assert!(text.contains("<pose>0.2 -0.25 0.3 0.1 -0.2 0.3</pose>"), "{text}");
        assert!(roxmltree::Document::parse(&model_config(&model)).is_ok());
    }
}
