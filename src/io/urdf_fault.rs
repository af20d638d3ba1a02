//! A fault in the text of a URDF.

use common::limits::CHAIN_WORK;
use export::UnsoundUrdf;

/// A fault in the text of a URDF.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UrdfFault {
    /// It describes no bodies.
    #[error(transparent)]
    Unsound(#[from] UnsoundUrdf),
    /// A joint of an unsupported type.
    #[error("joint '{joint}' is of type '{kind}'; fixed, revolute, continuous and prismatic are read")]
    JointType {
        /// Name of the joint.
        joint: String,
        /// Its type.
        kind: String,
    },
    /// A joint between missing links.
    #[error("joint '{joint}' names the unknown link '{link}'")]
    NoLink {
        /// Name of the joint.
        joint: String,
        /// The link.
        link: String,
    },
    /// A joint without direction.
    #[error("joint '{0}' has an axis of no length")]
    NoAxis(String),
    /// A template of a URDF.
    #[error("it is a xacro template: expand it with `xacro {0} > {1}` (pip install xacro) and give {1}")]
    Xacro(String, String),
    /// A folder without a twin.
    #[error("the folder holds {0} .urdf files; name one")]
    NotOneUrdf(usize),
    /// A mesh on another machine.
    #[error("mesh '{0}' is not a relative path")]
    MeshElsewhere(String),
    /// A mesh in another folder.
    #[error("mesh '{0}' is not below the URDF's folder, nor in a ROS package (package.xml) around it")]
    MeshOutside(String),
    /// A chain too long: its dynamics would take minutes.
    #[error(
        "{moving} joints move {links} links, whose product is beyond the limit of {CHAIN_WORK}: \
         give the part that was recorded"
    )]
    Chain {
        /// Movable joints.
        moving: usize,
        /// All links.
        links: usize,
    },
    /// More than one root body, or none.
    #[error("the links must hang on one root, there are {0}")]
    Roots(usize),
    /// A loop of links.
    #[error("some joints make a loop")]
    Loop,
    /// Its visible surface.
    #[error("{0}")]
    Seen(String),
}
