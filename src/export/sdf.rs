//! SDF 1.9 text, for Gazebo.

use std::fmt::Write as _;

use super::{
    config::{Base, ExportConfig},
    drawn::link_visuals,
    urdf::{
        CARRIER_KG, CARRIER_KG_M2, advance_limit, carrier_name, grasp_name, origin, short, solid_name,
        solid_path, triple,
    },
};
use geometry::Pose;
use model::{ArticulatedModel, Joint, JointDynamics, Limit, Link, escape_xml as escape};

/// File with SDF's own screw joints, beside `model.sdf`; only for models that have screws.
pub(crate) const SCREW_SDF: &str = "screw.sdf";
/// Namespace of elements for Drake, which other readers skip.
const DRAKE: &str = "http://drake.mit.edu";
/// Friction between surfaces: assumed, as of wood on wood.
const SURFACE: &str = "        <surface>\n          <friction>\n            \
    <ode><mu>0.6</mu><mu2>0.6</mu2></ode>\n          </friction>\n        </surface>\n";

/// How a screw is represented.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Screws {
    /// As a slide and a turn that follows it, for Drake.
    Pair,
    /// As a screw joint of SDF.
    Own,
}

/// SDF text of a model; mesh paths are relative to its folder. Link 0 is fixed to the world, or floats.
///
/// A screw is written as a slide and a turn that Drake ties to it: Drake's screw joint has no limits.
pub(crate) fn sdf(model: &ArticulatedModel, config: &ExportConfig) -> String {
    text_of(model, config, Screws::Pair)
}

/// The same with SDF's own screw joints, for Gazebo; `None` if no joint is a screw.
pub(crate) fn screw_sdf(model: &ArticulatedModel, config: &ExportConfig) -> Option<String> {
    let is_screw = |j: &Joint| j.kind.thread_m_per_rad().is_some();
    model.joints.iter().any(is_screw).then(|| text_of(model, config, Screws::Own))
}

fn text_of(model: &ArticulatedModel, config: &ExportConfig, screws: Screws) -> String {
    let root = model.links.first().map_or(String::new(), |l| escape(&l.name));
    let threaded = screws == Screws::Pair && screw_joints(model) > 0;
    let space = if threaded { format!(" xmlns:drake=\"{DRAKE}\"") } else { String::new() };
    // Links do not collide with each other: solids that touch at rest would push a part out.
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<sdf version=\"1.9\"{space}>\n  <model name=\"{}\" \
         canonical_link=\"{root}\">\n    <self_collide>false</self_collide>\n",
        escape(&model.name)
    );
    if config.base == Base::Fixed {
        // An SDF model floats unless a joint holds it to `world`. Writing to a string cannot fail, here and
        // below.
        writeln!(
            text,
            "    <joint name=\"{}world_fixed\" type=\"fixed\">\n      <parent>world</parent>\n      \
             <child>{root}</child>\n    </joint>",
            config.prefix
        )
        .ok();
    }
    // SDF places links in the frame of the model, not of their parents: here with all joints at 0.
    let closed = vec![0.0; model.joints.len()];
    for (i, link) in model.links.iter().enumerate() {
        push_link(&mut text, link, &model.world_from_link(i, &closed));
    }
    for joint in &model.joints {
        match joint.kind.thread_m_per_rad() {
            Some(pitch) if screws == Screws::Pair => push_pair(&mut text, joint, pitch, model, &closed),
            thread => push_joint(&mut text, joint, thread, model),
        }
    }
    for link in &model.links {
        push_grasps(&mut text, link);
    }
    text.push_str("  </model>\n</sdf>\n");
    text
}

fn screw_joints(model: &ArticulatedModel) -> usize {
    model.joints.iter().filter(|j| j.kind.thread_m_per_rad().is_some()).count()
}

/// Text of `model.config`, by which Gazebo finds the model.
pub(crate) fn model_config(model: &ArticulatedModel, config: &ExportConfig) -> String {
    let file = if screw_joints(model) > 0 { SCREW_SDF } else { "model.sdf" };
    let (name, address) = config.maintainer().unwrap_or_default();
    format!(
        "<?xml version=\"1.0\"?>\n<model>\n  <name>{0}</name>\n  <version>1.0</version>\n  <sdf \
         version=\"1.9\">{file}</sdf>\n  <author>\n    <name>{1}</name>\n    <email>{2}</email>\n  \
         </author>\n  <description>Twin of a recorded object: {0}</description>\n</model>\n",
        escape(&model.name),
        escape(name),
        escape(address)
    )
}

fn push_link(text: &mut String, link: &Link, model_from_link: &Pose) {
    let name = escape(&link.name);
    let mass = &link.inertial;
    let i = &link.inertial.inertia;
    writeln!(text, "    <link name=\"{name}\">\n      <pose>{}</pose>", pose(model_from_link)).ok();
    // The tensor is along the link's axes, so the inertial frame is shifted but not rotated.
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
    for visual in link_visuals(link) {
        push_geometry(text, "visual", &visual.name, &visual.path);
    }
    for k in 0..link.collision.len() {
        push_geometry(text, "collision", &solid_name(link, k), &solid_path(link, k));
    }
    text.push_str("    </link>\n");
}

/// Adds the grasps of a link, as frames on it.
fn push_grasps(text: &mut String, link: &Link) {
    for (k, grasp) in link.grasps.iter().enumerate() {
        let name = escape(&grasp_name(link, k));
        let on = escape(&link.name);
        writeln!(text, "    <frame name=\"{name}\" attached_to=\"{on}\">").ok();
        writeln!(text, "      <pose>{}</pose>\n    </frame>", pose(&grasp.link_from_grasp)).ok();
    }
}

fn push_geometry(text: &mut String, tag: &str, name: &str, path: &str) {
    let name = escape(name);
    let path = escape(path);
    writeln!(text, "      <{tag} name=\"{name}\">\n        <geometry>\n          <mesh>").ok();
    writeln!(text, "            <uri>{path}</uri>\n          </mesh>").ok();
    let surface = if tag == "collision" { SURFACE } else { "" };
    writeln!(text, "        </geometry>\n{surface}      </{tag}>").ok();
}

/// Adds a screw as a slide and a turn that follows it, with a nearly massless link between them.
fn push_pair(
    text: &mut String,
    joint: &Joint,
    pitch_m_per_rad: f64,
    model: &ArticulatedModel,
    closed: &[f64],
) {
    let carrier = escape(&carrier_name(joint));
    let advance = escape(&joint.advance_name());
    let place = pose(&model.world_from_link(joint.child, closed));
    let mass = short(CARRIER_KG);
    let inertia = short(CARRIER_KG_M2);
    writeln!(text, "    <link name=\"{carrier}\">\n      <pose>{place}</pose>\n      <inertial>").ok();
    writeln!(text, "        <mass>{mass}</mass>\n        <inertia>").ok();
    for tag in ["ixx", "iyy", "izz"] {
        writeln!(text, "          <{tag}>{inertia}</{tag}>").ok();
    }
    text.push_str("        </inertia>\n      </inertial>\n    </link>\n");
    let [parent, child] = [joint.parent, joint.child].map(|l| escape(&model.links[l].name));
    writeln!(
        text,
        "    <joint name=\"{advance}\" type=\"prismatic\">\n      <parent>{parent}</parent>\n      \
         <child>{carrier}</child>"
    )
    .ok();
    // Friction and damping act only once, at the turn.
    push_axis(text, joint, &advance_limit(joint, pitch_m_per_rad), &JointDynamics::default());
    writeln!(
        text,
        "    </joint>\n    <joint name=\"{}\" type=\"revolute\">\n      <parent>{carrier}</parent>\n      \
         <child>{child}</child>\n      \
         <drake:mimic joint=\"{advance}\" multiplier=\"{}\" offset=\"0\"/>",
        escape(&joint.name),
        short(1.0 / pitch_m_per_rad)
    )
    .ok();
    push_axis(text, joint, &joint.limit, &joint.dynamics);
    text.push_str("    </joint>\n");
}

fn push_joint(text: &mut String, joint: &Joint, thread_m_per_rad: Option<f64>, model: &ArticulatedModel) {
    let kind = if thread_m_per_rad.is_some() { "screw" } else { joint.kind.nearest_simple().name() };
    let [parent, child] = [joint.parent, joint.child].map(|l| escape(&model.links[l].name));
    writeln!(
        text,
        "    <joint name=\"{}\" type=\"{kind}\">\n      <parent>{parent}</parent>\n      \
         <child>{child}</child>",
        escape(&joint.name)
    )
    .ok();
    if let Some(pitch) = thread_m_per_rad {
        // Meters a revolution; positive for a right-handed thread.
        let pitch = short(std::f64::consts::TAU * pitch);
        writeln!(text, "      <screw_thread_pitch>{pitch}</screw_thread_pitch>").ok();
    }
    push_axis(text, joint, &joint.limit, &joint.dynamics);
    text.push_str("    </joint>\n");
}

fn push_axis(text: &mut String, joint: &Joint, l: &Limit, d: &JointDynamics) {
    let axis = triple(joint.axis.as_ref().as_ref());
    writeln!(text, "      <axis>\n        <xyz>{axis}</xyz>\n        <limit>").ok();
    for (tag, value) in
        [("lower", l.lower), ("upper", l.upper), ("effort", l.effort), ("velocity", l.velocity)]
    {
        writeln!(text, "          <{tag}>{}</{tag}>", short(value)).ok();
    }
    text.push_str("        </limit>\n        <dynamics>\n");
    // Unlike URDF, SDF has a place for a spring.
    let dynamics = [
        ("damping", d.damping),
        ("friction", d.friction),
        ("spring_reference", d.spring_reference),
        ("spring_stiffness", d.stiffness),
    ];
    for (tag, value) in dynamics {
        writeln!(text, "          <{tag}>{}</{tag}>", short(value)).ok();
    }
    text.push_str("        </dynamics>\n      </axis>\n");
}

fn pose(target_from_source: &Pose) -> String {
    let (xyz, rpy) = origin(target_from_source);
    format!("{xyz} {rpy}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::{JointKind, example::cabinet};

    #[test]
    fn links_stand_where_position_0_puts_them() {
        let model = cabinet();
        let config = ExportConfig::default();
        let text = sdf(&model, &config);
        let document = roxmltree::Document::parse(&text).unwrap();
        let all = |tag: &str| document.descendants().filter(|n| n.has_tag_name(tag)).count();
        assert_eq!([all("link"), all("joint"), all("visual"), all("collision"), all("ixx")], [3, 3, 3, 3, 3]);
        assert_eq!([all("surface"), all("mu"), all("mu2")], [3, 3, 3]);
        assert!(text.contains("<pose>0.2 -0.25 0.3 0.1 -0.2 0.3</pose>"), "{text}");
        assert!(screw_sdf(&model, &config).is_none());
        let found = model_config(&model, &config);
        assert!(
            found.contains(">model.sdf<") && found.contains("<email>nobody@example.com</email>"),
            "{found}"
        );
        assert!(roxmltree::Document::parse(&found).is_ok());
    }

    #[test]
    fn a_floating_base_is_held_by_nothing() {
        let config = ExportConfig { base: Base::Floating, ..ExportConfig::default() };
        assert!(!sdf(&cabinet(), &config).contains(">world<"));
        let config = ExportConfig { prefix: "left_".into(), ..ExportConfig::default() };
        assert!(sdf(&cabinet(), &config).contains("<joint name=\"left_world_fixed\" type=\"fixed\">"));
    }

    #[test]
    fn a_screw_is_sdfs_own_for_gazebo_and_a_pair_with_limits_for_drake() {
        let mut model = cabinet();
        let config = ExportConfig::default();
        model.joints[1].kind = JointKind::Screw { pitch_m_per_rad: -0.5 };
        let pair = sdf(&model, &config);
        let document = roxmltree::Document::parse(&pair).unwrap();
        let joints: Vec<_> = document.descendants().filter(|n| n.has_tag_name("joint")).collect();
        let of = |name: &str| *joints.iter().find(|n| n.attribute("name") == Some(name)).unwrap();
        let word = |joint: roxmltree::Node, tag: &str| {
            joint.descendants().find(|n| n.has_tag_name(tag)).and_then(|n| n.text()).unwrap().to_owned()
        };
        let slide = of("drawer_slide_advance");
        let turn = of("drawer_slide");
        assert_eq!((slide.attribute("type"), turn.attribute("type")), (Some("prismatic"), Some("revolute")));
        assert_eq!((word(slide, "lower"), word(slide, "upper")), ("-0.09".to_owned(), "0".to_owned()));
        assert_eq!((word(turn, "lower"), word(turn, "upper")), ("0".to_owned(), "0.18".to_owned()));
        assert_eq!(word(slide, "child"), word(turn, "parent"));
        let mimic = turn.children().find(|n| n.tag_name().name() == "mimic").unwrap();
        assert_eq!(mimic.tag_name().namespace(), Some(DRAKE));
        assert_eq!(
            (mimic.attribute("joint"), mimic.attribute("multiplier")),
            (slide.attribute("name"), Some("-2"))
        );
        let own = screw_sdf(&model, &config).unwrap();
        assert!(own.contains("type=\"screw\"") && own.contains("<screw_thread_pitch>-3.14159265<"), "{own}");
        assert!(model_config(&model, &config).contains(">screw.sdf<"));
    }
}
