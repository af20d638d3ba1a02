//! A lenient reader of URDF: missing elements stay missing, for the rules to report.

use nalgebra::{Translation3, UnitQuaternion, Vector3};
use roxmltree::Node;

use super::numbers::{BadNumber, bad_numbers};
use common::limits::{LINKS, URDF, XmlError, parse_xml};
use geometry::Pose;

/// Reason to refuse a text as a URDF.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DescriptionError {
    /// More bytes than the limit.
    #[error("has {bytes} bytes; {} are the limit of {}", URDF.bytes, URDF.what)]
    Bytes {
        /// Its size.
        bytes: usize,
    },
    /// Malformed or refused XML.
    #[error(transparent)]
    Xml(#[from] XmlError),
    /// Another kind of document.
    #[error("the root element is <{0}>, not <robot>")]
    Root(String),
    /// More links or joints than the limit.
    #[error("has {0} links or joints; {LINKS} are the limit: split the model")]
    Links(usize),
}

/// A link as the text has it.
pub(super) struct LinkText {
    pub name: String,
    pub inertial: Option<InertialText>,
    pub visuals: Vec<ShapeText>,
    pub collisions: Vec<ShapeText>,
}

/// Mass and `ixx ixy ixz iyy iyz izz`; `None` for a missing number, NaN for a malformed one.
pub(super) struct InertialText {
    pub mass: Option<f64>,
    pub inertia: [Option<f64>; 6],
}

/// A visual or a collision.
pub(super) struct ShapeText {
    pub name: Option<String>,
    pub link_from_shape: Pose,
    pub geometry: Geometry,
    pub material: Option<MaterialText>,
}

/// A material of the robot, or of a visual.
pub(super) struct MaterialText {
    pub name: Option<String>,
    pub texture: Option<String>,
    /// It has a color or a texture; otherwise it refers to a defined one.
    pub is_defined: bool,
    /// Its color has no numbers.
    pub is_blank: bool,
}

/// The form of a shape.
pub(super) enum Geometry {
    Mesh {
        path: String,
        scale: Vector3<f64>,
    },
    Cuboid(Vector3<f64>),
    Cylinder {
        radius: f64,
        length: f64,
    },
    Sphere(f64),
    /// The tag of another kind.
    Other(String),
    /// None.
    Missing,
}

/// A joint as the text has it.
pub(super) struct JointText {
    pub name: String,
    pub kind: String,
    pub parent: String,
    pub child: String,
    pub parent_from_joint: Pose,
    pub axis: Option<Vector3<f64>>,
    pub limit: Option<LimitText>,
    pub mimic: Option<MimicText>,
    /// Has a safety controller without its velocity gain.
    pub lacks_safety_velocity: bool,
    /// Whether it stands for a screw; URDF has no such type.
    pub threaded: bool,
}

/// The law of a follower: its position is `multiplier` times the leader's, plus `offset`.
pub(super) struct MimicText {
    pub joint: String,
    pub multiplier: f64,
    pub offset: f64,
}

/// Attributes of `<limit>`; `None` for a missing number, NaN for a malformed one.
pub(super) struct LimitText {
    pub lower: Option<f64>,
    pub upper: Option<f64>,
    pub effort: Option<f64>,
    pub velocity: Option<f64>,
}

/// Links and joints of a URDF.
pub(super) struct Description {
    pub links: Vec<LinkText>,
    pub joints: Vec<JointText>,
    /// Materials of the robot; visuals refer to them by name.
    pub materials: Vec<MaterialText>,
    /// MuJoCo keeps the visuals instead of dropping them.
    pub keeps_visuals: bool,
    pub bad_numbers: Vec<BadNumber>,
}

impl Description {
    /// Reads URDF text.
    pub(super) fn parse(text: &str) -> Result<Self, DescriptionError> {
        // Before the parser: its tree takes a multiple of the text's memory.
        if text.len() as u64 > URDF.bytes {
            return Err(DescriptionError::Bytes { bytes: text.len() });
        }
        let document = parse_xml(text)?;
        let robot = document.root_element();
        if robot.tag_name().name() != "robot" {
            return Err(DescriptionError::Root(robot.tag_name().name().to_owned()));
        }
        let count = children(robot, "link").count().max(children(robot, "joint").count());
        // Before links are read: the rules of overlap compare them in pairs.
        if count > LINKS {
            return Err(DescriptionError::Links(count));
        }
        let mut compilers = children(robot, "mujoco").filter_map(|n| child(n, "compiler"));
        Ok(Self {
            links: children(robot, "link").map(link).collect(),
            joints: children(robot, "joint").map(joint).collect(),
            materials: children(robot, "material").map(material).collect(),
            keeps_visuals: compilers.any(|c| c.attribute("discardvisual") == Some("false")),
            bad_numbers: bad_numbers(robot),
        })
    }
}

fn children<'a>(node: Node<'a, 'a>, tag: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |n| n.has_tag_name(tag))
}

fn child<'a>(node: Node<'a, 'a>, tag: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|n| n.has_tag_name(tag))
}

fn text(node: Node, attribute: &str) -> String {
    node.attribute(attribute).unwrap_or_default().to_owned()
}

/// The number of a text; NaN for a malformed one.
fn number(text: &str) -> f64 {
    text.trim().parse().unwrap_or(f64::NAN)
}

/// Three numbers; NaN where one is missing.
fn triple(text: &str) -> Vector3<f64> {
    let mut words = text.split_whitespace();
    Vector3::from_fn(|_, _| words.next().map_or(f64::NAN, number))
}

fn pose(node: Node) -> Pose {
    // As URDF has it, a missing origin is the identity.
    let origin = child(node, "origin");
    let [xyz, rpy] =
        ["xyz", "rpy"].map(|name| origin.and_then(|o| o.attribute(name)).map_or_else(Vector3::zeros, triple));
    Pose::from_parts(Translation3::from(xyz), UnitQuaternion::from_euler_angles(rpy.x, rpy.y, rpy.z))
}

fn link(node: Node) -> LinkText {
    let inertial = child(node, "inertial").map(|i| {
        let mass = child(i, "mass").and_then(|m| m.attribute("value")).map(number);
        let inertia = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]
            .map(|name| child(i, "inertia").and_then(|t| t.attribute(name)).map(number));
        InertialText { mass, inertia }
    });
    LinkText {
        name: text(node, "name"),
        inertial,
        visuals: children(node, "visual").map(shape).collect(),
        collisions: children(node, "collision").map(shape).collect(),
    }
}

fn shape(node: Node) -> ShapeText {
    let geometry = child(node, "geometry").and_then(|g| g.children().find(Node::is_element)).map_or(
        Geometry::Missing,
        |g| match g.tag_name().name() {
            "mesh" => {
                let scale = g.attribute("scale").map_or(Vector3::repeat(1.0), triple);
                Geometry::Mesh { path: text(g, "filename"), scale }
            }
            "box" => Geometry::Cuboid(triple(&text(g, "size"))),
            "cylinder" => {
                Geometry::Cylinder { radius: number(&text(g, "radius")), length: number(&text(g, "length")) }
            }
            "sphere" => Geometry::Sphere(number(&text(g, "radius"))),
            other => Geometry::Other(other.to_owned()),
        },
    );
    let name = node.attribute("name").map(str::to_owned);
    ShapeText { name, link_from_shape: pose(node), geometry, material: child(node, "material").map(material) }
}

fn material(node: Node) -> MaterialText {
    let texture = child(node, "texture").map(|t| text(t, "filename"));
    MaterialText {
        name: node.attribute("name").filter(|n| !n.is_empty()).map(str::to_owned),
        is_defined: texture.is_some() || child(node, "color").is_some(),
        is_blank: child(node, "color").is_some_and(|c| c.attribute("rgba").is_none()),
        texture,
    }
}

fn joint(node: Node) -> JointText {
    let [parent, child_link] =
        ["parent", "child"].map(|tag| child(node, tag).map(|n| text(n, "link")).unwrap_or_default());
    let limit = child(node, "limit").map(|l| LimitText {
        lower: l.attribute("lower").map(number),
        upper: l.attribute("upper").map(number),
        effort: l.attribute("effort").map(number),
        velocity: l.attribute("velocity").map(number),
    });
    JointText {
        name: text(node, "name"),
        kind: text(node, "type"),
        parent,
        child: child_link,
        parent_from_joint: pose(node),
        axis: child(node, "axis").map(|a| triple(&text(a, "xyz"))),
        limit,
        mimic: child(node, "mimic").map(|m| MimicText {
            joint: text(m, "joint"),
            multiplier: m.attribute("multiplier").map_or(1.0, number),
            offset: m.attribute("offset").map_or(0.0, number),
        }),
        lacks_safety_velocity: child(node, "safety_controller")
            .is_some_and(|s| s.attribute("k_velocity").is_none()),
        // By the local name, whatever prefix stands for the namespace.
        threaded: node.children().any(|n| n.tag_name().name() == "thread"),
    }
}
