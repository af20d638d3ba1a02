//! What is wrong with the text of a URDF.

use common::limits::CHAIN_WORK;
use export::UnsoundUrdf;

/// What is wrong with the text of a URDF.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UrdfFault {
    /// It describes no bodies.
    #[error(transparent)]
    Unsound(#[from] UnsoundUrdf),
    /// A tensor of which a part would have to be guessed.
    #[error("an <inertia> has no {0}")]
    Inertia(&'static str),
    /// A joint of a type that is not read.
    #[error("joint '{joint}' is of type '{kind}'; fixed, revolute, continuous and prismatic are read")]
    JointType {
        /// Name of the joint.
        joint: String,
        /// Its type.
        kind: String,
    },
    /// A joint between what is not there.
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
    /// A folder that leads to no twin.
    #[error("the folder holds {0} .urdf files; name one")]
    NotOneUrdf(usize),
    /// A mesh on another machine.
    #[error("mesh '{0}' is not a relative path")]
    MeshElsewhere(String),
    /// A mesh in another folder.
    #[error("mesh '{0}' is not below the URDF's folder")]
    MeshOutside(String),
    /// A chain whose dynamics would take minutes.
    #[error(
        "{moving} joints move {links} links, whose product is beyond the limit of {CHAIN_WORK}: \
         give the part that was recorded"
    )]
    Chain {
        /// Joints that move.
        moving: usize,
        /// All links.
        links: usize,
    },
    /// More than one body that hangs on nothing, or none.
    #[error("the links must hang on one root, there are {0}")]
    Roots(usize),
    /// A link that carries itself.
    #[error("some joints make a loop")]
    Loop,
    /// What cameras would see of it.
    #[error("{0}")]
    Seen(String),
}
