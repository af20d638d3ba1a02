//! Links and joints of a URDF's text, with URDF's defaults for what is left out.

use nalgebra::{Matrix3, Translation3, UnitQuaternion, Vector3};
use roxmltree::Node;

use super::urdf_fault::UrdfFault;
use common::limits::{LINKS, parse_xml};
use geometry::Pose;

/// Links and joints in the order of the text.
pub(super) struct Robot {
    pub name: String,
    pub links: Vec<RobotLink>,
    pub joints: Vec<RobotJoint>,
}

/// A link; without `<inertial>` its mass and inertia are 0.
pub(super) struct RobotLink {
    pub name: String,
    /// Frame of the inertia: center of mass and axes.
    pub link_from_inertial: Pose,
    pub mass_kg: f64,
    /// About the center of mass, kg m^2.
    pub inertia: Matrix3<f64>,
    /// Of the visuals, those that are meshes.
    pub meshes: Vec<RobotMesh>,
}

/// A mesh that a visual names.
pub(super) struct RobotMesh {
    pub link_from_mesh: Pose,
    pub file: String,
    pub scale: Vector3<f64>,
}

/// A joint; numbers that are left out are 0, the axis is x.
pub(super) struct RobotJoint {
    pub name: String,
    pub kind: String,
    pub parent: String,
    pub child: String,
    pub parent_from_joint: Pose,
    pub axis: Vector3<f64>,
    /// Lower and upper.
    pub limits: [f64; 2],
    pub damping: f64,
    pub friction: f64,
    pub mimic: Option<RobotMimic>,
}

/// That a joint follows another.
pub(super) struct RobotMimic {
    pub joint: String,
    pub multiplier: f64,
    pub offset: f64,
}

impl Robot {
    /// Reads the text.
    ///
    /// # Errors
    /// No robot, nested too deep, more than [`LINKS`] links or joints, or what is no number.
    pub fn parse(text: &str) -> Result<Self, UrdfFault> {
        let document = parse_xml(text)?;
        let robot = document.root_element();
        if robot.tag_name().name() != "robot" {
            return Err(UrdfFault::Robot(format!("the root element is <{}>", robot.tag_name().name())));
        }
        let all = |tag: &'static str| robot.children().filter(move |n| n.has_tag_name(tag));
        let count = all("link").count().max(all("joint").count());
        if count > LINKS {
            return Err(UrdfFault::Links(count));
        }
        Ok(Self {
            name: text_of(robot, "name"),
            links: all("link").map(link).collect::<Result<_, _>>()?,
            joints: all("joint").map(joint).collect::<Result<_, _>>()?,
        })
    }
}

fn link(node: Node) -> Result<RobotLink, UrdfFault> {
    let inertial = child(Some(node), "inertial");
    let meshes = node.children().filter(|n| n.has_tag_name("visual")).filter_map(|visual| {
        let mesh = child(child(Some(visual), "geometry"), "mesh")?;
        Some(pose(Some(visual)).and_then(|link_from_mesh| {
            let scale = numbers(Some(mesh), "scale")?.map_or(Vector3::repeat(1.0), Vector3::from);
            Ok(RobotMesh { link_from_mesh, file: text_of(mesh, "filename"), scale })
        }))
    });
    Ok(RobotLink {
        name: text_of(node, "name"),
        link_from_inertial: pose(inertial)?,
        mass_kg: number(child(inertial, "mass"), "value", 0.0)?,
        inertia: inertia(child(inertial, "inertia"))?,
        meshes: meshes.collect::<Result<_, _>>()?,
    })
}

/// The tensor; zeros without the element.
fn inertia(node: Option<Node>) -> Result<Matrix3<f64>, UrdfFault> {
    let Some(node) = node else { return Ok(Matrix3::zeros()) };
    let read = |name: &str| {
        // A tensor of which a part is guessed is that of no body.
        let missing = || UrdfFault::Robot(format!("an <inertia> has no {name}"));
        numbers::<1>(Some(node), name)?.map(|[x]| x).ok_or_else(missing)
    };
    let xx = read("ixx")?;
    let xy = read("ixy")?;
    let xz = read("ixz")?;
    let yy = read("iyy")?;
    let yz = read("iyz")?;
    let zz = read("izz")?;
    Ok(Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz))
}

fn joint(node: Node) -> Result<RobotJoint, UrdfFault> {
    let of = |tag| child(Some(node), tag);
    let link = |tag| of(tag).map(|n| text_of(n, "link")).unwrap_or_default();
    Ok(RobotJoint {
        name: text_of(node, "name"),
        kind: text_of(node, "type"),
        parent: link("parent"),
        child: link("child"),
        parent_from_joint: pose(Some(node))?,
        axis: numbers(of("axis"), "xyz")?.map_or(Vector3::x(), Vector3::from),
        limits: [number(of("limit"), "lower", 0.0)?, number(of("limit"), "upper", 0.0)?],
        damping: number(of("dynamics"), "damping", 0.0)?,
        friction: number(of("dynamics"), "friction", 0.0)?,
        mimic: of("mimic").map(mimic).transpose()?,
    })
}

fn mimic(node: Node) -> Result<RobotMimic, UrdfFault> {
    Ok(RobotMimic {
        joint: text_of(node, "joint"),
        multiplier: number(Some(node), "multiplier", 1.0)?,
        offset: number(Some(node), "offset", 0.0)?,
    })
}

/// The pose of an `<origin>` in an element; the identity without.
fn pose(node: Option<Node>) -> Result<Pose, UrdfFault> {
    let origin = child(node, "origin");
    let xyz = numbers(origin, "xyz")?.unwrap_or([0.0; 3]);
    let [roll, pitch, yaw] = numbers(origin, "rpy")?.unwrap_or([0.0; 3]);
    // URDF turns about fixed axes, x first: Rz Ry Rx, which is nalgebra's order, too.
    let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    Ok(Pose::from_parts(Translation3::from(Vector3::from(xyz)), rotation))
}

fn child<'a>(node: Option<Node<'a, 'a>>, tag: &str) -> Option<Node<'a, 'a>> {
    node?.children().find(|n| n.has_tag_name(tag))
}

fn text_of(node: Node, attribute: &str) -> String {
    node.attribute(attribute).unwrap_or_default().to_owned()
}

fn number(node: Option<Node>, attribute: &str, default: f64) -> Result<f64, UrdfFault> {
    Ok(numbers::<1>(node, attribute)?.map_or(default, |[x]| x))
}

/// The numbers of an attribute, where it is there.
fn numbers<const N: usize>(node: Option<Node>, attribute: &str) -> Result<Option<[f64; N]>, UrdfFault> {
    let Some(text) = node.and_then(|n| n.attribute(attribute)) else { return Ok(None) };
    let read: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    match read.and_then(|all| <[f64; N]>::try_from(all).ok()) {
        Some(all) => Ok(Some(all)),
        None => Err(UrdfFault::Robot(format!("'{}' is not {N} numbers", text.escape_debug()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_has_the_defaults_of_urdf() {
        let robot = Robot::parse(
            "<robot name='r'><link name='a'><inertial><mass value='2'/></inertial><visual><geometry><mesh \
             filename='m.obj'/></geometry></visual><visual/><visual><geometry><box size='1 1 \
             1'/></geometry></visual></link><link name='b'/><joint name='j' type='continuous'><parent \
             link='a'/><child link='b'/><limit upper='0.5'/><mimic joint='k'/></joint></robot>",
        );
        let robot = robot.unwrap();
        let a = &robot.links[0];
        let b = &robot.links[1];
        let j = &robot.joints[0];
        assert_eq!((a.mass_kg, a.inertia, b.mass_kg), (2.0, Matrix3::zeros(), 0.0));
        assert_eq!(
            (a.meshes.len(), &a.meshes[0].file[..], a.meshes[0].scale),
            (1, "m.obj", Vector3::repeat(1.0))
        );
        assert_eq!(
            (j.axis, j.limits, j.damping, j.parent_from_joint),
            (Vector3::x(), [0.0, 0.5], 0.0, Pose::identity())
        );
        let mimic = j.mimic.as_ref().unwrap();
        assert_eq!((&mimic.joint[..], mimic.multiplier, mimic.offset), ("k", 1.0, 0.0));
    }

    #[test]
    fn what_is_no_robot_is_refused() {
        for (text, words) in [
            ("<robot", "no XML"),
            ("<model/>", "the root element is <model>"),
            ("<robot><link><inertial><mass value='x'/></inertial></link></robot>", "'x' is not 1 numbers"),
            ("<robot><joint><axis xyz='1 0'/></joint></robot>", "'1 0' is not 3 numbers"),
            ("<robot><link><inertial><inertia ixx='1'/></inertial></link></robot>", "has no ixy"),
        ] {
            let why = Robot::parse(text).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(why.contains(words), "'{words}' is not in '{why}'");
        }
        let many = format!("<robot>{}</robot>", "<link/>".repeat(LINKS + 1));
        assert!(matches!(Robot::parse(&many), Err(UrdfFault::Links(n)) if n == LINKS + 1));
    }
}
