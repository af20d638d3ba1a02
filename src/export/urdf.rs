//! URDF text of an articulated model.
//!
//! Written by hand because URDF libraries drop the `<mujoco>` element; without it MuJoCo drops the visual
//! meshes, strips their folder and fuses the root link with the world.

use std::fmt::Write as _;

use nalgebra::UnitQuaternion;

use super::{
    config::UrdfScrew,
    drawn::link_visuals,
    number::{decimal, significant},
};
use geometry::Pose;
use model::{ArticulatedModel, Joint, JointDynamics, Limit, Link, escape_xml as escape, identifier};

/// Folder of the URDF in which the nearest simple joint replaces a screw.
pub const SINGLE_JOINT: &str = "single_joint";

/// Decimals of lengths, angles and axes.
const PLACES: usize = 12;
/// Significant digits of masses, inertias and limits.
const DIGITS: usize = 9;
/// Cosine of the pitch below which yaw is not defined. chosen: above the rounding of a double
const GIMBAL_LOCK: f64 = 1e-10;
/// MuJoCo reads this element; every other importer ignores it.
const MUJOCO: &str = r#"  <mujoco>
    <compiler meshdir="." strippath="false" discardvisual="false" fusestatic="false" balanceinertia="true"/>
  </mujoco>
"#;

/// Namespace of elements outside URDF, which readers skip.
const NAMESPACE: &str = "urn:artitwin:urdf";
/// Mass of the link between the two joints of a pair, kg. It should weigh nothing, but simulators need a mass
/// and an inertia. chosen: a gram, with a radius of gyration of 3 cm
pub(super) const CARRIER_KG: f64 = 1e-3;
pub(super) const CARRIER_KG_M2: f64 = 1e-6;

/// Friction of surfaces, for Gazebo.
const GAZEBO_FRICTION: &str = "<mu1>0.6</mu1><mu2>0.6</mu2>";

/// How names and paths are written.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Form<'a> {
    /// Prefix of the path of every mesh.
    pub paths: &'a str,
    /// Prefix of the name of every link and joint.
    pub names: &'a str,
    /// How a screw is represented.
    pub screws: UrdfScrew,
    /// Whether the friction of surfaces is written for Gazebo.
    pub gazebo: bool,
}

/// URDF text of a model. Mesh paths are relative to the URDF's folder. The model must have no findings
/// ([`model::validate`]).
pub(crate) fn urdf(model: &ArticulatedModel, screws: UrdfScrew) -> String {
    robot(model, Form { screws, ..Form::default() })
}

/// URDF text in which every joint is a single joint, for the folder [`SINGLE_JOINT`].
pub(crate) fn single_joint_urdf(model: &ArticulatedModel) -> String {
    robot(model, Form { paths: "../", screws: UrdfScrew::Nearest, ..Form::default() })
}

/// URDF text for ROS tools, which need `package://<name>/...` instead of relative paths.
pub(crate) fn ros_urdf(model: &ArticulatedModel, screws: UrdfScrew) -> String {
    let paths = format!("package://{}/", identifier(&model.name));
    robot(model, Form { paths: &paths, names: "", screws, gazebo: true })
}

/// Whether a joint is written as the nearest joint of URDF.
fn is_nearest(j: &Joint, screws: UrdfScrew) -> bool {
    j.kind.pitch_m_per_rad().is_some()
        && (screws == UrdfScrew::Nearest || j.kind.thread_m_per_rad().is_none())
}

fn robot(model: &ArticulatedModel, form: Form) -> String {
    // The namespace is declared only if elements outside URDF are used.
    let space = if model.joints.iter().any(|j| is_nearest(j, form.screws)) {
        format!(" xmlns:artitwin=\"{NAMESPACE}\"")
    } else {
        String::new()
    };
    let mut text = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\"{space}>\n", escape(&model.name));
    push_elements(&mut text, model, form);
    // Last, where every importer tried accepts or skips it.
    text.push_str(MUJOCO);
    text.push_str("</robot>\n");
    text
}

/// Adds links and joints.
pub(super) fn push_elements(text: &mut String, model: &ArticulatedModel, form: Form) {
    for link in &model.links {
        push_link(text, link, form);
    }
    for joint in &model.joints {
        match joint.kind.thread_m_per_rad() {
            Some(pitch) if form.screws == UrdfScrew::Pair => {
                push_pair(text, joint, pitch, &model.links, form.names);
            }
            _ => push_joint(text, joint, &model.links, form.names),
        }
    }
    for link in model.links.iter().filter(|_| form.gazebo) {
        // Writing to a string cannot fail, here and below.
        let name = escape(&link.name);
        writeln!(text, "  <gazebo reference=\"{}{name}\">{GAZEBO_FRICTION}</gazebo>", form.names).ok();
    }
}

/// Name of a link's collision solid in all formats, and of its file.
pub(crate) fn solid_name(link: &Link, solid: usize) -> String {
    format!("{}_solid_{solid}", link.name)
}

/// Name of a grasp of a link in all formats, counted from 1.
pub(crate) fn grasp_name(link: &Link, grasp: usize) -> String {
    format!("{}_grasp_{}", link.name, grasp + 1)
}

/// Path of a link's collision solid, relative to the URDF's folder.
pub(crate) fn solid_path(link: &Link, solid: usize) -> String {
    format!("meshes/collision/{}.obj", identifier(&solid_name(link, solid)))
}

/// Roll, pitch and yaw about the fixed axes x, y, z: `R = Rz(yaw) Ry(pitch) Rx(roll)`, radians.
///
/// The pitch is computed from a tangent and the roll from what yaw leaves over, so the angles reproduce
/// the rotation to rounding even near a pitch of a right angle. There only a sum of roll and yaw is defined,
/// and yaw is 0.
pub fn roll_pitch_yaw(rotation: &UnitQuaternion<f64>) -> [f64; 3] {
    let r = rotation.to_rotation_matrix();
    // docs/method.md (11.1).
    let level = r[(0, 0)].hypot(r[(1, 0)]);
    let yaw = if level < GIMBAL_LOCK { 0.0 } else { r[(1, 0)].atan2(r[(0, 0)]) };
    let pitch = (-r[(2, 0)]).atan2(level);
    let (s, c) = yaw.sin_cos();
    let roll = (s * r[(0, 2)] - c * r[(1, 2)]).atan2(c * r[(1, 1)] - s * r[(0, 1)]);
    [roll, pitch, yaw]
}

fn push_link(text: &mut String, link: &Link, Form { paths, names, .. }: Form) {
    let name = format!("{names}{}", escape(&link.name));
    let mass = &link.inertial;
    let i = &mass.inertia;
    // An inertial is always written: without it Gazebo drops the link, Drake gives it no mass and PyBullet 1
    // kg.
    let com = triple(mass.center_of_mass.coords.as_ref());
    writeln!(text, "  <link name=\"{name}\">").ok();
    writeln!(
        text,
        "    <inertial>\n      <origin xyz=\"{com}\" rpy=\"0 0 0\"/>\n      <mass value=\"{}\"/>",
        short(mass.mass_kg)
    )
    .ok();
    writeln!(
        text,
        "      <inertia ixx=\"{}\" ixy=\"{}\" ixz=\"{}\" iyy=\"{}\" iyz=\"{}\" izz=\"{}\"/>\n    </inertial>",
        short(i[(0, 0)]),
        short(i[(0, 1)]),
        short(i[(0, 2)]),
        short(i[(1, 1)]),
        short(i[(1, 2)]),
        short(i[(2, 2)])
    )
    .ok();
    // No `<material>` beside the texture: Newton would use it instead of the texture.
    for visual in link_visuals(link) {
        writeln!(text, "    <visual name=\"{names}{}\">", escape(&visual.name)).ok();
        push_mesh(text, &format!("{paths}{}", visual.path));
        text.push_str("    </visual>\n");
    }
    // One convex solid per collision: importers replace a concave mesh by its hull, and a drawer could not
    // move.
    for k in 0..link.collision.len() {
        writeln!(text, "    <collision name=\"{names}{}\">", escape(&solid_name(link, k))).ok();
        push_mesh(text, &format!("{paths}{}", solid_path(link, k)));
        text.push_str("    </collision>\n");
    }
    text.push_str("  </link>\n");
}

fn push_mesh(text: &mut String, path: &str) {
    // The vertices are in the link frame already, so there is no origin or scale to misread.
    let path = escape(path);
    writeln!(
        text,
        "      <origin xyz=\"0 0 0\" rpy=\"0 0 0\"/>\n      <geometry>\n        <mesh \
        filename=\"{path}\"/>\n      </geometry>"
    )
    .ok();
}

fn push_joint(text: &mut String, joint: &Joint, links: &[Link], names: &str) {
    let ends = [joint.parent, joint.child].map(|l| links[l].name.as_str());
    open_joint(
        text,
        &joint.name,
        joint.kind.nearest_simple().name(),
        &joint.parent_from_joint,
        ends,
        joint,
        names,
    );
    if let Some(pitch) = joint.kind.pitch_m_per_rad() {
        let kind = joint.kind.name();
        writeln!(
            text,
            "    <artitwin:thread type=\"{kind}\" pitch_m_per_rad=\"{}\"/>",
            decimal(pitch, PLACES)
        )
        .ok();
    }
    push_limit(text, joint);
}

/// Adds a screw as a slide and a turn that follows it, with a nearly massless link between them. The turn is
/// the follower, as MuJoCo then holds it stiffly ([`super::mjcf`]).
fn push_pair(text: &mut String, joint: &Joint, pitch_m_per_rad: f64, links: &[Link], names: &str) {
    let carrier = carrier_name(joint);
    let advance = joint.advance_name();
    let link = escape(&carrier);
    writeln!(
        text,
        "  <link name=\"{names}{link}\">\n    <inertial>\n      <origin xyz=\"0 0 0\" rpy=\"0 0 0\"/>"
    )
    .ok();
    let mass = short(CARRIER_KG);
    let inertia = short(CARRIER_KG_M2);
    writeln!(text, "      <mass value=\"{mass}\"/>").ok();
    writeln!(
        text,
        "      <inertia ixx=\"{inertia}\" ixy=\"0\" ixz=\"0\" iyy=\"{inertia}\" iyz=\"0\" izz=\"{inertia}\"/>"
    )
    .ok();
    text.push_str("    </inertial>\n  </link>\n");
    let ends = [links[joint.parent].name.as_str(), carrier.as_str()];
    open_joint(text, &advance, "prismatic", &joint.parent_from_joint, ends, joint, names);
    let limit = advance_limit(joint, pitch_m_per_rad);
    // Friction and damping act only once, at the turn.
    push_limit(text, &Joint { limit, dynamics: JointDynamics::default(), ..joint.clone() });
    // The turn keeps the joint's name: the positions in the report are turns.
    let ends = [carrier.as_str(), links[joint.child].name.as_str()];
    open_joint(text, &joint.name, "revolute", &Pose::identity(), ends, joint, names);
    writeln!(
        text,
        "    <mimic joint=\"{names}{}\" multiplier=\"{}\" offset=\"0\"/>",
        escape(&advance),
        short(1.0 / pitch_m_per_rad)
    )
    .ok();
    push_limit(text, joint);
}

/// Name of the link between the slide and the turn of a screw.
pub(super) fn carrier_name(joint: &Joint) -> String {
    format!("{}_carrier", joint.name)
}

/// Limits of the slide of a screw.
pub(super) fn advance_limit(joint: &Joint, pitch_m_per_rad: f64) -> Limit {
    // A left-handed thread has a negative pitch, which swaps the ends.
    let mut ends = [joint.limit.lower, joint.limit.upper].map(|q| pitch_m_per_rad * q);
    ends.sort_by(f64::total_cmp);
    Limit { lower: ends[0], upper: ends[1], ..joint.limit }
}

fn open_joint(
    text: &mut String,
    name: &str,
    kind: &str,
    parent_from_joint: &Pose,
    [parent, child]: [&str; 2],
    joint: &Joint,
    names: &str,
) {
    let (xyz, rpy) = origin(parent_from_joint);
    writeln!(text, "  <joint name=\"{names}{}\" type=\"{kind}\">", escape(name)).ok();
    writeln!(text, "    <origin xyz=\"{xyz}\" rpy=\"{rpy}\"/>").ok();
    writeln!(text, "    <parent link=\"{names}{}\"/>", escape(parent)).ok();
    writeln!(text, "    <child link=\"{names}{}\"/>", escape(child)).ok();
    writeln!(text, "    <axis xyz=\"{}\"/>", triple(joint.axis.as_ref().as_ref())).ok();
}

/// Adds limits and dynamics, and closes the joint element.
fn push_limit(text: &mut String, joint: &Joint) {
    // urdfdom refuses a whole model because of a joint without effort or velocity.
    let l = &joint.limit;
    writeln!(
        text,
        "    <limit lower=\"{}\" upper=\"{}\" effort=\"{}\" velocity=\"{}\"/>",
        decimal(l.lower, PLACES),
        decimal(l.upper, PLACES),
        short(l.effort),
        short(l.velocity)
    )
    .ok();
    // Drake, PyBullet and SAPIEN use the damping but ignore the friction.
    let d = &joint.dynamics;
    writeln!(
        text,
        "    <dynamics damping=\"{}\" friction=\"{}\"/>\n  </joint>",
        short(d.damping),
        short(d.friction)
    )
    .ok();
}

/// `xyz` and `rpy` of a pose.
pub(super) fn origin(target_from_source: &Pose) -> (String, String) {
    (
        triple(target_from_source.translation.vector.as_ref()),
        triple(&roll_pitch_yaw(&target_from_source.rotation)),
    )
}

pub(super) fn triple(v: &[f64; 3]) -> String {
    v.map(|x| decimal(x, PLACES)).join(" ")
}

pub(super) fn short(x: f64) -> String {
    significant(x, DIGITS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::{JointKind, example::cabinet};
    use nalgebra::{Translation3, Unit, Vector3};
    use proptest::prelude::*;

    /// What a reader of the file gets back from roll, pitch, yaw and xyz.
    fn read_back(pose: &urdf_rs::Pose) -> Pose {
        Pose::from_parts(
            Translation3::from(pose.xyz.0),
            UnitQuaternion::from_euler_angles(pose.rpy[0], pose.rpy[1], pose.rpy[2]),
        )
    }

    fn check(rotation: &UnitQuaternion<f64>) {
        let [r, p, y] = roll_pitch_yaw(rotation).map(|x| decimal(x, PLACES).parse::<f64>().unwrap());
        let back = UnitQuaternion::from_euler_angles(r, p, y);
        let error = (back.to_rotation_matrix().matrix() - rotation.to_rotation_matrix().matrix()).norm();
        assert!(error < 1e-9, "{r} {p} {y}: {error}");
    }

    proptest! {
        #[test]
        fn any_rotation_survives_the_text(v in prop::array::uniform3(-4.0..4.0f64)) {
            check(&UnitQuaternion::from_scaled_axis(Vector3::from(v)));
        }

        #[test]
        fn so_does_one_near_the_gimbal_lock(
            roll in -3.2..3.2f64,
            yaw in -3.2..3.2f64,
            power in 3.0..18.0f64,
            up: bool,
        ) {
            let pitch = (std::f64::consts::FRAC_PI_2 - 10f64.powf(-power)) * if up { 1.0 } else { -1.0 };
            check(&UnitQuaternion::from_euler_angles(roll, pitch, yaw));
        }
    }

    #[test]
    fn text_is_the_golden_one() {
        let text = urdf(&cabinet(), UrdfScrew::Nearest);
        assert_eq!(text, urdf(&cabinet(), UrdfScrew::Nearest));
        assert_eq!(text, include_str!("../../tests/golden/cabinet.urdf"), "{text}");
    }

    #[test]
    fn reads_back_as_the_model() {
        let model = cabinet();
        let robot = urdf_rs::read_from_string(&urdf(&model, UrdfScrew::Nearest)).unwrap();
        assert_eq!((robot.name.as_str(), robot.links.len(), robot.joints.len()), ("cabinet", 3, 2));
        assert_eq!((robot.links[0].collision.len(), robot.links[1].collision.len()), (1, 1));
        for (read, link) in robot.links.iter().zip(&model.links) {
            assert_eq!(read.name, link.name);
            assert!((read.inertial.mass.value - link.inertial.mass_kg).abs() < 1e-9);
            assert!((read.inertial.inertia.izz / link.inertial.inertia[(2, 2)] - 1.0).abs() < 1e-8);
            let urdf_rs::Geometry::Mesh { filename, .. } = &read.visual[0].geometry else {
                panic!("no mesh")
            };
            assert_eq!(*filename, format!("meshes/visual/{}.obj", link.name));
        }
        for (read, joint) in robot.joints.iter().zip(&model.joints) {
            let revolute = read.joint_type == urdf_rs::JointType::Revolute;
            assert_eq!(revolute, joint.kind == JointKind::Revolute);
            let off = read_back(&read.origin).inverse() * joint.parent_from_joint;
            assert!(off.translation.vector.norm() < 1e-11 && off.rotation.angle() < 1e-9);
            assert!(
                (Unit::new_normalize(Vector3::from(read.axis.xyz.0)).into_inner() - joint.axis.into_inner())
                    .norm()
                    < 1e-11
            );
            let l = &read.limit;
            assert_eq!(
                [l.lower, l.upper, l.effort, l.velocity],
                [joint.limit.lower, joint.limit.upper, 50.0, 2.0]
            );
        }
    }

    #[test]
    fn a_screw_is_the_nearest_joint_with_its_pitch_or_a_pair_that_mimics() {
        let mut model = cabinet();
        model.joints[1].kind = JointKind::Screw { pitch_m_per_rad: -0.5 };
        let nearest = urdf(&model, UrdfScrew::Nearest);
        let robot = urdf_rs::read_from_string(&nearest).unwrap();
        assert_eq!((robot.joints.len(), &robot.joints[1].joint_type), (2, &urdf_rs::JointType::Revolute));
        assert!(nearest.contains("<artitwin:thread type=\"screw\" pitch_m_per_rad=\"-0.5\"/>"), "{nearest}");
        let pair = urdf_rs::read_from_string(&urdf(&model, UrdfScrew::Pair)).unwrap();
        let [slide, turn] = [&pair.joints[1], &pair.joints[2]];
        assert_eq!(
            (&slide.joint_type, &turn.joint_type),
            (&urdf_rs::JointType::Prismatic, &urdf_rs::JointType::Revolute)
        );
        let mimic = turn.mimic.as_ref().unwrap();
        assert_eq!((mimic.joint.as_str(), mimic.multiplier), (slide.name.as_str(), Some(-2.0)));
        assert!(slide.mimic.is_none());
        assert_eq!(
            (slide.limit.lower, slide.limit.upper),
            (-0.5 * model.joints[1].limit.upper, -0.5 * model.joints[1].limit.lower)
        );
        assert_eq!((&slide.child.link, &turn.child.link), (&turn.parent.link, &model.links[2].name));
        assert!(single_joint_urdf(&model).contains("filename=\"../meshes/visual/drawer.obj\""));
        // Finer than any file's thread is a hinge.
        model.joints[1].kind = JointKind::Free { pitch_m_per_rad: 1e-6 };
        let fine = urdf(&model, UrdfScrew::Pair);
        assert!(fine.contains("<artitwin:thread type=\"free\"") && !fine.contains("mimic"), "{fine}");
    }

    #[test]
    fn gazebo_gets_the_friction_of_every_link_by_the_file_for_ros() {
        let text = ros_urdf(&cabinet(), UrdfScrew::Pair);
        for name in ["body", "door", "drawer"] {
            assert!(text.contains(&format!("<gazebo reference=\"{name}\"><mu1>0.6</mu1>")), "{text}");
        }
        assert!(!urdf(&cabinet(), UrdfScrew::Pair).contains("gazebo"));
    }

    #[test]
    fn markup_in_a_name_is_escaped() {
        let mut model = cabinet();
        model.links[1].name = "a<b&\"c\"'>".into();
        let robot = urdf_rs::read_from_string(&urdf(&model, UrdfScrew::Nearest)).unwrap();
        assert_eq!(robot.links[1].name, model.links[1].name);
    }
}
