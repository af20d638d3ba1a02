//! The reader of URDF texts. What is missing stays missing, so that rules can say so.
//!
//! It is not built on urdf-rs, which tests use as a second reader. Of the 52 files in
//! `tests/conformance/urdf.tar.zst` that a diagnosis reads, urdf-rs 0.10 refuses 17 (a limit without
//! velocity, a mass without inertia, a visual without geometry); of the 20 to be refused it reads 9 (links
//! that are twice or not there, loops, another root). `1 x 2 3` is (1, 2, 3) to it, a missing limit is one
//! from 0 to 0, and a screw loses its pitch.

use nalgebra::{Translation3, UnitQuaternion, Vector3};
use roxmltree::Node;

use super::{
    finding::CheckFinding,
    numbers::{BadNumber, bad_numbers},
};
use common::limits::{LINKS, URDF, XmlError, parse_xml};
use geometry::Pose;
use model::Mimic;

/// Why a URDF describes no bodies.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UnsoundUrdf {
    /// More bytes than are read.
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
    /// Its names, links or numbers.
    #[error("'{}': {}{}", first.subject.escape_debug(), first.message, further(*more))]
    Broken {
        /// The first thing that is wrong.
        first: CheckFinding,
        /// How much more there is.
        more: usize,
    },
}

fn further(more: usize) -> String {
    if more > 0 { format!(" (and {more} more: see `artitwin check`)") } else { String::new() }
}

/// Attributes of `<inertia>`.
pub const INERTIA: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];

/// A link as the text has it.
#[derive(Clone, Debug)]
pub struct LinkText {
    /// Name; empty where it has none.
    pub name: String,
    /// Mass and inertia.
    pub inertial: Option<InertialText>,
    /// What cameras see.
    pub visuals: Vec<ShapeText>,
    /// What collides.
    pub collisions: Vec<ShapeText>,
}

/// Mass and inertia; `None` for what is missing, NaN for what is no number.
#[derive(Clone, Debug)]
pub struct InertialText {
    /// Frame of the inertia: center of mass and axes.
    pub link_from_inertial: Pose,
    /// Kilograms.
    pub mass: Option<f64>,
    /// [`INERTIA`] about the center of mass, kg m^2.
    pub inertia: [Option<f64>; 6],
}

/// A visual or a collision.
#[derive(Clone, Debug)]
pub struct ShapeText {
    pub(super) name: Option<String>,
    /// Frame of the shape.
    pub link_from_shape: Pose,
    /// The shape.
    pub geometry: Geometry,
    pub(super) material: Option<MaterialText>,
}

/// A material of the robot, or of a visual.
#[derive(Clone, Debug)]
pub(super) struct MaterialText {
    pub name: Option<String>,
    pub texture: Option<String>,
    /// It has a color or a texture; otherwise it refers to a defined one.
    pub is_defined: bool,
    /// Its color has no numbers.
    pub is_blank: bool,
}

/// What a shape is; meters, NaN for what is no number.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// A file.
    Mesh {
        /// As the text names it.
        path: String,
        /// Factor along each axis of the mesh.
        scale: Vector3<f64>,
    },
    /// A box, by its sides.
    Cuboid(Vector3<f64>),
    /// About z.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Length.
        length: f64,
    },
    /// A ball, by its radius.
    Sphere(f64),
    /// The tag of another kind.
    Other(String),
    /// None.
    Missing,
}

/// A joint as the text has it.
#[derive(Clone, Debug)]
pub struct JointText {
    /// Name; empty where it has none.
    pub name: String,
    /// `type`.
    pub kind: String,
    /// Name of the parent link.
    pub parent: String,
    /// Name of the child link.
    pub child: String,
    /// Joint frame in the parent link's frame at position 0.
    pub parent_from_joint: Pose,
    /// Axis in the joint frame; without, URDF has x.
    pub axis: Option<Vector3<f64>>,
    /// Limits.
    pub limit: Option<LimitText>,
    /// Viscous damping, N m s/rad or N s/m; 0 where it has none.
    pub damping: f64,
    /// Coulomb friction, N m or N; 0 where it has none.
    pub friction: f64,
    /// That it follows another joint.
    pub mimic: Option<Mimic>,
    /// Has a safety controller without its velocity gain.
    pub(super) lacks_safety_velocity: bool,
    /// Whether it stands for a screw, which URDF has no word for.
    pub(super) threaded: bool,
    /// Advance of the screw, where it is given.
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
    #[must_use]
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
    /// Those of the robot, which visuals refer to by name.
    pub(super) materials: Vec<MaterialText>,
    /// MuJoCo keeps the visuals, which it drops otherwise.
    pub(super) keeps_visuals: bool,
    pub(super) bad_numbers: Vec<BadNumber>,
}

impl Description {
    /// Reads URDF text.
    ///
    /// # Errors
    /// More than 16 MiB or [`LINKS`] links or joints, no XML that is read, or another kind of document.
    pub fn parse(text: &str) -> Result<Self, UnsoundUrdf> {
        // Before the parser, whose tree takes a multiple of the text's memory.
        if text.len() as u64 > URDF.bytes {
            return Err(UnsoundUrdf::Bytes { bytes: text.len() });
        }
        let document = parse_xml(text)?;
        let robot = document.root_element();
        if robot.tag_name().name() != "robot" {
            return Err(UnsoundUrdf::Root(robot.tag_name().name().to_owned()));
        }
        let count = children_of_tag(robot, "link").count().max(children_of_tag(robot, "joint").count());
        // Before links are read: the rules of overlap compare them in pairs.
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
    // As URDF has it, a missing origin is the identity.
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
    // By the local name, whatever prefix stands for the namespace.
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
