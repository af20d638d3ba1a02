//! Types and poses of handles on doors and drawers.

use geometry::Pose;

/// Handles of doors and drawers, instead of the family's plain ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandleStyle {
    /// Bars on two posts.
    Bar,
    /// Knobs.
    Knob,
    /// Grips recessed into the plate.
    Recess,
    /// A random one of these for each part.
    Mixed,
    /// No handles.
    Bare,
}

impl HandleStyle {
    /// The style with a command line name.
    pub fn by_name(name: &str) -> Option<Self> {
        Some(match name {
            "bar" => Self::Bar,
            "knob" => Self::Knob,
            "recess" => Self::Recess,
            "mixed" => Self::Mixed,
            "none" => Self::Bare,
            _ => return None,
        })
    }
}

/// Type and sizes of a handle, meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HandleKind {
    /// A bar along x, centered on its frame's origin.
    Bar {
        /// Size along x.
        length_m: f64,
        /// Size along y and z.
        thickness_m: f64,
        /// Gap between bar and plate.
        clearance_m: f64,
    },
    /// A disk about z on a stem, with its head centered on its frame's origin.
    Knob {
        /// Diameter of the head.
        diameter_m: f64,
        /// Distance from the plate to the outer end.
        height_m: f64,
    },
    /// A box recessed into the plate; the origin of its frame is the center of its opening.
    Recess {
        /// Size along x.
        length_m: f64,
        /// Size along y.
        width_m: f64,
        /// Depth along -z.
        depth_m: f64,
    },
}

impl HandleKind {
    /// Name in files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Bar { .. } => "bar",
            Self::Knob { .. } => "knob",
            Self::Recess { .. } => "recess",
        }
    }
}

/// A handle and its pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Handle {
    /// Type and dimensions.
    pub kind: HandleKind,
    /// Pose of the handle's frame in its part: x along it, z out of the plate.
    pub part_from_handle: Pose,
}
