//! A finding of a diagnosis by frames.

use crate::{camera::model::twin::SeenTwin, judge::finding::Finding};

/// Name of the camera where a report names a joint.
pub const CAMERA: &str = "camera";

/// What a finding is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// A joint, or the part that it carries.
    Joint(usize),
    /// The part that no joint carries.
    Root,
    /// The camera.
    Camera,
}

impl Subject {
    /// Name in reports.
    #[must_use]
    pub fn name(self, twin: &SeenTwin) -> &str {
        match self {
            Self::Joint(j) => &twin.joints[j].name,
            Self::Root => &twin.parts[0].name,
            Self::Camera => CAMERA,
        }
    }
}

/// A finding with what a report shows beside it.
#[derive(Clone, Debug)]
pub struct CameraFinding {
    /// What it is about.
    pub subject: Subject,
    /// The finding.
    pub finding: Finding,
    /// Types of the joint in the twin and in the frames, where it changes.
    pub types: Option<[&'static str; 2]>,
    /// What becomes of it in the URDF.
    pub in_urdf: &'static str,
}
