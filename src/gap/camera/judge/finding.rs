//! A finding of a diagnosis from frames.

use crate::{camera::model::twin::SeenTwin, judge::finding::Finding};

/// Name of the camera where a report names a joint.
pub const CAMERA: &str = "camera";

/// Subject of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// A joint, or the part it carries.
    Joint(usize),
    /// The root part.
    Root,
    /// The camera.
    Camera,
}

impl Subject {
    /// Name in reports.
    pub fn name(self, twin: &SeenTwin) -> &str {
        match self {
            Self::Joint(j) => &twin.joints[j].name,
            Self::Root => &twin.parts[0].name,
            Self::Camera => CAMERA,
        }
    }
}

/// A finding with the additional fields of its report.
#[derive(Clone, Debug)]
pub struct CameraFinding {
    /// Its subject.
    pub subject: Subject,
    /// The finding.
    pub finding: Finding,
    /// Joint type in the twin and in the frames, where they differ.
    pub types: Option<[&'static str; 2]>,
    /// How the URDF expresses it.
    pub in_urdf: &'static str,
}
