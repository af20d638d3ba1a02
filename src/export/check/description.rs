//! Reads URDF texts. What is missing stays missing, so rules can report it.
//!
//! It is not built on urdf-rs, which tests use as a second reader. Of the 52 files in
//! `tests/conformance/urdf.tar.zst` that a diagnosis reads, urdf-rs 0.10 refuses 17 (a limit without
//! velocity, a mass without inertia, a visual without geometry). Of the 20 that must be refused it reads 9
//! (duplicate or missing links, loops, another root element). It reads `1 x 2 3` as (1, 2, 3) and a missing
//! limit as one from 0 to 0, and it loses the pitch of a screw.

use nalgebra::{Translation3, UnitQuaternion, Vector3};
use roxmltree::Node;

use super::{
    finding::CheckFinding,
    numbers::{BadNumber, bad_numbers},
};
use common::limits::{LINKS, URDF, XmlError, parse_xml};
use geometry::Pose;
use model::Mimic;

/// Why a URDF does not describe bodies.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UnsoundUrdf {
    /// It is larger than the limit.
    #[error("has {bytes} bytes; {} are the limit of {}", URDF.bytes, URDF.what)]
    Bytes {
        /// Its size, bytes.
        bytes: usize,
    },
    /// Malformed or refused XML.
    #[error(transparent)]
    Xml(#[from] XmlError),
    /// It is another kind of document.
    #[error("the root element is <{0}>, not <robot>: give a URDF")]
    Root(String),
    /// It has more links or joints than the limit.
    #[error("has {0} links or joints; {LINKS} are the limit: split the model")]
    Links(usize),
    /// Its names, links or numbers are wrong.
    #[error("'{}': {}{}", first.subject.escape_debug(), first.message, further(*more))]
    Broken {
        /// The first finding.
        first: CheckFinding,
        /// Number of further findings.
        more: usize,
    },
}

fn further(more: usize) -> String {
    if more > 0 { format!(" (and {more} more: see `artitwin check`)") } else { String::new() }
}

/// Attributes of `<inertia>`.
pub const INERTIA: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];

/// A link as the text describes it.
#[derive(Clone, Debug)]
pub struct LinkText {
    /// Name; empty where it has none.
    pub name: String,
    /// Mass and inertia.
    pub inertial: Option<InertialText>,
    /// Visual shapes.
    pub visuals: Vec<ShapeText>,
    /// Collision shapes.
    pub collisions: Vec<ShapeText>,
}

/// Mass and inertia; `None` for what is missing, NaN for what is not a number.
#[derive(Clone, Debug)]
pub struct InertialText {
    /// Frame of the inertia: center of mass and axes.
    pub link_from_inertial: Pose,
    /// Mass, kg.
    pub mass: Option<f64>,
    /// [`INERTIA`] about the center of mass, kg m^2.
    pub inertia: [Option<f64>; 6],
}

/// A visual or a collision element.
#[derive(Clone, Debug)]
pub struct ShapeText {
    pub(super) name: Option<String>,
    /// Pose of the shape in the link frame.
    pub link_from_shape: Pose,
    /// The shape.
    pub geometry: Geometry,
    pub(super) material: Option<MaterialText>,
}

/// A material of the robot or of a visual.
#[derive(Clone, Debug)]
pub(super) struct MaterialText {
    pub name: Option<String>,
    pub texture: Option<String>,
    /// Whether it has a color or a texture; otherwise it refers to a material defined elsewhere.
    pub is_defined: bool,
    /// Whether its color has no numbers.
    pub is_blank: bool,
}

/// Geometry of a shape, meters; NaN for what is not a number.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// A mesh file.
    Mesh {
        /// Its path as written in the text.
        path: String,
        /// Factor along each axis of the mesh.
        scale: Vector3<f64>,
    },
    /// A box, by its sides.
    Cuboid(Vector3<f64>),
    /// A cylinder about z.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Length.
        length: f64,
    },
    /// A sphere, by its radius.
    Sphere(f64),
    /// A geometry of another kind, by its tag.
    Other(String),
    /// There is no geometry.
    Missing,
}

/// A joint as the text describes it.
#[derive(Clone, Debug)]
pub struct JointText {
    /// Name; empty where it has none.
    pub name: String,
    /// The attribute `type`.
    pub kind: String,
    /// Name of the parent link.
    pub parent: String,
    /// Name of the child link.
    pub child: String,
    /// Joint frame in the parent link's frame at position 0.
    pub parent_from_joint: Pose,
    /// Axis in the joint frame; `None` if missing, for which URDF means x.
    pub axis: Option<Vector3<f64>>,
    /// Limits.
    pub limit: Option<LimitText>,
    /// Viscous damping, N m s/rad or N s/m; 0 where it has none.
    pub damping: f64,
    /// Coulomb friction, N m or N; 0 where it has none.
    pub friction: f64,
    /// Coupling to another joint, if any.
    pub mimic: Option<Mimic>,
    /// Whether it has a safety controller without its velocity gain.
    pub(super) lacks_safety_velocity: bool,
    /// Whether it stands for a screw, a type that URDF lacks.
    pub(super) threaded: bool,
    /// Advance of the screw, meters per radian, if it is given.
    pub pitch_m_per_rad: Option<f64>,
}

/// Attributes of `<limit>`; NaN for what is no number, `None` for what is missing.
#[derive(Clone, Debug)]
pub struct LimitText {
    /// Lowest position, radians or meters.
    pub lower: Option<f64>,
    /// Highest position.
    pub upper: Option<f64>,
    pub(super) effort: Option<f64>,
    pub(super) velocity: Option<f64>,
}

impl LimitText {
    /// Lowest and highest position, 0 for what is missing.
    pub fn range(&self) -> [f64; 2] {
        [self.lower.unwrap_or(0.0), self.upper.unwrap_or(0.0)]
    }
}

/// Links and joints of a URDF, in the order of the text.
#[derive(Clone, Debug)]
pub struct Description {
    /// Name of the robot.
    pub name: String,
    /// Links.
    pub links: Vec<LinkText>,
    /// Joints.
    pub joints: Vec<JointText>,
    /// Materials of the robot, to which visuals refer by name.
    pub(super) materials: Vec<MaterialText>,
    /// Whether MuJoCo has to keep the visuals, which it drops by default.
    pub(super) keeps_visuals: bool,
    pub(super) bad_numbers: Vec<BadNumber>,
}

impl Description {
    /// Reads URDF text.
    ///
    /// # Errors
    /// If the text has more than 16 MiB or [`LINKS`] links or joints, is not XML that can be read, or is
    /// another kind of document.
    pub fn parse(text: &str) -> Result<Self, UnsoundUrdf> {
        // Checked before parsing, as the parser's tree takes a multiple of the text's memory.
        if text.len() as u64 > URDF.bytes {
            return Err(UnsoundUrdf::Bytes { bytes: text.len() });
        }
        let document = parse_xml(text)?;
        let robot = document.root_element();
        if robot.tag_name().name() != "robot" {
            return Err(UnsoundUrdf::Root(robot.tag_name().name().to_owned()));
        }
        let count = children_of_tag(robot, "link").count().max(children_of_tag(robot, "joint").count());
        // Checked before links are read, as the rules of overlap compare them in pairs.
        if count > LINKS {
            return Err(UnsoundUrdf::Links(count));
        }
        let mut compilers = children_of_tag(robot, "mujoco").filter_map(|n| child_of_tag(n, "compiler"));
        Ok(Self {
            name: self::attribute_text(robot, "name"),
            links: children_of_tag(robot, "link").map(link_of_node).collect(),
            joints: children_of_tag(robot, "joint").map(joint_of_node).collect(),
            materials: children_of_tag(robot, "material").map(material_of_node).collect(),
            keeps_visuals: compilers.any(|c| c.attribute("discardvisual") == Some("false")),
            bad_numbers: bad_numbers(robot),
        })
    }
}

fn children_of_tag<'a>(node: Node<'a, 'a>, tag: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |n| n.has_tag_name(tag))
}

fn child_of_tag<'a>(node: Node<'a, 'a>, tag: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|n| n.has_tag_name(tag))
}

fn attribute_text(node: Node, attribute: &str) -> String {
    node.attribute(attribute).unwrap_or_default().to_owned()
}

/// The number of a text; NaN for a malformed one.
fn number_of_text(text: &str) -> f64 {
    text.trim().parse().unwrap_or(f64::NAN)
}

/// Three numbers; NaN where one is missing.
fn vector_of_text(text: &str) -> Vector3<f64> {
    let mut words = text.split_whitespace();
    Vector3::from_fn(|_, _| words.next().map_or(f64::NAN, number_of_text))
}

fn pose_of_origin(node: Node) -> Pose {
    // In URDF a missing origin means the identity.
    let origin = child_of_tag(node, "origin");
    let [xyz, rpy] = ["xyz", "rpy"]
        .map(|name| origin.and_then(|o| o.attribute(name)).map_or_else(Vector3::zeros, vector_of_text));
    Pose::from_parts(Translation3::from(xyz), UnitQuaternion::from_euler_angles(rpy.x, rpy.y, rpy.z))
}

fn link_of_node(node: Node) -> LinkText {
    let inertial = child_of_tag(node, "inertial").map(|i| {
        let mass = child_of_tag(i, "mass").and_then(|m| m.attribute("value")).map(number_of_text);
        let read =
            |name: &str| child_of_tag(i, "inertia").and_then(|t| t.attribute(name)).map(number_of_text);
        InertialText { link_from_inertial: pose_of_origin(i), mass, inertia: INERTIA.map(read) }
    });
    LinkText {
        name: attribute_text(node, "name"),
        inertial,
        visuals: children_of_tag(node, "visual").map(shape_of_node).collect(),
        collisions: children_of_tag(node, "collision").map(shape_of_node).collect(),
    }
}

fn shape_of_node(node: Node) -> ShapeText {
    let geometry = child_of_tag(node, "geometry").and_then(|g| g.children().find(Node::is_element)).map_or(
        Geometry::Missing,
        |g| match g.tag_name().name() {
            "mesh" => {
                let scale = g.attribute("scale").map_or(Vector3::repeat(1.0), vector_of_text);
                Geometry::Mesh { path: attribute_text(g, "filename"), scale }
            }
            "box" => Geometry::Cuboid(vector_of_text(&attribute_text(g, "size"))),
            "cylinder" => Geometry::Cylinder {
                radius: number_of_text(&attribute_text(g, "radius")),
                length: number_of_text(&attribute_text(g, "length")),
            },
            "sphere" => Geometry::Sphere(number_of_text(&attribute_text(g, "radius"))),
            other => Geometry::Other(other.to_owned()),
        },
    );
    let name = node.attribute("name").map(str::to_owned);
    ShapeText {
        name,
        link_from_shape: pose_of_origin(node),
        geometry,
        material: child_of_tag(node, "material").map(material_of_node),
    }
}

fn material_of_node(node: Node) -> MaterialText {
    let texture = child_of_tag(node, "texture").map(|t| attribute_text(t, "filename"));
    MaterialText {
        name: node.attribute("name").filter(|n| !n.is_empty()).map(str::to_owned),
        is_defined: texture.is_some() || child_of_tag(node, "color").is_some(),
        is_blank: child_of_tag(node, "color").is_some_and(|c| c.attribute("rgba").is_none()),
        texture,
    }
}

fn joint_of_node(node: Node) -> JointText {
    let [parent, child_link] = ["parent", "child"]
        .map(|tag| child_of_tag(node, tag).map(|n| attribute_text(n, "link")).unwrap_or_default());
    let limit = child_of_tag(node, "limit").map(|l| LimitText {
        lower: l.attribute("lower").map(number_of_text),
        upper: l.attribute("upper").map(number_of_text),
        effort: l.attribute("effort").map(number_of_text),
        velocity: l.attribute("velocity").map(number_of_text),
    });
    let dynamics =
        |name| child_of_tag(node, "dynamics").and_then(|d| d.attribute(name)).map_or(0.0, number_of_text);
    // Found by its local name, whatever prefix the namespace has.
    let thread = node.children().find(|n| n.tag_name().name() == "thread");
    JointText {
        name: attribute_text(node, "name"),
        kind: attribute_text(node, "type"),
        parent,
        child: child_link,
        parent_from_joint: pose_of_origin(node),
        axis: child_of_tag(node, "axis").and_then(|a| a.attribute("xyz")).map(vector_of_text),
        limit,
        damping: dynamics("damping"),
        friction: dynamics("friction"),
        mimic: child_of_tag(node, "mimic").map(|m| {
            let read = |name, default| m.attribute(name).map_or(default, number_of_text);
            Mimic {
                joint: attribute_text(m, "joint"),
                multiplier: read("multiplier", 1.0),
                offset: read("offset", 0.0),
            }
        }),
        lacks_safety_velocity: child_of_tag(node, "safety_controller")
            .is_some_and(|s| s.attribute("k_velocity").is_none()),
        threaded: thread.is_some(),
        pitch_m_per_rad: thread.and_then(|t| t.attribute("pitch_m_per_rad")).map(number_of_text),
    }
}
