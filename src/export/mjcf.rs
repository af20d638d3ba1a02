//! MJCF text, with what URDF cannot express: textures, excluded pairs, keyframes, friction, armature,
//! springs.

use std::fmt::Write as _;

use nalgebra::{Matrix3, Point3, Quaternion, UnitQuaternion, Vector3};

use super::{
    config::{Base, ExportConfig},
    drawn::link_visuals,
    number::decimal,
    urdf::{advance_limit, grasp_name, short, solid_name, solid_path, triple},
};
use geometry::Pose;
use model::{ArticulatedModel, Joint, Limit, Link, escape_xml as escape};

/// Defaults for all bodies; PREFIX keeps the classes of several twins apart. Collision geoms have no mass:
/// the bodies state theirs.
const HEAD: &str = r#"  <compiler angle="radian" meshdir="." texturedir="." autolimits="true" balanceinertia="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <visual>
    <headlight ambient="0.45 0.45 0.45" diffuse="0.5 0.5 0.5"/>
  </visual>
  <default>
    <default class="PREFIXvisual">
      <geom type="mesh" contype="0" conaffinity="0" group="2" density="0"/>
    </default>
    <default class="PREFIXcollision">
      <geom type="mesh" group="3" rgba="0.6 0.6 0.6 0.3" density="0" friction="0.6 0.005 0.0001"/>
    </default>
  </default>
"#;

/// Makes dry friction as stiff as the solver allows: with MuJoCo's defaults a joint creeps under a load that
/// friction should hold.
const HARD_FRICTION: &str = "solreffriction=\"0.004 1\" solimpfriction=\"0.9999 0.9999 0.001 0.5 2\"";

/// Makes a thread stiff: with MuJoCo's defaults a lid sinks into its jar.
const HARD_THREAD: &str = "solref=\"0.004 1\" solimp=\"0.99 0.999 0.001 0.5 2\"";

/// MJCF text of a model. Paths are relative to the file's folder; link 0 is fixed in the world or free to
/// move.
pub(crate) fn mjcf(model: &ArticulatedModel, config: &ExportConfig) -> String {
    let head = HEAD.replace("PREFIX", &config.prefix);
    let mut text = format!("<mujoco model=\"{}\">\n{head}  <asset>\n", escape(&model.name));
    for link in &model.links {
        push_assets(&mut text, link);
    }
    text.push_str("  </asset>\n  <worldbody>\n");
    push_body(&mut text, model, config, 0, None);
    text.push_str("  </worldbody>\n  <contact>\n");
    // MuJoCo does not exclude parent and child if the parent is welded to the world: solids that touch at
    // rest would push the child out.
    for joint in &model.joints {
        let [parent, child] = [joint.parent, joint.child].map(|l| escape(&model.links[l].name));
        // Writing to a string cannot fail, here and below.
        writeln!(text, "    <exclude body1=\"{parent}\" body2=\"{child}\"/>").ok();
    }
    text.push_str("  </contact>\n");
    push_threads(&mut text, model);
    text.push_str("  <keyframe>\n");
    let observed = model.states.iter().enumerate().map(|(k, state)| (format!("state{k}"), state.clone()));
    for (name, state) in observed.chain(model.closed_state().map(|state| ("closed".to_owned(), state))) {
        let prefix = &config.prefix;
        let positions = positions(model, config.base, &state);
        writeln!(text, "    <key name=\"{prefix}{name}\" qpos=\"{positions}\"/>").ok();
    }
    text.push_str("  </keyframe>\n</mujoco>\n");
    text
}

/// Positions of all movable joints of the file made by [`mjcf`], in its order.
pub(super) fn positions(model: &ArticulatedModel, base: Base, state: &[f64]) -> String {
    // A free root comes first: its position, then its quaternion.
    let root = (base == Base::Floating).then(|| "0 0 0 1 0 0 0".to_owned());
    // A keyframe must satisfy the threads; if it violates an equality, the solver moves the joints at once.
    let mut positions: Vec<String> = root.into_iter().collect();
    for j in joint_order(model, 0) {
        positions.extend(model.joints[j].kind.thread_m_per_rad().map(|pitch| short(pitch * state[j])));
        positions.push(short(state[j]));
    }
    positions.join(" ")
}

/// Joints in the order of their bodies in the text, which is also the order of positions in a keyframe.
fn joint_order(model: &ArticulatedModel, link: usize) -> Vec<usize> {
    let children = (0..model.joints.len()).filter(|&j| model.joints[j].parent == link);
    children
        .flat_map(|j| std::iter::once(j).chain(joint_order(model, model.joints[j].child)).collect::<Vec<_>>())
        .collect()
}

/// Equality between hinge and slide of a screw; `None` for other joints.
fn thread_equality(joint: &Joint) -> Option<String> {
    let name = escape(&joint.name);
    let advance = escape(&joint.advance_name());
    let turn = short(1.0 / joint.kind.thread_m_per_rad()?);
    Some(format!(
        "    <joint name=\"{name}_thread\" joint1=\"{name}\" joint2=\"{advance}\" polycoef=\"0 \
         {turn} 0 0 0\" {HARD_THREAD}/>\n"
    ))
}

/// Ties the hinge of every screw to its slide.
fn push_threads(text: &mut String, model: &ArticulatedModel) {
    // docs/method.md (11.2): the position of `joint1` is a polynomial in that of `joint2`. The hinge is
    // `joint1`: MuJoCo softens a constraint by the inertia of either joint, whatever the factor, and a lid's
    // is small.
    let threads: String = model.joints.iter().filter_map(thread_equality).collect();
    if !threads.is_empty() {
        write!(text, "  <equality>\n{threads}  </equality>\n").ok();
    }
}

fn push_assets(text: &mut String, link: &Link) {
    for visual in link_visuals(link) {
        // MuJoCo ignores the texture of a mesh file, so it is named here, as PNG, the only format it reads.
        let [name, material, file, texture] =
            [&visual.name, &visual.material, &visual.path, &visual.texture_path()].map(|s| escape(s));
        writeln!(text, "    <texture name=\"{material}\" type=\"2d\" file=\"{texture}\"/>").ok();
        writeln!(text, "    <material name=\"{material}\" texture=\"{material}\" specular=\"0.1\"/>").ok();
        writeln!(text, "    <mesh name=\"{name}\" file=\"{file}\"/>").ok();
    }
    for k in 0..link.collision.len() {
        writeln!(
            text,
            "    <mesh name=\"{}\" file=\"{}\"/>",
            escape(&solid_name(link, k)),
            escape(&solid_path(link, k))
        )
        .ok();
    }
}

fn push_body(
    text: &mut String,
    model: &ArticulatedModel,
    config: &ExportConfig,
    index: usize,
    joint: Option<&Joint>,
) {
    let link = &model.links[index];
    let prefix = &config.prefix;
    let depth = (0..model.links.len()).filter(|&above| model.is_below(index, above)).count();
    let name = escape(&link.name);
    let pad = "  ".repeat(depth + 2);
    let pose = joint.map_or_else(Pose::identity, |j| j.parent_from_joint);
    writeln!(text, "{pad}{}", body_tag(&link.name, &pose)).ok();
    let mass = &link.inertial;
    writeln!(text, "{pad}  {}", inertial(mass.mass_kg, &mass.center_of_mass, &mass.inertia)).ok();
    match joint {
        Some(joint) => push_joint(text, joint, &pad),
        None if config.base == Base::Floating => {
            writeln!(text, "{pad}  <freejoint name=\"{name}_free\"/>").ok();
        }
        None => {}
    }
    for visual in link_visuals(link) {
        let [name, material] = [&visual.name, &visual.material].map(|s| escape(s));
        writeln!(
            text,
            "{pad}  <geom class=\"{prefix}visual\" name=\"{name}\" mesh=\"{name}\" material=\"{material}\"/>"
        )
        .ok();
    }
    for k in 0..link.collision.len() {
        let solid = escape(&solid_name(link, k));
        writeln!(text, "{pad}  <geom class=\"{prefix}collision\" name=\"{solid}\" mesh=\"{solid}\"/>").ok();
    }
    for (k, grasp) in link.grasps.iter().enumerate() {
        // Group 4 is displayed only on request.
        let site = escape(&grasp_name(link, k));
        let place = place(&grasp.link_from_grasp);
        writeln!(text, "{pad}  <site name=\"{site}\" {place} size=\"0.005\" group=\"4\"/>").ok();
    }
    // In the order of `joint_order`, as in the keyframes.
    for below in model.joints.iter().filter(|j| j.parent == index) {
        push_body(text, model, config, below.child, Some(below));
    }
    writeln!(text, "{pad}</body>").ok();
}

fn push_joint(text: &mut String, joint: &Joint, pad: &str) {
    // The slide precedes the hinge, as in the keyframes, and the thread ties both. The hinge has the friction
    // and damping; its range is for readers that ignore equalities, such as Drake.
    if let Some(pitch) = joint.kind.thread_m_per_rad() {
        let start = joint_start(&joint.advance_name(), false, &joint.axis);
        let Limit { lower, upper, .. } = advance_limit(joint, pitch);
        let range = format!("{} {}", short(lower), short(upper));
        writeln!(text, "{pad}  {start} range=\"{range}\"/>").ok();
    }
    let l = &joint.limit;
    let d = &joint.dynamics;
    writeln!(
        text,
        "{pad}  {} range=\"{} {}\" damping=\"{}\" \
         frictionloss=\"{}\" armature=\"{}\" \
         stiffness=\"{}\" springref=\"{}\" {HARD_FRICTION}/>",
        joint_start(&joint.name, joint.kind.turns(), &joint.axis),
        short(l.lower),
        short(l.upper),
        short(d.damping),
        short(d.friction),
        short(d.armature),
        short(d.stiffness),
        short(d.spring_reference),
    )
    .ok();
}

/// Start tag of a body, also for the twin of a diagnosis, as are the two below.
pub(super) fn body_tag(name: &str, parent_from_body: &Pose) -> String {
    format!("<body name=\"{}\" {}>", escape(name), place(parent_from_body))
}

/// Element of a body's mass, kg, its center, meters, and the inertia about it, kg m^2.
pub(super) fn inertial(mass_kg: f64, center: &Point3<f64>, inertia: &Matrix3<f64>) -> String {
    // In MuJoCo's order: the diagonal first, then xy, xz, yz.
    let full = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|k| short(inertia[k])).join(" ");
    let center = triple(center.coords.as_ref());
    format!("<inertial pos=\"{center}\" mass=\"{}\" fullinertia=\"{full}\"/>", short(mass_kg))
}

/// Start of a joint's element, to be continued with attributes.
pub(super) fn joint_start(name: &str, turns: bool, axis: &Vector3<f64>) -> String {
    let kind = if turns { "hinge" } else { "slide" };
    format!("<joint name=\"{}\" type=\"{kind}\" axis=\"{}\"", escape(name), triple(axis.as_ref()))
}

/// `pos` and `quat` (w first) of a pose.
fn place(pose: &Pose) -> String {
    format!(
        "pos=\"{}\" quat=\"{}\"",
        triple(pose.translation.vector.as_ref()),
        quaternion(&pose.rotation).map(|x| decimal(x, 12)).join(" ")
    )
}

/// w, x, y, z with w not negative.
pub(super) fn quaternion(rotation: &UnitQuaternion<f64>) -> [f64; 4] {
    // Of the two quaternions of a rotation always the same one is taken, so equal poses give equal text.
    let q: Quaternion<f64> = if rotation.w < 0.0 { -rotation.into_inner() } else { rotation.into_inner() };
    [q.w, q.i, q.j, q.k]
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::{JointKind, Seat, example::cabinet};

    #[test]
    fn every_link_joint_pair_and_state_is_there() {
        let mut model = cabinet();
        model.joints[0].dynamics.friction = 0.3;
        let text = mjcf(&model, &ExportConfig::default());
        let count = |what: &str| text.matches(what).count();
        assert_eq!(
            [count("<body "), count("<joint "), count("<exclude "), count("<key "), count("<texture ")],
            [3, 2, 2, 2, 3]
        );
        assert_eq!(
            [count("class=\"visual\" name"), count("class=\"collision\" name"), count("<inertial ")],
            [3, 3, 3]
        );
        assert!(
            text.contains("qpos=\"1.25 0\"")
                && text.contains("frictionloss=\"0.3\"")
                && text.contains("range=\"0 0.18\""),
            "{text}"
        );
        assert!(roxmltree::Document::parse(&text).is_ok());
    }

    #[test]
    fn what_closes_stands_closed_in_a_keyframe() {
        let mut model = cabinet();
        let text = |model: &ArticulatedModel| mjcf(model, &ExportConfig::default());
        assert!(!text(&model).contains("name=\"closed\""));
        let seat = Seat { position: -0.02, std: 1e-4, contact_share: 0.3, above: false };
        (model.joints[0].limit.closed, model.joints[0].limit.lower) = (Some(seat), -0.02);
        assert!(text(&model).contains("<key name=\"closed\" qpos=\"-0.02 0.18\"/>"), "{}", text(&model));
        // A limit that ends before it keeps it open.
        model.joints[0].limit.lower = 0.0;
        assert!(text(&model).contains("<key name=\"closed\" qpos=\"0 0.18\"/>"));
    }

    #[test]
    fn a_screw_is_a_slide_tied_to_a_hinge() {
        let mut model = cabinet();
        model.joints[1].kind = JointKind::Screw { pitch_m_per_rad: 0.5 };
        let text = mjcf(&model, &ExportConfig::default());
        assert!(text.contains("<joint name=\"drawer_slide_advance\" type=\"slide\""), "{text}");
        assert!(text.contains("<joint name=\"drawer_slide\" type=\"hinge\""));
        assert!(
            text.contains("joint1=\"drawer_slide\" joint2=\"drawer_slide_advance\" polycoef=\"0 2 0 0 0\"")
        );
        // Both positions of the screw stand in every keyframe.
        assert!(text.contains("qpos=\"0 0.09 0.18\""), "{text}");
        assert!(roxmltree::Document::parse(&text).is_ok());
    }

    #[test]
    fn keyframes_follow_the_nesting_of_the_bodies() {
        let mut model = cabinet();
        // The drawer comes first in the list but hangs on the door.
        model.joints.swap(0, 1);
        model.states.iter_mut().for_each(|s| s.swap(0, 1));
        model.joints[0].parent = 1;
        assert_eq!(joint_order(&model, 0), [1, 0]);
        assert!(mjcf(&model, &ExportConfig::default()).contains("qpos=\"0 0.18\""));
    }

    #[test]
    fn a_floating_root_is_free_and_stands_in_the_keyframes() {
        let config =
            ExportConfig { base: Base::Floating, prefix: "left_".to_owned(), ..ExportConfig::default() };
        let text = mjcf(&cabinet(), &config);
        assert!(text.contains("<freejoint name=\"body_free\"/>"), "{text}");
        assert!(text.contains("<key name=\"left_state1\" qpos=\"0 0 0 1 0 0 0 1.25 0\"/>"), "{text}");
        let document = roxmltree::Document::parse(&text).unwrap();
        let classes = document.descendants().filter_map(|n| n.attribute("class"));
        assert!(classes.clone().count() > 2 && classes.clone().all(|c| c.starts_with("left_")), "{text}");
        assert!(!mjcf(&cabinet(), &ExportConfig::default()).contains("freejoint"));
    }
}
